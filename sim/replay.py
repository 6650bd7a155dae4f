"""Any campaign's inputs run through an MJCF file: what would this model have recorded?

The model must carry the names of the rig (``models/rig.py``); bodies, tendons and friction beyond them are stepped as
they stand in the file, and :class:`Physics` adds what MJCF can't say. A single inertia's file has no joint ``motor``:
there ``reducer`` is the load's own coordinate. Runs start at rest at their arm angle, or (``initial = "estimate"``) with
the speed that their first samples show; what they show before that transient has died is not predicted.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.errors import InputError, RefusedError
from jointscope.recordings.campaign import Campaign, Run, Signal
from jointscope.sim.bench import Setup, holding_command, set_up, take
from jointscope.sim.measurement import Device
from jointscope.sim.physics import BASE, Physics
from jointscope.sim.replay_inputs import (
    LoggedLoop,
    Torque,
    arm_forces,
    hammer_radius,
    initial_speed,
    logged_torque,
    record_of,
    speed_law,
)
from jointscope.sim.replay_outputs import ratio, read_output
from jointscope.sim.replay_prescribed import load_force, moved_motor, path_of, prescribed
from jointscope.sim.stepping import MOTOR_ON_LOAD, TIMESTEP, Controller, Trace, grid, machine

Real = NDArray[np.float64]

__all__ = ["LoggedLoop", "base_run", "logged_torque", "replay", "replay_run"]

_ABSOLUTE = ("arm", "arm in space", "end-stop")  # tendons whose length is the load's own coordinate


def base_run(run: Run) -> Physics:
    """Nothing beyond the file."""
    del run
    return BASE


def replay(
    campaign: Campaign,
    model: Path | mujoco.MjSpec,
    *,
    loop: LoggedLoop | None = None,
    physics: Callable[[Run], Physics] = base_run,
    motor_torque: Callable[[Campaign, Run], Torque | None] | None = None,
    timestep: float = TIMESTEP,
) -> Campaign:
    """Step every run of ``campaign`` through ``model`` and read its output channels, without noise.

    Args:
        campaign: Recordings of one joint; of them only the inputs, the hold and ``arm_angle`` are read.
        model: An MJCF file, or the same as MjSpec.
        loop: Closes the drive's speed loop in runs with a speed command; without it the logged torque acts open loop.
        physics: What each run holds beyond the file.
        motor_torque: Reads a run's motor torque; :func:`logged_torque` where none is given.
        timestep: h [s].

    Returns:
        The campaign with its output channels replaced.

    Raises:
        InputError: The model lacks a name of the rig.
        RefusedError: The rig or a run is of a kind that is not replayed.
    """
    spec = _load(model, single=campaign.rig.topology == "single-dof")
    runs = tuple(
        replay_run(campaign, run, spec, physics(run), loop=loop, motor_torque=motor_torque, timestep=timestep)
        for run in campaign.runs
    )
    return replace(campaign, runs=runs)


def _load(model: Path | mujoco.MjSpec, *, single: bool) -> mujoco.MjSpec:
    if isinstance(model, Path):
        try:
            spec = mujoco.MjSpec.from_file(str(model))
        except ValueError as problem:
            raise InputError(model, None, f"MuJoCo can't read it: {problem}") from problem
    else:
        spec = model.copy()
    where = model if isinstance(model, Path) else Path(spec.modelname or "model")
    for kind, name, found in (
        ("joint", "motor", single or spec.joint("motor")),
        ("joint", "reducer", spec.joint("reducer")),
        ("tendon", "arm", spec.tendon("arm")),
        ("actuator", "motor", spec.actuator("motor")),
        ("site", "hammer", spec.site("hammer")),
        ("site", "accelerometer", spec.site("accelerometer")),
    ):
        if not found:
            raise InputError(
                where, kind, "the rig's model lacks it", value=name, fix="see models/single_joint.xml"
            )
    return spec


def replay_run(
    campaign: Campaign,
    run: Run,
    model: Path | mujoco.MjSpec,
    physics: Physics = BASE,
    *,
    loop: LoggedLoop | None = None,
    motor_torque: Callable[[Campaign, Run], Torque | None] | None = None,
    timestep: float = TIMESTEP,
) -> Run:
    """One run of :func:`replay`; same arguments, the run's physics at hand."""
    single = campaign.rig.topology == "single-dof"
    if campaign.rig.topology == "arm":
        raise RefusedError(f"{campaign.path}: replay steps one joint, not topology = 'arm'")
    spec = _load(model, single=single)
    radii = _instrument(spec, run)
    given = prescribed(run)
    if given is not None:
        return _replay_prescribed(campaign, run, spec, given, physics, timestep, radii)
    if motor_torque is None:
        torque = logged_torque(campaign, run, physics.acquisition)
    else:
        torque = motor_torque(campaign, run)
    held = motor_held(campaign, run, driven=torque is not None)
    setup = _single(spec, campaign, run, held, timestep, physics) if single else set_up(
        spec, run.arm_angle, timestep, braked=held, physics=physics
    )  # fmt: skip
    setup = replace(setup, speeds=_speeds(setup, initial_speed(campaign, run)))
    origin = min((stream.start for stream in run.streams), default=0.0)
    times = grid(duration_of(run, origin, timestep), timestep)

    columns: dict[str, Real | float] = dict(_loads(setup, run, times + origin, physics))
    controller = None
    if single:
        if torque is not None:
            columns[MOTOR_ON_LOAD] = logged = torque(times + origin)
            if not campaign.rig.grounded(held=held):
                controller = _controller(campaign, run, loop, setup, logged, 0.0, times + origin, physics, torque)
    elif "motor" in setup.machine.inputs:
        hold = holding_command(setup)
        logged = torque(times + origin) if torque is not None else np.full(len(times), hold)
        columns["motor"] = logged
        controller = _controller(campaign, run, loop, setup, logged, hold, times + origin, physics, torque)
    trace = physics.sensed(take(setup, columns, len(times), controller))
    return with_outputs(campaign, run, trace, radii, origin, physics)


