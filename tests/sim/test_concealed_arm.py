"""What is concealed in an arm: it rests where it is put, its laws have their limits, and its papers tell nothing."""

from __future__ import annotations

import numpy as np
import pytest

from jointscope.models.arm.build import build_arm
from jointscope.models.arm.forward import step_arm
from jointscope.models.arm.holding import HeldArm, HoldKind, Rest, equilibrium, hold_arm
from jointscope.sim.arm.plan import ELBOW, JOINT
from jointscope.sim.concealed.arm_bench import ArmBench, draw_arm_bench
from jointscope.sim.concealed.arm_laws import ArmEffect, FallingFriction, set_up, with_elements


def bench() -> ArmBench:
    return draw_arm_bench(np.random.default_rng(3))


def effect(name: str, place: str, law: str, **values: float) -> ArmEffect:
    return ArmEffect(effect=name, location=place, joint=JOINT, law=law, values=values)


def held_with(case: ArmBench, *effects: ArmEffect, kind: HoldKind = "brake") -> tuple[HeldArm, Rest]:
    arm = with_elements(build_arm(case.truth), effects)
    hold: dict[str, HoldKind] = dict.fromkeys(arm.rotors, kind)
    held = hold_arm(arm, hold, case.posture, timestep=2e-4)
    rest = equilibrium(held, case.posture)
    set_up(held, rest, effects)
    return held, rest


@pytest.mark.parametrize("concealed", [
    (), (effect("backlash", "transmission", "dead-band", gap=5e-4),),
    (effect("stiffness-nonlinearity", "transmission", "polynomial", cubic=1e10),),
])  # fmt: skip
def test_the_arm_rests_where_it_is_put(concealed: tuple[ArmEffect, ...]) -> None:
    held, rest = held_with(bench(), *concealed)
    still = step_arm(held, rest, np.zeros((500, held.model.nu)))
    assert float(np.max(np.abs(still.position - rest.qpos))) < 1e-7


def test_play_turns_by_the_gap_before_the_other_flank_bears() -> None:
    case, gap = bench(), 2e-3
    held, rest = held_with(case, effect("backlash", "transmission", "dead-band", gap=gap))
    plain, _ = held_with(case)
    k = held.arm.index(JOINT)
    dof = int(held.reducer[k])
    push = 4.0 * float(rest.torque[k])  # against the weight: the other flank then carries three times it

    def pushed(arm: HeldArm) -> float:
        import mujoco

        data = mujoco.MjData(arm.model)
        data.qpos[:] = rest.qpos
        arm.model.dof_damping[dof] = 1000.0
        data.qfrc_applied[dof] = push
        for _ in range(8000):
            mujoco.mj_step(arm.model, data)
        return float(data.qpos[arm.model.jnt_qposadr[arm.model.dof_jntid[dof]]] - rest.qpos[dof])

    assert abs(pushed(held) - pushed(plain)) == pytest.approx(gap, rel=0.05)


def test_falling_friction_falls_from_breakaway_to_sliding() -> None:
    class State:
        qvel = np.zeros(1)
        qfrc_applied = np.zeros(1)

    law, state = FallingFriction(0, torque=10.0, breakaway=20.0, speed=0.1, width=1e-6), State()
    state.qvel[0] = 1e-3
    law(state)  # type: ignore[arg-type]
    assert state.qfrc_applied[0] == pytest.approx(-20.0, rel=1e-3)
    state.qvel[0] = -10.0
    law(state)  # type: ignore[arg-type]
    assert state.qfrc_applied[0] == pytest.approx(10.0, rel=1e-3)


def test_a_hidden_joint_is_rigid_to_the_lab_and_gives_in_truth() -> None:
    case = draw_arm_bench(np.random.default_rng(5), hidden=ELBOW)
    assert ELBOW in {row.name for row in case.truth.joints}
    assert ELBOW not in {row.name for row in case.lab.joints}
    assert ELBOW not in build_arm(case.lab).rotors


def test_what_the_lab_knows_is_exact_where_it_must_be() -> None:
    case = bench()
    assert case.lab.mass_scale == case.truth.mass_scale and case.lab.payload == case.truth.payload
    for row in case.lab.joints:
        true = case.truth.joint(row.name)
        assert row.reflected_inertia == true.reflected_inertia
        assert 0.7 < row.stiffness / true.stiffness < 1.4
