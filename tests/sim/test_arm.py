"""The simulated arm: rest, response, bookkeeping of torque, and campaigns that survive the disk."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.errors import JointscopeError
from jointscope.models.arm.build import build_arm
from jointscope.models.arm.forward import step_arm
from jointscope.models.arm.holding import HAMMER, equilibrium, hold_arm
from jointscope.models.arm.linear import joint_values, linear_arm
from jointscope.models.arm.reference import arm_reference
from jointscope.sim.arm.campaign import arm_campaign, simulate_arm, write_arm_campaign
from jointscope.sim.arm.plan import (
    HIT_UPPER_ARM,
    JOINT,
    UPPER_ARM,
    ArmMotion,
    ArmPlan,
    ArmSweep,
    HammerSpot,
    six_axis_table,
)
from jointscope.sim.plan import HammerPlan

SHORT = HammerPlan(hits=2, levels=(50.0,), duration=1.0, double_hit_probability=0.0)


@pytest.fixture(scope="module")
def arm():
    return build_arm(six_axis_table())


@pytest.fixture(scope="module")
def plan():
    return ArmPlan(
        spots=(HammerSpot(hammer=SHORT),),
        sweep=ArmSweep(levels=(0.3,), sweep_time=1.0, lead=0.2, trail=0.2),
        motion=ArmMotion(travels=(-0.5,), motion_time=1.0, lead=0.2, trail=0.2),
    )


@pytest.fixture(scope="module")
def recordings(plan):
    return list(simulate_arm(plan, np.random.default_rng(0)))


def test_an_arm_at_rest_stays_at_rest(arm):
    posture = six_axis_table().posture
    held = hold_arm(arm, {}, posture, probes=[UPPER_ARM.probe], hammer=HIT_UPPER_ARM)
    trajectory = step_arm(held, equilibrium(held, posture), np.zeros((500, 1)))
    assert np.ptp(trajectory.link(JOINT)) < 1e-12
    assert np.ptp(trajectory.accelerometer(UPPER_ARM.probe.name)) < 1e-9


def test_a_small_hit_is_answered_as_linear_theory_says(arm):
    posture = six_axis_table().posture
    held = hold_arm(arm, {}, posture, probes=[UPPER_ARM.probe], hammer=HIT_UPPER_ARM)
    n, h = 40_000, held.model.opt.timestep
    force = np.zeros((n, 1))
    force[:70, held.actuator(HAMMER)] = 2.0 * np.sin(np.pi * np.arange(70) / 70.0) ** 2
    felt = step_arm(held, equilibrium(held, posture), force).accelerometer(UPPER_ARM.probe.name)
    decay = np.exp(-4.0 * np.arange(n) * h)  # the record then ends in silence; the response moves to s + 4/s
    output, drive = np.fft.rfft((felt - felt[0]) * decay), np.fft.rfft(force[:, 0] * decay)
    line = slice(20, 400)  # 5 to 100 Hz
    s = 4.0 + 2j * np.pi * np.fft.rfftfreq(n, h)[line]
    reference = arm_reference(arm)
    linear = linear_arm(reference, posture, joint_values(arm), {})
    motion, tilt = reference.rows(posture, UPPER_ARM.probe)
    exact = linear.accelerance(s, reference.rows(posture, HIT_UPPER_ARM)[0], motion, tilt)
    ratio = (output / drive)[line] / exact
    assert np.median(np.abs(ratio - 1.0)) < 1e-3
    assert np.max(np.abs(ratio - 1.0)) < 5e-3  # the antiresonance at 25 Hz included


def test_torque_at_rest_is_gravity_over_the_ratio(arm, recordings):
    driven = recordings[-1]
    holding = arm_reference(arm).gravity(driven.take.posture)[arm.index(JOINT)]
    assert driven.take.torque[0] * 141.0 == pytest.approx(holding, rel=1e-6)


def test_torque_of_the_drive_moves_the_rotor_as_newton_says(arm, recordings):
    """n T_e = J_M q_s'' + b_m q_s' + T_S on every step of the sweep."""
    take = next(r.take for r in recordings if r.run.experiment == "torque-sweep")
    trajectory = take.trajectory
    k = arm.index(JOINT)
    values = joint_values(arm)
    rotor, reducer = int(trajectory.held.rotor[k]), int(trajectory.held.reducer[k])
    windup, rate = trajectory.position[:, reducer], trajectory.velocity[:, reducer]
    spring = -values.stiffness[k] * windup - values.damping[k] * rate
    balance = (
        values.rotor_inertia[k] * trajectory.acceleration[:, rotor]
        + values.rotor_damping[k] * trajectory.velocity[:, rotor]
        + spring
    )
    assert np.max(np.abs(balance - 141.0 * take.torque)) < 1e-6 * np.max(np.abs(141.0 * take.torque))


def test_only_joint_two_moves(recordings):
    trajectory = recordings[-1].take.trajectory
    moved = {name: np.ptp(trajectory.link(name)) for name in trajectory.held.arm.rotors}
    assert moved[JOINT] > 0.49
    assert all(angle < 0.01 for name, angle in moved.items() if name != JOINT)


def test_runs_say_how_each_joint_is_held(recordings):
    hammer, motion = recordings[0].run, recordings[-1].run
    assert hammer.brake
    assert set(hammer.hold.values()) == {"brake"}
    assert set(motion.hold.values()) == {"drive"}
    assert motion.arm_angle == 0.0
    assert hammer.arm_angle == pytest.approx(0.3)
    assert {s.channel.location for s in motion.select("linear-acceleration")} == {"arm", "neighbour", "base"}


def test_same_seed_same_campaign(plan, recordings):
    small = replace(plan, sweep=None, motion=None)
    first, second = (next(iter(simulate_arm(small, np.random.default_rng(0)))).run for _ in range(2))
    for one, two in zip(first.signals, second.signals, strict=True):
        assert np.array_equal(one.samples, two.samples)


def test_an_arm_campaign_survives_the_disk(tmp_path, plan, recordings):
    from jointscope.recordings.reader import read_campaign

    campaign = arm_campaign(plan, tuple(r.run for r in recordings))
    write_arm_campaign(campaign, plan, tmp_path / "campaign")
    again = read_campaign(tmp_path / "campaign")
    assert again.joints == campaign.joints
    assert again.mjcf == "arm.xml"
    assert (tmp_path / "campaign" / "arm.xml").is_file()
    for before, after in zip(campaign.runs, again.runs, strict=True):
        assert after.posture == before.posture
        assert dict(after.hold) == dict(before.hold)
        for one, two in zip(before.signals, after.signals, strict=True):
            assert two.channel.point == one.channel.point
            assert np.allclose(two.samples, one.samples, rtol=1e-12)


def test_the_campaign_does_not_hold_the_truth(plan):
    """The MJCF that goes with the recordings is the lab's, whose reducers are only rough."""
    lab, truth = joint_values(build_arm(plan.lab)), joint_values(build_arm(plan.truth))
    assert np.all(np.abs(lab.stiffness / truth.stiffness - 1.0) > 0.05)
    assert np.array_equal(lab.rotor_inertia, truth.rotor_inertia)


def test_a_braked_joint_can_not_be_driven(arm):
    with pytest.raises(JointscopeError, match="can't be driven"):
        hold_arm(arm, {JOINT: "brake"}, {}, driven=[JOINT])
    with pytest.raises(JointscopeError, match="no joint 'knee'"):
        hold_arm(arm, {"knee": "brake"}, {})
