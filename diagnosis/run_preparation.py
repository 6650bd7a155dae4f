"""One recorded run made ready: how its model is driven, what is compared, and the grid that it is simulated on."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.assembly import OBSERVER_HZ, observer_corner
from jointscope.diagnosis.channels import ACCELERATIONS, high_pass
from jointscope.diagnosis.drive_angle import DriveLaw, followed_angle
from jointscope.diagnosis.inputs import Drive, Log, load_torque, motor_torque, speed_command, without_noise
from jointscope.diagnosis.noise import dynamic_level, quantum
from jointscope.diagnosis.prescribed_path import prescribed_path, where_it_moves
from jointscope.diagnosis.problem import Mode, Observed, Output, PreparedRun
from jointscope.diagnosis.resolution import TAIL, thinned, where_resolved
from jointscope.diagnosis.turned import turned
from jointscope.models.parameters import STANDARD_GRAVITY
from jointscope.recordings.bandlimited import bandlimited, bridged
from jointscope.recordings.campaign import FORCES, Channel, Nameplate, Run, Signal, gearing

Vector = NDArray[np.float64]

GRID_HITS, GRID_OTHERS = 3000.0, 2000.0  # Hz; the simulation grid is at least this fine
GRID_ANGLES = 1000.0  # the same of a run seen by slow encoders alone: what shakes fast hardly moves an angle
DRIFT_CORNER = 2.0  # Hz; accelerations of a run that only a torque log drives are compared above it
SETTLING = 0.5  # s left out at the start of a run whose initial state is unknown
COARSE = (
    0.5  # of a signal's dynamic rms: steps of a recorder above which its error follows the signal and is no noise
)


def prepare_run(
    run: Run,
    rig: Nameplate,
    index: int,
    *,
    inputs_only: bool = False,
    log: Log | None = None,
    law: DriveLaw | None = None,
) -> PreparedRun | None:
    """One run on its grid, or ``None`` where nothing drives it or nothing was compared.

    ``log``: what its torque log and those of other runs say of themselves; ``inputs_only``: the run has no
    outputs (:func:`without_outputs`), and every declared one is foretold; ``law``: of its drive, for the angle of a motion
    that recorded none.
    """
    recorded = [s for s in run.signals if s.channel.samples is not None and s.channel.quantity != "frf"]
    load, motor, command = load_torque(run), motor_torque(run, rig), speed_command(run, rig)
    daq = _daq(run)
    held = run.motor_held
    two = rig.topology == "two-inertia"
    spring = two or rig.grounded(held=held)
    prescribed = _prescribed(recorded)
    observed = None if prescribed is not None else _observed(recorded, rig, run)
    if two and observed is None and prescribed is None and motor is not None and command is not None:
        observed = Observed("motor", True, command.signal, command.device, commanded=True)
    mode = _mode(two, held, spring, prescribed, observed, load, motor, command, run)
    if mode is None:
        return None
    motor_moves = two and mode in ("observer", "closed-loop", "torque-driven")
    if motor is not None and (motor_moves or not two):
        motor = without_noise(motor, log)
    if load is not None and run.experiment != "hammer":
        load = without_noise(load)
    if mode not in ("observer",):
        observed = None
    blind = observed is not None and observed.commanded and run.initial == "rest"
    if blind and law is not None and motor is not None and command is not None:
        observed = followed_angle(motor, command, run.arm_angle, law) or observed
    end = max((s.times[-1] for s in recorded), default=0.0)
    declared = tuple(_declared(s, rig, run, daq, end) for s in run.signals if _foretold(s))
    if mode == "braked":
        declared = tuple(_about_rest(o) for o in declared)
    outputs = () if inputs_only else _outputs(recorded, rig, run, mode, daq, observed)
    if not outputs and not inputs_only:
        return None
    t0, grid_rate, steps = _grid(recorded, outputs or declared, declared, run.experiment)
    half = t0 + np.arange(2 * steps + 1) / (2.0 * grid_rate)
    zeros = np.zeros(2 * steps + 1)
    motor_half = zeros if motor is None else motor.signal(half)
    command_half = zeros if command is None else command.signal(half)
    observed_half = zeros if observed is None else observed.signal(half)
    if prescribed is not None:
        n = gearing(prescribed.channel.quantity, prescribed.channel.location, rig.reduction_ratio or 1.0)
        observed_half, command_half, motor_half = prescribed_path(
            prescribed.samples / n, prescribed.sampling_rate, prescribed.stream.start, half
        )
        outputs = outputs if spring else where_it_moves(outputs, half, command_half, prescribed.sampling_rate)
    prepared = PreparedRun(
        run=run,
        index=index,
        group=run.repeat_of or f"#{index}",
        role=run.role,
        mode=mode,
        motor_moves=motor_moves,
        spring=spring,
        ratio=rig.reduction_ratio or 1.0,
        t0=t0,
        grid_rate=grid_rate,
        steps=steps,
        load_half=zeros if load is None else load.signal(half),
        motor_half=motor_half,
        command_half=command_half,
        observed_half=observed_half,
        command_rate_half=zeros if command is None else command.signal(half, 1),
        load=load,
        motor=motor,
        command=command,
        observed=observed,
        late_motor=motor is not None and motor.device != daq,
        late_observed=observed is not None and observed.device != daq,
        late_command=command is not None and command.device != daq,
        torque_factor=1.0 if motor is None else motor.factor,
        initial_angle=_initial_angle(run, rig, prescribed),
        initial_speed=_initial_speed(observed) if run.initial == "estimate" else 0.0,
        motor_zero=_motor_zero(recorded, rig, run),
        outputs=outputs,
        declared=declared,
    )
    corner = max(observer_corner(prepared), OBSERVER_HZ)
    return replace(prepared, outputs=tuple(replace(o, followed_to=corner) for o in outputs))


def without_outputs(run: Run) -> Run:
    """The run as if its output columns had been left out of the files."""
    streams = tuple(
        replace(
            stream,
            channels=tuple(c if c.role == "input" else replace(c, samples=None) for c in stream.channels),
        )
        for stream in run.streams
    )
    return replace(run, streams=streams)


def _foretold(signal: Signal) -> bool:
    """Whether a channel is an output that the joint's model has something to say of."""
    channel = signal.channel
    return channel.role == "output" and channel.quantity != "frf" and channel.location not in ("base", "neighbour")


