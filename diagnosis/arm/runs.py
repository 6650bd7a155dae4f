"""One run of an arm made ready: its posture tabled, its inputs on the grid, its channels as outputs."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp

from jointscope.diagnosis.arm import kernel
from jointscope.diagnosis.arm.geometry import ArmFacts
from jointscope.diagnosis.arm.plant import arm_plant
from jointscope.diagnosis.arm.problem import ArmRun
from jointscope.diagnosis.contact import contact_only
from jointscope.diagnosis.inputs import Drive, motor_torque, speed_command, without_noise
from jointscope.diagnosis.problem import Output
from jointscope.errors import RefusedError
from jointscope.models.arm.holding import Probe
from jointscope.models.arm.reference import loaded
from jointscope.models.arm.table import Payload
from jointscope.prediction.currents import torque_from_currents
from jointscope.recordings.bandlimited import bandlimited
from jointscope.recordings.campaign import Nameplate, Run, Signal

Vector = NDArray[np.float64]

GRID = 4000.0  # Hz, at least, of small motion
GRID_FAR = 2000.0  # Hz, the same of sweeps, whose band ends lower, and of motion along a path
QUIET = 2e-3  # of a hit's peak, below which the ringing is over
LAST = 0.3  # s kept after that
PATH_BAND = (
    0.4  # of the log's rate, kept of the recorded angle: what the tie's path lacks of the motion, the tie damps
)
FAR = 0.01  # rad of travel from which a joint's path is tabled
EDGE = 12  # samples at either end of a record that are not scored: the recorder's filter has no other half there
STILL = 0.05  # s at the start that belong to rest


def arm_run(run: Run, rig: Nameplate, facts: ArmFacts, index: int) -> tuple[ArmRun, tuple[str, ...]] | None:
    """Prepare ``run``; ``None`` where it holds no input or no output that an arm's model has.

    Raises:
        RefusedError: A channel or the run itself names no place on the arm.
    """
    if run.joint is None:
        raise RefusedError(f"run {run.id}: says no joint; an arm's run needs to know which one moves or is hit")
    joint = facts.index(run.joint)
    kinds, locked, notes = _holds(run, facts, joint)
    own = _of_joint(run, run.joint)
    force = _hammer(own)
    torque = None if kinds[joint] in (kernel.BRAKED,) else _torque(own, rig, facts, joint)
    if force is None and torque is None:
        return None
    accelerations, angle = _outputs(own)
    if not accelerations and angle is None:
        return None
    if torque is not None:
        kinds[joint] = kernel.DRIVEN
    t0, rate, steps = _grid(own, GRID if torque is None else GRID_FAR)
    if force is not None and torque is None:
        steps = min(steps, round((_rung_down(accelerations, force[0]) - t0) * rate))
    half = t0 + np.arange(2 * steps + 1) / (2.0 * rate)
    n = float(facts.ratio[joint])
    path, path_rate = _recorded_path(angle, half, n)
    command = speed_command(own, replace(rig, reduction_ratio=n)) if torque is not None else None
    commanded, commanded_rate = _commanded(command, half)
    if angle is None:
        path, path_rate = commanded, commanded_rate
    travel = (min(0.0, float(path.min())), max(0.0, float(path.max())))
    far = travel[1] - travel[0] > FAR and torque is not None
    reference = facts.mounted
    if run.payload_mass:
        com = run.payload_com or (0.0, 0.0, 0.0)
        reference = loaded(reference, 1.0, Payload(mass=run.payload_mass, com=com))
    probes = [_probe(facts, s) for s in accelerations]
    hit = None if force is None else _probe(facts, force[1])
    plant = arm_plant(
        reference, run.posture, probes, hit, joint if far else -1, (travel[0] - 0.05, travel[1] + 0.05)
    )
    end = t0 + steps / rate
    levers = np.abs(plant.motion[0, :, joint])
    outputs = [_acceleration(s, end, float(r)) for s, r in zip(accelerations, levers, strict=True)] + (
        [] if angle is None else [_angle(angle)]
    )
    zeros = np.zeros(2 * steps + 1)
    mode: Literal["braked", "observer"] = "braked" if torque is None else "observer"
    load = None if force is None else force[0]
    prepared = ArmRun(
        run=run, index=index, group=run.repeat_of or run.id, role=run.role, mode=mode,
        motor_moves=bool(np.any(kinds != kernel.BRAKED)), spring=True, ratio=n, t0=t0, grid_rate=rate, steps=steps,
        load_half=zeros if load is None else load.signal(half),
        motor_half=zeros if torque is None else facts.efficiency * torque.signal(half),
        command_half=zeros if command is None else command.signal(half),
        observed_half=path, command_rate_half=zeros, load=load, motor=torque, command=command, observed=None,
        late_motor=torque is not None and torque.device != 0, late_observed=angle is not None and angle.device != 0,
        late_command=command is not None and command.device != 0, torque_factor=n,
        initial_angle=float(run.posture.get(run.joint, 0.0)), initial_speed=0.0,
        motor_zero=0.0, outputs=tuple(outputs), declared=tuple(outputs),
        plant=plant, kinds=kinds, locked=locked, driven=joint if torque is not None else -1, path=path,
        path_rate=path_rate, commanded=commanded, commanded_rate=commanded_rate,
        tie=float(facts.rotor_inertia[joint] + plant.mass[0, joint, joint]),
        probes=(*range(len(accelerations)), *(() if angle is None else (-1,))), sensors=tuple(map(_seat, probes)),
    )  # fmt: skip
    return prepared, notes


def _holds(run: Run, facts: ArmFacts, joint: int) -> tuple[NDArray[np.int64], NDArray[np.bool_], tuple[str, ...]]:
    """How each rotor is held; joints on which the run is silent are braked."""
    n = len(facts.joints)
    kinds, locked, notes = np.full(n, kernel.BRAKED, dtype=np.int64), np.zeros(n, dtype=bool), []
    table = {"drive": kernel.HELD, "free": kernel.FREE}
    for name, how in run.hold.items():
        j = facts.index(name) if name else joint
        kinds[j] = table.get(how, kernel.BRAKED)
        locked[j] = how == "locked"
        if how == "brake-with-play":
            notes.append(f"run {run.id}: the brake's play at {facts.joints[j]} is taken as none")
    if run.joint not in run.hold and "" not in run.hold:
        kinds[joint] = kernel.BRAKED if run.brake else kernel.FREE
    return kinds, locked, tuple(notes)


def _of_joint(run: Run, joint: str) -> Run:
    """The run without the motor channels of other joints."""

    def kept(channel: object) -> bool:
        location, named = getattr(channel, "location"), getattr(channel, "joint")  # noqa: B009
        return location != "motor" or named in (None, joint)

    streams = tuple(replace(s, channels=tuple(c for c in s.channels if kept(c))) for s in run.streams)
    return replace(run, streams=streams)


def _hammer(run: Run) -> tuple[Drive, Signal] | None:
    found = [s for s in run.select("force", role="input") if s.channel.location in ("arm", "neighbour")]
    if not found:
        return None
    s = found[0]
    samples = np.asarray(s.samples, dtype=np.float64)
    if run.experiment == "hammer":
        samples = contact_only(samples, s.sampling_rate)
    signal = bandlimited(samples, s.sampling_rate, s.stream.start)
    return Drive(signal, s.device, 1.0, s.channel.calibrated, samples), s


def _torque(run: Run, rig: Nameplate, facts: ArmFacts, joint: int) -> Drive | None:
    """n T_e [N m] of the joint that moves."""
    plate = replace(rig, reduction_ratio=float(facts.ratio[joint]))
    found = motor_torque(run, plate)
    if found is not None:
        return without_noise(found)
    if not run.select("phase-current"):
        return None
    holding = float(facts.reference.gravity(run.posture)[joint]) / float(facts.ratio[joint])
    signed = torque_from_currents(run, plate, holding, run.joint)
    samples = signed.values * float(facts.ratio[joint])
    signal = bandlimited(samples, signed.rate, float(signed.times[0]))
    device = run.select("phase-current")[0].device
    return without_noise(Drive(signal, device, float(facts.ratio[joint]), True, samples))


def _outputs(run: Run) -> tuple[list[Signal], Signal | None]:
    accelerations = [
        s for s in run.select("linear-acceleration", role="output") if s.channel.location in ("arm", "neighbour")
    ]
    turning = [
        s for kind in ("angle", "angular-velocity") for s in run.select(kind, location="motor", role="output")
    ]
    return accelerations, turning[0] if turning and not run.brake else None


def _probe(facts: ArmFacts, signal: Signal) -> Probe:
    """Where a force or an accelerometer sits.

    Raises:
        RefusedError: The channel names neither a site of the model nor a body, point and axis.
    """
    c = signal.channel
    if c.body is not None and c.point is not None and c.axis is not None:
        return Probe(name=c.column, body=c.body, point=c.point, axis=c.axis)
    site = None if c.site is None else facts.spec.site(c.site)
    if site is not None:
        import mujoco

        turned = np.zeros(3)
        mujoco.mju_rotVecQuat(turned, np.asarray(c.axis or (0.0, 0.0, 1.0)), np.asarray(site.quat))
        x, y, z = (float(v) for v in site.pos)
        a, b, d = (float(v) for v in turned)
        return Probe(name=c.column, body=site.parent.name, point=(x, y, z), axis=(a, b, d))
    raise RefusedError(
        f"{signal.stream.file}: {c.column}: needs body, point and axis on the arm, or a site of its model"
    )


def _seat(probe: Probe) -> str:
    x, y, z = probe.point
    return f"{probe.body} at ({x:.4g}, {y:.4g}, {z:.4g}) m"


def _grid(run: Run, least: float) -> tuple[float, float, int]:
    recorded = [s for s in run.signals if s.channel.samples is not None and s.channel.role == "output"]
    start = min(s.stream.start for s in recorded)
    end = max(float(s.times[-1]) for s in recorded)
    accelerometers = [s.sampling_rate for s in recorded if s.channel.quantity == "linear-acceleration"]
    fastest = max(accelerometers or [s.sampling_rate for s in recorded])
    rate = fastest * max(1, math.ceil(least / fastest))
    return start, rate, math.ceil((end - start) * rate)


def _rung_down(accelerations: list[Signal], force: Drive) -> float:
    """When a hit's response has sunk to ``QUIET`` of its peak or into the record's own noise [s]."""
    latest = 0.0
    for s in accelerations:
        x = np.asarray(s.samples, dtype=np.float64)
        window = max(4, round(0.05 * s.sampling_rate))
        level = np.sqrt(np.convolve(np.square(x - np.median(x)), np.full(window, 1.0 / window), mode="same"))
        noise = float(np.median(level[-max(window, len(x) // 10) :]))
        loud = np.flatnonzero(level > max(QUIET * float(level.max()), 1.5 * noise))
        latest = max(latest, float(s.times[loud[-1]]) if loud.size else 0.0)
    peak = float(np.argmax(np.abs(force.samples))) / force.signal.rate + force.signal.start
    return max(latest, peak + 0.5) + LAST


def _recorded_path(angle: Signal | None, half: Vector, ratio: float) -> tuple[Vector, Vector]:
    if angle is None:
        return np.zeros_like(half), np.zeros_like(half)
    samples = (np.asarray(angle.samples, dtype=np.float64) - _rest(angle)) / ratio
    cut = dsp.butter(4, PATH_BAND * angle.sampling_rate, fs=angle.sampling_rate, output="sos")
    slow = dsp.sosfiltfilt(cut, samples)
    curve = bandlimited(slow, angle.sampling_rate, angle.stream.start)
    if angle.channel.quantity == "angular-velocity":
        return _travelled(curve(half), half)
    return curve(half), curve(half, 1)


def _rest(angle: Signal) -> float:
    """Mean of what was recorded before anything moves."""
    return float(np.mean(angle.samples[: max(4, round(STILL * angle.sampling_rate))]))


def _commanded(command: Drive | None, half: Vector) -> tuple[Vector, Vector]:
    if command is None:
        return np.zeros_like(half), np.zeros_like(half)
    return _travelled(command.signal(half), half)


def _travelled(speed: Vector, half: Vector) -> tuple[Vector, Vector]:
    """The angle that a speed turns through from the start [rad], and the speed."""
    step = float(half[1] - half[0])
    return np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))]) * step, speed


def _channel_place(signal: Signal) -> tuple[int, int]:
    return signal.device, next(i for i, c in enumerate(signal.stream.channels) if c is signal.channel)


def _scored(signal: Signal) -> NDArray[np.bool_]:
    mask = np.isfinite(np.asarray(signal.samples))
    mask[:EDGE] = False
    mask[-EDGE:] = False
    return mask


def _acceleration(signal: Signal, end: float, lever: float) -> Output:
    """A reading of the arm; ``lever``: how far it moves per turn of the joint [m/rad], by which sensors are told apart."""
    c = signal.channel
    data = np.asarray(signal.samples, dtype=np.float64)
    return Output(
        quantity=c.quantity, location=c.location, device=signal.device, late=False, rate=signal.sampling_rate,
        times=signal.times, data=data, mask=_scored(signal) & (signal.times < end - EDGE / signal.sampling_rate),
        radius=c.radius or round(lever, 4),
        low_cutoff=(c.low_cutoff or None) if c.coupling == "ac" else None, full_scale=c.full_scale,
        channel=_channel_place(signal),
    )  # fmt: skip


def _angle(signal: Signal) -> Output:
    """The motor's angle from its rest [rad], or its speed [rad/s], on the shaft."""
    rest, quantity = _rest(signal), signal.channel.quantity
    return Output(
        quantity=quantity, location="motor", device=signal.device, late=signal.device != 0, rate=signal.sampling_rate,
        times=signal.times, data=np.asarray(signal.samples, dtype=np.float64) - rest, mask=_scored(signal),
        offset=rest, observed=True, channel=_channel_place(signal),
    )  # fmt: skip
