"""Which share of the drive's law a closed-loop prediction should take: measured on MuJoCo's truth in nine situations.

``python -m jointscope.experiments.single_joint.closed_loop`` prints the table of
docs/decisions/2026-11-21-closed-loop-prediction.md: error of the arm's acceleration (RMS of the difference over RMS
recorded) on a 120 degree motion, for the log replayed open loop (0), shares of the law up to the law alone (1), and
the share that ``law_share`` chooses from the drive's identification.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.identification.drive import identify_drive
from jointscope.identification.model_file import BaseModel, joint_values
from jointscope.models.paper import paper_rig
from jointscope.models.parameters import Rig
from jointscope.models.rig import rig_spec
from jointscope.prediction.base_model import predict_run
from jointscope.prediction.closed_loop import law_share
from jointscope.prediction.scores import contract_error
from jointscope.recordings.campaign import Campaign, Run
from jointscope.sim.bench import set_up, take
from jointscope.sim.chain import Chain
from jointscope.sim.drive import SpeedDrive, speed_loop
from jointscope.sim.excitation import ThereAndBack
from jointscope.sim.physics import BASE, Physics
from jointscope.sim.plan import SingleJointPlan
from jointscope.sim.recording import daq_stream, plc_stream
from jointscope.sim.single_joint import nameplate
from jointscope.sim.stepping import TIMESTEP, Controller, ForceLaw, grid

Real = NDArray[np.float64]
Disturb = Callable[[Controller], Controller]

SHARES = (0.0, 0.1, 0.3, 0.9, 1.0)
DURATION = 5.3  # s


def _as_it_is(control: Controller) -> Controller:
    return control


@dataclass(frozen=True, kw_only=True)
class Situation:
    """What differs between the machine and what the prediction knows of it.

    Attributes:
        name: In the table.
        physics: What the machine has beyond the base model.
        disturb: What the drive does beyond its PI law; its torque is logged all the same.
        joint: Values that the model has wrong.
        efficiency: Of the machine, where the nameplate says 0.7.
    """

    name: str
    physics: Physics = BASE
    disturb: Disturb = _as_it_is
    joint: Mapping[str, float] = field(default_factory=dict)
    efficiency: float = 0.7


def _offset(by: float) -> Physics:
    def sensed(trace):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
        return replace(trace, inputs={**trace.inputs, "motor": trace.inputs["motor"] + by})

    return Physics(sensed=sensed)


def _friction(level: float) -> Physics:
    def law(model: mujoco.MjModel) -> ForceLaw:
        motor = int(model.joint("motor").dofadr[0])

        def force(t: float, q: Real, qd: Real) -> Real:
            out = np.zeros(model.nv)
            out[motor] = -level * math.tanh(float(qd[motor]) / 0.01)
            return out

        return force

    return Physics(law=law)


def _added(torque: Callable[[float], float]) -> Disturb:
    return lambda control: lambda t, motor_angle: control(t, motor_angle) + torque(t)


def _lagged(time_constant: float) -> Disturb:
    def disturb(control: Controller) -> Controller:
        state: dict[str, float] = {}

        def lagging(t: float, motor_angle: float) -> float:
            asked = control(t, motor_angle)
            step = t - state.get("t", t)
            held = state.get("torque", asked)
            state["torque"] = held + (asked - held) * (1.0 - math.exp(-step / time_constant))
            state["t"] = t
            return state["torque"]

        return lagging

    return disturb


def _random(rms: float, seed: int) -> Callable[[float], float]:
    """Sum of sines of random phase, 5-60 Hz."""
    rng = np.random.default_rng(seed)
    f, phase = rng.uniform(5.0, 60.0, 60), rng.uniform(0.0, 2.0 * np.pi, 60)
    return lambda t: rms * math.sqrt(2.0 / 60.0) * float(np.sum(np.sin(2.0 * np.pi * f * t + phase)))


def situations(rig: Rig) -> tuple[Situation, ...]:
    """Nine of them; the first five within what the law explains, the rest beyond it."""
    joint = rig.joint
    wrong = {"stiffness": 0.98 * joint.stiffness, "load_inertia": 1.02 * joint.load_inertia, "motor_damping": 3.0}
    ripple = _added(lambda t: 0.05 * math.sin(2.0 * math.pi * 30.0 * t) if t > 0.1 else 0.0)
    return (
        Situation(name="the log's noise only, 2 mN m"),
        Situation(name="log off by 2.4 mN m", physics=_offset(2.4e-3)),
        Situation(name="K, J_L, b_m wrong: -2 %, +2 %, +50 %", joint=wrong),
        Situation(name="efficiency 3 % off", efficiency=0.721),
        Situation(name="Coulomb friction 15 N m", physics=_friction(15.0)),
        Situation(name="drive lags 3 ms", disturb=_lagged(3e-3)),
        Situation(name="drive adds 50 mN m at 30 Hz", disturb=ripple),
        Situation(name="drive adds 50 mN m rms, 5-60 Hz", disturb=_added(_random(0.05, 5))),
        Situation(name="the same and the friction", disturb=_added(_random(0.05, 5)), physics=_friction(15.0)),
    )


def record(rig: Rig, situation: Situation, seed: int) -> Campaign:
    """One 120 degree motion under speed control."""
    truth = replace(rig, joint=replace(rig.joint, efficiency=situation.efficiency))
    setup = set_up(rig_spec(truth), 0.0, TIMESTEP, physics=situation.physics)
    chain, n = Chain(), rig.joint.reduction_ratio
    path = ThereAndBack(start=0.1, duration=4.8, travel=2.0 * math.pi / 3.0)
    control = speed_loop(
        SpeedDrive(),
        lambda t: n * path.speed(t),
        reduction_ratio=n,
        motor_angle=setup.motor_angle,
        holding_torque=setup.holding_torque,
    )
    steps = len(grid(DURATION + chain.reach(TIMESTEP), TIMESTEP))
    trace = situation.physics.sensed(take(setup, {}, steps, controller=situation.disturb(control)))
    rng = np.random.default_rng(seed)
    streams = (
        daq_stream("motion", trace, rig, chain, DURATION, rng),
        plc_stream("motion", trace, rig, chain, DURATION, rng, speed_command=path.speed),
    )
    run = Run(id="motion", experiment="speed-motion", streams=streams)
    return Campaign(path=Path("simulated"), rig=nameplate(rig, SingleJointPlan()), runs=(run,))


def measure(rig: Rig, situation: Situation, seed: int) -> tuple[float, dict[float, float]]:
    """The share that is chosen, and the acceleration's error by share (the chosen one included)."""
    campaign = record(rig, situation, seed)
    joint = rig.joint
    known = {name: getattr(joint, name) for name in ("stiffness", "damping", "load_inertia")}
    model = BaseModel(rig=campaign.rig, joint=joint_values(campaign.rig, **{**known, **situation.joint}))
    drive = identify_drive(campaign)
    assert drive is not None
    chosen = law_share(drive)
    errors = {}
    for share in sorted({*SHARES, chosen}):
        channel = predict_run(model, campaign.runs[0], drive=drive, share=share).channels[0]
        errors[share] = contract_error(channel.signal.samples, channel.values, "linear-acceleration")
    return chosen, errors


def main() -> None:
    """Print the table."""
    rig = paper_rig()
    print("| situation | " + " | ".join(f"alpha {share:g}" for share in SHARES) + " | chosen alpha | its error |")
    print("|---|" + "---|" * (len(SHARES) + 2))
    for situation in situations(rig):
        chosen, errors = measure(rig, situation, seed=1)
        cells = " | ".join(f"{errors[share]:.4f}" for share in SHARES)
        print(f"| {situation.name} | {cells} | {chosen:.2f} | {errors[chosen]:.4f} |", flush=True)


if __name__ == "__main__":
    main()