def _declared(signal: Signal, rig: Nameplate, run: Run, daq: int, end: float) -> Output:
    """A channel to be foretold: its stream's samples, or as many as the inputs cover where its file has none."""
    output = _output(signal, rig, run, "braked", daq, None, run.arm_angle)
    if signal.stream.length:
        times = signal.stream.times
    else:
        count = max(2, int(np.floor((end - signal.stream.start) * signal.sampling_rate + 1e-6)) + 1)
        times = signal.stream.start + np.arange(count) / signal.sampling_rate
    if output.times.size == times.size:
        return output
    return replace(output, times=times, data=np.zeros(times.size), mask=np.zeros(times.size, dtype=np.bool_))


def _about_rest(output: Output) -> Output:
    """A held arm's angle of unknown zero counted from where it rests on average."""
    if not (output.floating and output.mask.any()):
        return output
    rest = float(np.mean(output.data[output.mask]))
    return replace(output, data=output.data - rest, offset=output.offset + rest)


def _daq(run: Run) -> int:
    """The device that samples the mechanics: the one with the accelerometers or the hammer, else the fastest."""
    for wanted in (("linear-acceleration", "angular-acceleration", "acceleration"), ("force",)):
        for signal in run.signals:
            if signal.channel.quantity in wanted and signal.channel.location != "motor":
                return signal.device
    rates = [stream.sampling_rate for stream in run.streams]
    return int(np.argmax(rates))


def _prescribed(recorded: list[Signal]) -> Signal | None:
    for signal in recorded:
        if signal.channel.role == "input" and signal.channel.quantity in ("angle", "position"):
            return signal
    return None


