"""A planar arm of two elastic joints, stepped by MuJoCo: what the reduced model is compared with."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.arm.predict import predict_outputs
from jointscope.diagnosis.arm.problem import ArmProblem
from jointscope.diagnosis.effects.spec import ActiveEffect
from jointscope.models.arm.build import ElasticArm, read_arm
from jointscope.models.arm.forward import Trajectory, step_arm
from jointscope.models.arm.holding import HAMMER, HeldArm, HoldKind, Probe, Rest, equilibrium, hold_arm
from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream

Real = NDArray[np.float64]

MJCF = """<mujoco><option gravity="0 0 -9.80665"/><worldbody>
<body name="upper"><joint name="a" axis="0 1 0" armature="12" damping="2"/>
<joint name="a_elastic" axis="0 1 0" stiffness="40000" damping="40"/>
<inertial pos="0 0 0.25" mass="12" diaginertia="0.3 0.3 0.05"/>
<body name="fore" pos="0 0 0.5"><joint name="b" axis="0 1 0" armature="5" damping="1"/>
<joint name="b_elastic" axis="0 1 0" stiffness="9000" damping="8"/>
<inertial pos="0 0 0.2" mass="5" diaginertia="0.08 0.08 0.01"/></body></body></worldbody>
<custom><numeric name="a_reduction_ratio" data="100"/><numeric name="b_reduction_ratio" data="100"/></custom>
<actuator><general name="a_drive" joint="a" gainprm="60000" biastype="affine" biasprm="0 -60000 -2000"/>
<general name="b_drive" joint="b" gainprm="20000" biastype="affine" biasprm="0 -20000 -800"/></actuator></mujoco>"""
POSTURE = {"a": 0.4, "b": 0.7}
HIT = Probe(name="hit", body="fore", point=(0.0, 0.0, 0.3), axis=(1.0, 0.0, 0.0))
ACC_A = Probe(name="acc_a", body="upper", point=(0.0, 0.0, 0.45), axis=(1.0, 0.0, 0.0))
ACC_B = Probe(name="acc_b", body="fore", point=(0.0, 0.0, 0.3), axis=(1.0, 0.0, 0.0))
STEP = 1e-4


def planar_arm(folder: Path, mjcf: str = MJCF) -> ElasticArm:
    """The arm, its file written into ``folder``."""
    (folder / "arm.xml").write_text(mjcf, encoding="utf-8")
    return read_arm(folder / "arm.xml")


def pulse(times: Real, peak: float = 150.0, start: float = 0.05, width: float = 0.008) -> Real:
    """A half-sine contact squared [N], shape of ``times``."""
    t = np.clip((times - start) / width, 0.0, 1.0)
    return np.asarray(peak * np.sin(np.pi * t) ** 2)


def stepped(
    arm: ElasticArm, hold: Mapping[str, HoldKind], duration: float, *, torque: Real | None = None
) -> tuple[Real, Trajectory, HeldArm, Rest]:
    """MuJoCo's motion under the pulse, or under ``torque`` [N m on rotor a] added to its drive."""
    driven = [] if torque is None else ["a"]
    held = hold_arm(
        arm,
        hold,
        POSTURE,
        timestep=STEP,
        driven=driven,
        probes=[ACC_A, ACC_B],
        hammer=HIT if torque is None else None,
    )
    rest = equilibrium(held, POSTURE)
    times = np.arange(round(duration / STEP)) * STEP
    commands = np.zeros((times.size, held.model.nu))
    for k, name in enumerate(arm.rotors):
        if hold[name] == "drive":
            kp = held.model.actuator_gainprm[held.actuator(name + "_drive"), 0]
            commands[:, held.actuator(name + "_drive")] = rest.rotor[k] + rest.torque[k] / kp
    if torque is None:
        commands[:, held.actuator(HAMMER)] = pulse(times)
    else:
        commands[:, held.actuator("a_torque")] = torque
    return times, step_arm(held, rest, commands), held, rest


