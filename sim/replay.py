"""Any campaign's inputs run through an MJCF file: what would this model have recorded?

The model must carry the names of the single-joint rig (``models/rig.py``); bodies, tendons and friction beyond them are
stepped as they stand in the file, and :class:`Physics` adds what MJCF can't say.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.errors import InputError, RefusedError
from jointscope.recordings.bandlimited import bandlimited
from jointscope.recordings.campaign import Campaign, Channel, Run, Signal, Stream
from jointscope.sim.bench import Setup, holding_command, set_up, take
from jointscope.sim.measurement import Device
from jointscope.sim.measurement_sensors import iepe
from jointscope.sim.physics import BASE, Physics
from jointscope.sim.stepping import TIMESTEP, Controller, Trace, grid

Real = NDArray[np.float64]
Torque = Callable[[Real], Real]


@dataclass(frozen=True, kw_only=True)
class LoggedLoop:
    """A speed loop closed around the replayed rig: T_e = log + share (law - log).

    law = sat(K_p e + K_i int e dt + J_f w_c' + b_f w_c + T_0), e = w_c - w_m on the motor shaft, T_0 the holding torque.

    Attributes:
        proportional: K_p [N m s/rad].
        integral: K_i [N m/rad].
        acceleration_feedforward: J_f [kg m^2].
        velocity_feedforward: b_f [N m s/rad].
        torque_limit: [N m]; infinite where none is known.
        share: Of the law in the torque; 1 where no torque was logged [-].
    """

    proportional: float
    integral: float
    acceleration_feedforward: float = 0.0
    velocity_feedforward: float = 0.0
    torque_limit: float = float("inf")
    share: float = 0.3


def base_run(run: Run) -> Physics:
    """Nothing beyond the file."""
    del run
    return BASE


def logged_torque(campaign: Campaign, run: Run) -> Torque | None:
    """T_e on the motor shaft [N m] as a function of time [s], from a torque or q-axis current channel.

    Raises:
        RefusedError: Only phase currents or a voltage were recorded; they need the caller's own reading.
    """
    for signal in run.select("torque", location="motor", role="input"):
        record = bandlimited(signal.samples, signal.sampling_rate, signal.stream.start)
        return _scaled(record, 1.0 / _ratio(campaign) if signal.channel.side == "output" else 1.0)
    for signal in run.select("current", location="motor", role="input"):
        if campaign.rig.torque_constant is None:
            raise RefusedError(f"run {run.id!r}: a current without [rig] torque_constant is no torque")
        record = bandlimited(signal.samples, signal.sampling_rate, signal.stream.start)
        return _scaled(record, campaign.rig.torque_constant)
    if run.select("phase-current", role="input") or run.select("voltage", role="input"):
        raise RefusedError(f"run {run.id!r}: hand replay a motor_torque that reads its currents or voltage")
    return None


def replay(
    campaign: Campaign,
    model: Path | mujoco.MjSpec,
    *,
    loop: LoggedLoop | None = None,
    physics: Callable[[Run], Physics] = base_run,
    motor_torque: Callable[[Campaign, Run], Torque | None] = logged_torque,
    timestep: float = TIMESTEP,
) -> Campaign:
    """Step every run of ``campaign`` through ``model`` and read its output channels, without noise.

    Args:
        campaign: Two-inertia recordings; of them only the inputs, ``brake`` and ``arm_angle`` are read.
        model: An MJCF file, or the same as MjSpec.
        loop: Closes the drive's speed loop in runs with a speed command; without it the logged torque acts open loop.
        physics: What each run holds beyond the file.
        motor_torque: Reads a run's motor torque.
        timestep: h [s].

    Returns:
        The campaign with its output channels replaced.

    Raises:
        InputError: The model lacks a name of the rig.
        RefusedError: The rig or a run is of a kind that is not replayed.
    """
    if campaign.rig.topology != "two-inertia" or campaign.rig.motion != "rotational":
        raise RefusedError(
            f"{campaign.path}: replay steps rotational two-inertia rigs, not {campaign.rig.motion} {campaign.rig.topology}"
        )
    spec = _load(model)
    return replace(
        campaign,
        runs=tuple(
            _replay_run(campaign, run, spec, loop, physics(run), motor_torque(campaign, run), timestep)
            for run in campaign.runs
        ),
    )


def _load(model: Path | mujoco.MjSpec) -> mujoco.MjSpec:
    if isinstance(model, Path):
        try:
            spec = mujoco.MjSpec.from_file(str(model))
        except ValueError as problem:
            raise InputError(model, None, f"MuJoCo can't read it: {problem}") from problem
    else:
        spec = model.copy()
    where = model if isinstance(model, Path) else Path(spec.modelname or "model")
    for kind, name, found in (
        ("joint", "motor", spec.joint("motor")),
        ("joint", "reducer", spec.joint("reducer")),
        ("tendon", "arm", spec.tendon("arm")),
        ("actuator", "motor", spec.actuator("motor")),
        ("site", "hammer", spec.site("hammer")),
        ("site", "accelerometer", spec.site("accelerometer")),
    ):
        if found is None:
            raise InputError(
                where, kind, "the rig's model lacks it", value=name, fix="see models/single_joint.xml"
            )
    return spec


def _replay_run(
    campaign: Campaign,
    run: Run,
    spec: mujoco.MjSpec,
    loop: LoggedLoop | None,
    physics: Physics,
    torque: Torque | None,
    timestep: float,
) -> Run:
    if run.initial == "estimate":
        raise RefusedError(f"run {run.id!r}: starts in motion (initial = 'estimate'); replay starts at rest")
    spec = spec.copy()
    radii = _instrument(spec, run)
    setup = set_up(spec, run.arm_angle, timestep, braked=run.brake, physics=physics)
    origin = min((stream.start for stream in run.streams), default=0.0)
    end = max(stream.start + stream.length / stream.sampling_rate for stream in run.streams)
    devices = {stream.file: Device(sampling_rate=stream.sampling_rate) for stream in run.streams}
    reach = max(device.reach(timestep) for device in devices.values())
    times = grid(end - origin + reach, timestep)

    columns: dict[str, Real | float] = dict(_forces(run, times + origin))
    controller = None
    if not run.brake:
        hold = holding_command(setup)
        logged = torque(times + origin) if torque is not None else np.full(len(times), hold)
        columns["motor"] = logged
        controller = _loop(campaign, run, loop, setup, logged, hold, times + origin, has_log=torque is not None)
    trace = physics.sensed(take(setup, columns, len(times), controller))

    streams = []
    for stream in run.streams:
        channels = tuple(
            replace(channel, samples=_read(campaign, stream, channel, trace, devices[stream.file], radii, origin))
            if channel.role == "output" and channel.quantity != "frf"
            else channel
            for channel in stream.channels
        )
        streams.append(replace(stream, channels=channels))
    return replace(run, streams=tuple(streams))


def _instrument(spec: mujoco.MjSpec, run: Run) -> dict[float, str]:
    """Put the hammer, an accelerometer per radius and an external arm torque where the run has them."""
    arm_torque = spec.add_actuator(name="arm torque", trntype=mujoco.mjtTrn.mjTRN_TENDON, target="arm")
    arm_torque.gear[0] = 1.0
    forces = [s.channel.radius for s in run.select("force", role="input") if s.channel.radius is not None]
    if len(set(forces)) > 1:
        raise RefusedError(f"run {run.id!r}: forces at {len(set(forces))} radii; replay drives one")
    if forces:
        site = spec.site("hammer")
        site.pos = np.array(site.pos) * forces[0] / np.linalg.norm(site.pos)
    mounted = spec.site("accelerometer")
    radii: dict[float, str] = {}
    for signal in run.select("linear-acceleration", role="output", recorded=False):
        radius = signal.channel.radius
        if radius is None or radius in radii:
            continue
        radii[radius] = f"accelerometer {len(radii) + 1}"
        place = np.array(mounted.pos) * radius / np.linalg.norm(mounted.pos)
        mounted.parent.add_site(name=radii[radius], pos=place, quat=np.array(mounted.quat))
        spec.add_sensor(
            name=radii[radius], type=mujoco.mjtSensor.mjSENS_ACCELEROMETER,
            objtype=mujoco.mjtObj.mjOBJ_SITE, objname=radii[radius],
        )  # fmt: skip
    return radii


def _forces(run: Run, times: Real) -> dict[str, Real]:
    columns: dict[str, Real] = {}
    for name, quantity in (("hammer", "force"), ("arm torque", "torque")):
        signals = [
            s for s in run.select(role="input") if s.channel.quantity == quantity and s.channel.location != "motor"
        ]
        if signals:
            columns[name] = np.sum([_record(signal, times) for signal in signals], axis=0)
    return columns


def _record(signal: Signal, times: Real) -> Real:
    return bandlimited(signal.samples, signal.sampling_rate, signal.stream.start)(times)


def _scaled(record: Torque, factor: float) -> Torque:
    return lambda times: factor * record(times)


def _loop(
    campaign: Campaign,
    run: Run,
    loop: LoggedLoop | None,
    setup: Setup,
    logged: Real,
    hold: float,
    times: Real,
    *,
    has_log: bool,
) -> Controller | None:
    commands = run.select("speed-command", role="input")
    if loop is None or not commands:
        if commands and not has_log:
            raise RefusedError(f"run {run.id!r}: a speed command without torque needs the drive's law (loop)")
        return None
    record = bandlimited(commands[0].samples, commands[0].sampling_rate, commands[0].stream.start)
    return _law(loop, setup, logged, hold, record(times), record(times, 1), _ratio(campaign), has_log=has_log)


def _law(
    loop: LoggedLoop,
    setup: Setup,
    logged: Real,
    hold: float,
    command: Real,
    rate: Real,
    ratio: float,
    *,
    has_log: bool,
) -> Controller:
    h = setup.machine.timestep
    share = loop.share if has_log else 1.0
    feedforward = loop.acceleration_feedforward * rate + loop.velocity_feedforward * command
    last, integrator, k = setup.motor_angle, hold, 0

    def control(t: float, motor_angle: float) -> float:
        nonlocal last, integrator, k
        now = min(k, len(logged) - 1)
        k += 1
        error = command[now] - ratio * (motor_angle - last) / h
        last = motor_angle
        asked = loop.proportional * error + integrator + feedforward[now]
        torque = min(max(asked, -loop.torque_limit), loop.torque_limit)
        if torque == asked or (asked - torque) * error < 0.0:
            integrator += loop.integral * error * h
        return float(logged[now] + share * (torque - logged[now]))

    return control


def _read(
    campaign: Campaign,
    stream: Stream,
    channel: Channel,
    trace: Trace,
    device: Device,
    radii: dict[float, str],
    origin: float,
) -> Real:
    """Ideal samples of one output channel."""
    h, signals = trace.timestep, trace.signals
    at_motor = channel.location == "motor"
    if channel.quantity == "linear-acceleration" and channel.radius in radii:
        values = signals[radii[channel.radius]][:, 2 if channel.direction == "tangential" else 0]
    elif channel.quantity in ("angle", "angular-velocity", "angular-acceleration") and channel.location in (
        "motor",
        "arm",
    ):
        kind = {"angle": "angle", "angular-velocity": "speed", "angular-acceleration": "acceleration"}[
            channel.quantity
        ]
        name = f"{channel.location} {kind}"
        values = signals.get(name, np.zeros(len(trace.times)))  # a braked motor stands still
        values = values * _ratio(campaign) if at_motor else values
    elif channel.quantity == "torque" and at_motor and "motor" in trace.inputs:
        values = trace.inputs["motor"] * (_ratio(campaign) if channel.side == "output" else 1.0)
    else:
        raise RefusedError(
            f"{stream.file}: {channel.column!r} is a {channel.quantity} at {channel.location}, which replay does not read"
        )
    if channel.coupling == "ac":
        values = iepe(values, h, channel.low_cutoff) if channel.low_cutoff else values - values[0]
    samples = device.sample(values, h, stream.times - origin)
    samples.setflags(write=False)
    return samples


def _ratio(campaign: Campaign) -> float:
    if campaign.rig.reduction_ratio is None:
        raise RefusedError(f"{campaign.path}: [rig] reduction_ratio is needed to replay motor channels")
    return campaign.rig.reduction_ratio