def _observed(recorded: list[Signal], rig: Nameplate, run: Run) -> Observed | None:
    """The angle to follow: the motor's before the arm's, angles before speeds."""
    order = (
        ("angle", "motor"), ("position", "motor"), ("angle", "arm"), ("position", "load"), ("angle", "load"),
        ("angular-velocity", "motor"), ("velocity", "motor"), ("angular-velocity", "arm"), ("velocity", "load"),
    )  # fmt: skip
    for quantity, location in order:
        for signal in recorded:
            channel = signal.channel
            if channel.role != "output" or (channel.quantity, channel.location) != (quantity, location):
                continue
            n = gearing(quantity, location, rig.reduction_ratio or 1.0)
            speed = quantity in ("angular-velocity", "velocity")
            samples = np.asarray(signal.samples, dtype=np.float64) / n
            side: Literal["motor", "arm"] = (
                "motor" if location == "motor" and rig.topology == "two-inertia" else "arm"
            )
            if not speed:
                samples = samples - _first(samples) + run.arm_angle
            elif run.initial == "rest":
                samples, speed = turned(samples, signal.sampling_rate, run.arm_angle), False
            return Observed(
                side,
                speed,
                bandlimited(samples, signal.sampling_rate, signal.stream.start),
                signal.device,
            )
    return None


def _first(samples: Vector) -> float:
    """Value at rest before the motion: the median of the first samples for as long as they do not move."""
    good = samples[np.isfinite(samples)]
    if good.size < 16:
        return float(good[0]) if good.size else 0.0
    step = np.median(np.abs(np.diff(good[:16])))
    count = 1
    while count < 16 and abs(good[count] - good[0]) <= 4.0 * step + 1e-15:
        count += 1
    return float(np.median(good[:count])) if count >= 5 else float(good[0])


def _mode(
    two: bool,
    held: bool,
    spring: bool,
    prescribed: Signal | None,
    observed: Observed | None,
    load: Drive | None,
    motor: Drive | None,
    command: Drive | None,
    run: Run,
) -> Mode | None:
    """How the model of this run is driven, or ``None`` where nothing drives it."""
    if prescribed is not None:
        return "prescribed-motor" if two and prescribed.channel.location == "motor" else "prescribed-load"
    free = run.hold.get("", "") == "free"
    if (two and held) or (not two and spring):
        return "braked" if load is not None or motor is not None else None
    if motor is None and command is None and not free:
        if load is None:
            return None
        if two and observed is None:
            return "braked"  # held by a drive of which nothing was recorded
    if two and command is not None and observed is None:
        return "closed-loop"
    if observed is not None and (motor is not None or load is not None or free):
        return "observer"
    if two and command is not None:
        return "closed-loop"
    return "torque-driven"


def _outputs(
    recorded: list[Signal], rig: Nameplate, run: Run, mode: Mode, daq: int, observed: Observed | None
) -> tuple[Output, ...]:
    """Everything that is compared in this mode."""
    outputs = []
    for signal in recorded:
        channel = signal.channel
        force = channel.quantity in FORCES
        if force:
            loop = mode == "closed-loop" and channel.location == "motor"
            inverse = mode.startswith("prescribed") and channel.role == "output"
            if not (loop or inverse):
                continue
        elif channel.role != "output" or channel.quantity in ("speed-command", "phase-current"):
            continue
        if channel.location in ("base", "neighbour"):
            continue
        if mode == "braked" and channel.location == "motor":
            continue
        if mode == "torque-driven" and channel.direction == "radial":
            continue  # weight's share in it follows the drift that nothing observes
        if run.angle_beside(signal) is not None:
            continue  # one sensor is not scored twice
        output = _output(signal, rig, run, mode, daq, observed, run.arm_angle)
        if output.observed or quantum(output) < COARSE * dynamic_level(output):
            thin = thinned(output, hits=run.experiment == "hammer")
            outputs.append(where_resolved(output, thin) if mode == "braked" else thin)
    return tuple(outputs)