def swept(folder: Path) -> Campaign:
    """A torque sweep of rotor a, the drives holding."""
    hold: dict[str, HoldKind] = {"a": "drive", "b": "drive"}
    times = np.arange(round(1.5 / STEP)) * STEP
    fade = np.clip(np.minimum(times - 0.2, 1.3 - times) / 0.1, 0.0, 1.0)
    torque = 60.0 * fade * np.sin(2.0 * np.pi * (5.0 + 20.0 * times) * times)
    _, trajectory, _, _ = stepped(planar_arm(folder), hold, 1.5, torque=torque)
    return campaign_of(folder, (driven_run(times, trajectory, hold, np.zeros_like(times), "torque-sweep"),))


def channel(
    column: str, quantity: str, unit: str, role: str, samples: Real, probe: Probe | None, joint: str
) -> Channel:
    """A channel on the arm, or of joint's motor where ``probe`` is ``None``."""
    return Channel(
        column=column, quantity=quantity, unit=unit, location="motor" if probe is None else "arm", role=role,  # type: ignore[arg-type]
        samples=np.array(samples), joint=joint, body=probe and probe.body, point=probe and probe.point,
        axis=probe and probe.axis,
    )  # fmt: skip


def campaign_of(folder: Path, runs: tuple[Run, ...]) -> Campaign:
    """A campaign around ``runs`` whose model is the file in ``folder``."""
    plate = Nameplate(topology="arm", motion="rotational")
    return Campaign(path=folder, rig=plate, runs=runs, mjcf="arm.xml", joints=("a", "b"))


def hit_run(times: Real, trajectory: Trajectory, hold: Mapping[str, HoldKind], every: int = 5) -> Run:
    """The hit as recorded without any error, every fifth step."""
    force = pulse(times)[::every]
    rows = [channel("force", "force", "N", "input", force, HIT, "b")]
    for probe in (ACC_A, ACC_B):
        rows.append(
            channel(probe.name, "linear-acceleration", "m/s^2", "output",
                    trajectory.accelerometer(probe.name)[::every], probe, "a")
        )  # fmt: skip
    stream = Stream(file="h.npz", sampling_rate=1.0 / (every * STEP), length=force.size, channels=tuple(rows))
    return Run(
        id="h", experiment="hammer", streams=(stream,), brake=True, joint="a", posture=POSTURE, hold=dict(hold)
    )


def driven_run(
    times: Real, trajectory: Trajectory, hold: Mapping[str, HoldKind], command: Real, kind: str, every: int = 5
) -> Run:
    """A sweep or motion of joint a as recorded without any error."""
    n = trajectory.held.arm.reduction_ratio("a")
    torque = (trajectory.force("a_drive") + trajectory.force("a_torque")) / n
    rows = [
        channel("t", "torque", "N m", "input", torque[::every], None, "a"),
        channel("w", "speed-command", "rad/s", "input", n * command[::every], None, "a"),
        channel("angle", "angle", "rad", "output", n * trajectory.rotor("a")[::every], None, "a"),
    ]
    for probe in (ACC_A, ACC_B):
        rows.append(
            channel(probe.name, "linear-acceleration", "m/s^2", "output",
                    trajectory.accelerometer(probe.name)[::every], probe, "a")
        )  # fmt: skip
    length = torque[::every].size
    stream = Stream(file="d.npz", sampling_rate=1.0 / (every * STEP), length=length, channels=tuple(rows))
    return Run(id="d", experiment=kind, streams=(stream,), joint="a", posture=POSTURE, hold=dict(hold))  # type: ignore[arg-type]


def misfit(problem: ArmProblem, theta: Real, effects: tuple[ActiveEffect, ...] = ()) -> list[float]:
    """RMS error over RMS signal of every output of the first run."""
    run = problem.runs[0]
    predicted = predict_outputs(run, theta, effects, problem)
    return [
        float(np.std((o.data - y)[o.mask]) / np.std(o.data[o.mask]))
        for o, y in zip(run.outputs, predicted, strict=True)
    ]