def _replay_prescribed(
    campaign: Campaign,
    run: Run,
    spec: mujoco.MjSpec,
    given: Signal,
    physics: Physics,
    timestep: float,
    radii: dict[float, str],
) -> Run:
    """A run whose motor's or load's motion is an input."""
    origin = min((stream.start for stream in run.streams), default=0.0)
    times = grid(duration_of(run, origin, timestep), timestep) + origin
    path = path_of(given, ratio(campaign))
    if campaign.rig.topology == "single-dof":
        trace = load_force(spec, path, times, timestep, physics)
    elif given.channel.location == "motor":
        setup, control = moved_motor(spec, path, float(given.times[-1]), times, timestep, physics)
        columns: dict[str, Real | float] = dict(_loads(setup, run, times, physics))
        trace = take(setup, {**columns, "motor": control}, len(times))
        trace = replace(trace, inputs={k: v for k, v in trace.inputs.items() if k != "motor"})
    else:
        raise RefusedError(
            f"run {run.id!r}: the arm's motion is prescribed on a two-inertia rig; replay needs the motor's, or its torque"
        )
    return with_outputs(campaign, run, physics.sensed(trace), radii, origin, physics)


def motor_held(campaign: Campaign, run: Run, *, driven: bool) -> bool:
    """Whether the motor stands still: a brake, or a drive of which nothing was recorded."""
    if run.motor_held:
        return True
    if driven or run.hold.get("", "drive") == "free" or campaign.rig.topology != "two-inertia":
        return False
    moved = any(
        s.channel.quantity in ("angle", "angular-velocity") and s.channel.location in ("motor", "arm")
        for s in run.select(role="output")
    )
    return not moved and not run.select("speed-command", role="input")


def _single(
    spec: mujoco.MjSpec, campaign: Campaign, run: Run, held: bool, timestep: float, physics: Physics
) -> Setup:
    """A single inertia at rest at its angle: on its spring, which then is relaxed by its weight alone, or free."""
    spring = campaign.rig.grounded(held=held)
    spec.actuator("motor").name = MOTOR_ON_LOAD
    if spring:
        reducer = spec.joint("reducer")
        spec.body("motor").add_joint(name="motor", type=reducer.type, axis=list(reducer.axis))
        for tendon in spec.tendons:
            if tendon.name.startswith(_ABSOLUTE):
                tendon.wrap_joint("motor", 1.0)
        spec.add_actuator(name="motor", trntype=mujoco.mjtTrn.mjTRN_JOINT, target="motor")  # the ground's reaction
        return set_up(spec, run.arm_angle, timestep, braked=True, physics=physics)
    physics.edit(spec)
    spec.joint("reducer").stiffness[:] = 0.0
    spec.joint("reducer").damping[:] = 0.0
    for name in ("reducer spring", "reducer low-torque spring"):
        if spec.tendon(name) is not None:
            spec.tendon(name).stiffness[:] = 0.0
    free = machine(spec, timestep)
    start = np.zeros(free.model.nq)
    start[free.model.joint("reducer").qposadr[0]] = run.arm_angle
    return Setup(free, start, 0.0, 0.0, physics)