def _output(
    signal: Signal, rig: Nameplate, run: Run, mode: Mode, daq: int, observed: Observed | None, angle: float
) -> Output:
    channel = signal.channel
    recorded = channel.samples is not None
    length = signal.stream.length if recorded or signal.stream.length else 0
    data = np.asarray(channel.samples, dtype=np.float64) if recorded else np.zeros(length)
    times = signal.stream.start + np.arange(data.size) / signal.sampling_rate
    mask = np.isfinite(data)
    data = bridged(data)  # what is never scored may be looked at as a whole
    angular = channel.quantity in ("angle", "position")
    followed = observed is not None and _is_observed(channel, observed, signal.device, rig)
    offset = 0.0
    if angular and recorded and data.size:
        offset = _first(data) - angle * gearing(channel.quantity, channel.location, rig.reduction_ratio or 1.0)
    if data.size > 64:
        mask[-TAIL:] = False
    if run.initial == "estimate":
        mask &= times >= (times[0] if times.size else 0.0) + SETTLING
    corner = None
    adrift = mode == "torque-driven" or (observed is not None and observed.commanded and observed.law is None)
    if adrift and channel.quantity in ACCELERATIONS:
        corner = DRIFT_CORNER
    low_cutoff = channel.low_cutoff if channel.coupling == "ac" else None
    data = data - offset
    if corner is not None and data.size:
        data = high_pass(data, corner, signal.sampling_rate)
    return Output(
        quantity=channel.quantity,
        location=channel.location,
        device=signal.device,
        late=signal.device != daq,
        rate=signal.sampling_rate,
        times=times,
        data=data,
        mask=mask,
        radius=channel.radius,
        direction=channel.direction,
        low_cutoff=low_cutoff,
        full_scale=channel.full_scale,
        gravity=gravity_at(channel, rig),
        high_pass=corner,
        offset=offset,
        calibrated=channel.calibrated,
        observed=followed,
        floating=run.initial == "estimate" and angular and not followed,
        channel=(signal.device, signal.stream.channels.index(channel)),
    )


def _is_observed(channel: Channel, observed: Observed, device: int, rig: Nameplate) -> bool:
    side = "motor" if channel.location == "motor" and rig.topology == "two-inertia" else "arm"
    speed = channel.quantity in ("angular-velocity", "velocity")
    kind = not observed.commanded and (speed or channel.quantity in ("angle", "position"))
    return kind and side == observed.side and speed == observed.rate_signal and device == observed.device


def gravity_at(channel: Channel, rig: Nameplate) -> float:
    """g that a sensor sees by what it is [m/s^2]; 0 where it does not."""
    vertical = rig.plane == "vertical" and rig.motion == "rotational"
    return STANDARD_GRAVITY if vertical and channel.quantity == "linear-acceleration" else 0.0


def _grid(
    recorded: list[Signal], outputs: tuple[Output, ...], declared: tuple[Output, ...], experiment: str
) -> tuple[float, float, int]:
    """Start [s], rate [Hz] and number of steps of the simulation grid: whole fractions of the fastest output's."""
    fastest = max(outputs, key=lambda o: o.rate)
    rate = fastest.rate
    shaken = any("acceleration" in o.quantity for o in (*outputs, *declared))
    least = GRID_HITS if experiment == "hammer" else GRID_OTHERS if shaken else GRID_ANGLES
    finer = 2 if shaken or rate < GRID_OTHERS else 1
    grid_rate = rate * max(finer, int(np.ceil(least / rate)))
    begin = min(s.stream.start for s in recorded)
    lead = max(0, int(np.ceil((fastest.times[0] - begin) * rate - 1e-9)))
    t0 = float(fastest.times[0]) - lead / rate
    end = max(float(o.times[-1]) for o in (*outputs, *declared) if o.times.size)
    steps = max(2, int(np.ceil((end - t0) * grid_rate - 1e-6)))
    return t0, grid_rate, steps


def _initial_angle(run: Run, rig: Nameplate, prescribed: Signal | None) -> float:
    if prescribed is None:
        return run.arm_angle
    n = gearing(prescribed.channel.quantity, prescribed.channel.location, rig.reduction_ratio or 1.0)
    return float(prescribed.samples[0]) / n


def _initial_speed(observed: Observed | None) -> float:
    """Slope of the observed angle over the first samples [rad/s]."""
    if observed is None:
        return 0.0
    t = observed.signal.start + np.arange(25) / max(observed.signal.rate, 25.0 / 0.1)
    values = observed.signal(t)
    return float(values[0]) if observed.rate_signal else float(np.polyfit(t, values, 1)[0])


def _motor_zero(recorded: list[Signal], rig: Nameplate, run: Run) -> float:
    for signal in recorded:
        if signal.channel.quantity in ("angle", "position") and signal.channel.location == "motor":
            n = gearing(signal.channel.quantity, "motor", rig.reduction_ratio or 1.0)
            return _first(np.asarray(signal.samples, dtype=np.float64)) / n - run.arm_angle
    return 0.0