def _speeds(setup: Setup, speed: float) -> Real | None:
    """The whole rig at ``speed`` [rad/s], on its first coordinate."""
    if speed == 0.0:
        return None
    model = setup.machine.model
    speeds = np.zeros(model.nv)
    speeds[model.joint("motor" if "motor" in setup.machine.inputs else "reducer").dofadr[0]] = speed
    return speeds


def duration_of(run: Run, origin: float, timestep: float) -> float:
    """How long to simulate [s], so that every device's filter has its other half."""
    end = max(stream.start + stream.length / stream.sampling_rate for stream in run.streams)
    reach = max(Device(sampling_rate=stream.sampling_rate).reach(timestep) for stream in run.streams)
    return end - origin + reach


def _loads(setup: Setup, run: Run, times: Real, physics: Physics) -> dict[str, Real]:
    """Hammer and torque on the arm by actuator, and the hammer's work on a bending mode."""
    hammer, torque = arm_forces(run, times, physics.acquisition)
    columns = {"hammer": hammer, "arm torque": torque}
    on_the_arm = hammer * (hammer_radius(run) or 0.0) + torque
    for name in setup.machine.inputs:
        if name in ("link torque", "mount torque") or name.startswith("bend "):
            columns[name] = on_the_arm
    if "mount force" in setup.machine.inputs:
        columns["mount force"] = hammer
    if "bending force" in setup.machine.inputs:
        columns["bending force"] = physics.acquisition.moved(hammer_radius(run) or 0.0) * hammer
    return columns


def _instrument(spec: mujoco.MjSpec, run: Run) -> dict[float, str]:
    """Put the hammer, an accelerometer per radius and an external arm torque where the run has them."""
    target = "arm in space" if spec.tendon("arm in space") is not None else "arm"  # where the mount moves too
    arm_torque = spec.add_actuator(name="arm torque", trntype=mujoco.mjtTrn.mjTRN_TENDON, target=target)
    arm_torque.gear[0] = 1.0
    radius = hammer_radius(run)
    if radius is not None:
        site = spec.site("hammer")
        site.pos = np.array(site.pos) * radius / np.linalg.norm(site.pos)
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


def _controller(
    campaign: Campaign,
    run: Run,
    loop: LoggedLoop | None,
    setup: Setup,
    logged: Real,
    hold: float,
    times: Real,
    physics: Physics,
    torque: Torque | None,
) -> Controller | None:
    commands = run.select("speed-command", role="input")
    if loop is None or not commands or not {"motor", MOTOR_ON_LOAD} & set(setup.machine.inputs):
        if commands and torque is None:
            raise RefusedError(f"run {run.id!r}: a speed command without torque needs the drive's law (loop)")
        return None
    record = physics.acquisition.acted(commands[0], record_of(commands[0]))
    command, rate = record(times), record(times, 1)
    return speed_law(
        loop,
        logged,
        command,
        rate,
        ratio=ratio(campaign),
        start_angle=setup.motor_angle if "motor" in setup.machine.inputs else run.arm_angle,
        first=float(logged[0]) if torque is not None else hold,
        share=loop.share if torque is not None else 1.0,
        timestep=setup.machine.timestep,
    )


def with_outputs(
    campaign: Campaign, run: Run, trace: Trace, radii: dict[float, str], origin: float, physics: Physics
) -> Run:
    read = {
        id(signal.channel): read_output(campaign, run, signal, trace, radii, origin, physics.acquisition)
        for signal in run.select(role="output", recorded=False)
        if signal.channel.quantity != "frf" and signal.channel.location not in ("base", "neighbour")
    }
    streams = tuple(
        replace(
            stream,
            channels=tuple(
                replace(channel, samples=read[id(channel)]) if id(channel) in read else channel
                for channel in stream.channels
            ),
        )
        for stream in run.streams
    )
    return replace(run, streams=streams)
