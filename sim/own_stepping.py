"""A user's own model stepped over one recorded run: its inputs put where they act, its outputs read as a campaign's."""

from __future__ import annotations

from dataclasses import dataclass, replace

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

from jointscope.errors import RefusedError
from jointscope.recordings.campaign import Campaign, Run
from jointscope.sim.own_model import (
    OwnJoint,
    OwnRest,
    OwnSystem,
    braked,
    drive_on,
    geared,
    own_rest,
    own_system,
    turning,
)
from jointscope.sim.physics import BASE, Physics
from jointscope.sim.replay import duration_of, motor_held, with_outputs
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
from jointscope.sim.replay_outputs import ratio
from jointscope.sim.replay_prescribed import prescribed
from jointscope.sim.stepping import Controller, ForceLaw, Trace, begin, grid

Real = NDArray[np.float64]

_FULL = mujoco.mjtState.mjSTATE_FULLPHYSICS
_INPUTS = int(mujoco.mjtState.mjSTATE_CTRL) | int(mujoco.mjtState.mjSTATE_QFRC_APPLIED)


def own_run(
    campaign: Campaign,
    run: Run,
    spec: mujoco.MjSpec,
    joint: OwnJoint,
    *,
    physics: Physics = BASE,
    loop: LoggedLoop | None = None,
) -> Run:
    """The run as ``spec`` would have recorded it: its output channels, without noise.

    Args:
        campaign: Of its nameplate and this run the inputs, the hold and ``arm_angle`` are read.
        run: One of its runs.
        spec: The user's model (:func:`load_own`); it is not changed.
        joint: Which joint is which.
        physics: Laws and instruments beyond the model; its ``edit`` and ``law`` see the model's own names.
        loop: Closes the drive's speed loop in runs with a speed command.

    Raises:
        InputError: A name is not in the model.
        RefusedError: The run is of a kind that is not stepped.
    """
    if campaign.rig.topology == "arm":
        raise RefusedError(f"{campaign.path}: --model takes a single joint's campaign, not topology = 'arm'")
    if prescribed(run) is not None:
        raise RefusedError(
            f"run {run.id!r}: its motion is prescribed; a user's model is stepped by force or torque"
        )
    spec = spec.copy()
    physics.edit(spec)
    torque = logged_torque(campaign, run, physics.acquisition)
    system = own_system(spec, joint)
    rest = own_rest(system, joint.sign, run.arm_angle)
    held = motor_held(campaign, run, driven=torque is not None)
    single = campaign.rig.topology == "single-dof"
    grounded = campaign.rig.grounded(held=held)
    origin = min((stream.start for stream in run.streams), default=0.0)
    times = grid(duration_of(run, origin, system.timestep), system.timestep)
    if held and not single:
        if joint.rotor is None:
            return _read(campaign, run, _still(system, run, times, joint), origin, physics)
        kept = np.delete(rest.x, braked(system.model, joint.rotor))
        system, rest = own_system(spec, joint, brake=rest.x), OwnRest(kept, 0.0)
    trace = _step_run(campaign, run, system, joint, rest, times, origin, physics, loop, torque,
                      held=held, reaction=rest.torque if single and grounded else 0.0)  # fmt: skip
    return _read(campaign, run, trace, origin, physics)


def _step_run(
    campaign: Campaign, run: Run, system: OwnSystem, joint: OwnJoint, rest: OwnRest, times: Real, origin: float,
    physics: Physics, loop: LoggedLoop | None, torque: Torque | None, *, held: bool, reaction: float,
) -> Trace:  # fmt: skip
    model, n = system.model, ratio(campaign)
    at = times + origin + system.late * system.timestep
    hammer, arm_torque = arm_forces(run, at, physics.acquisition)
    load = hammer * (hammer_radius(run) or 1.0) + arm_torque
    applied = np.outer(load, system.arm) + reaction * drive_on(system)
    control = np.zeros((len(times), model.nu))
    driven = not held and (torque is not None or bool(run.select("speed-command", role="input")))
    eta = 1.0 if campaign.rig.efficiency is None else campaign.rig.efficiency
    per_control = 1.0 if joint.torque == "motor" else eta * n
    logged = torque(at) if torque is not None else np.full(len(times), rest.torque / (eta * n))
    place = _Place(-1 if joint.actuator is None or not driven else int(model.actuator(joint.actuator).id),
                   turning(system) * per_control, drive_on(system) * eta * n)  # fmt: skip
    controller = None
    if driven:
        if joint.control != "torque":
            _command(run, control, system, joint, rest, at, place.actuator, n)
            applied = applied + rest.torque * drive_on(system)
        else:
            controller = _controller(
                run, loop, system, joint, rest, logged, at, n, eta, physics, torque is not None
            )
            if controller is None and torque is None:
                raise RefusedError(f"run {run.id!r}: a speed command without torque needs the drive's law")
            if controller is None:
                place.put(control, applied, logged)
    speed = initial_speed(campaign, run)
    lead = system.motor if np.any(system.motor) else system.arm
    start_speed = np.zeros(model.nv)
    if speed:
        k = int(np.flatnonzero(lead)[0])
        start_speed[k] = speed / lead[k]
        for other, turns in geared(model, model.joint(int(model.dof_jntid[k])).name).items():
            start_speed[int(model.joint(other).dofadr[0])] = turns * start_speed[k]
    law = physics.law(model) if physics.law else None
    if controller is None and law is None:
        path = _roll(model, rest.x, start_speed, control, applied)
    else:
        path, logged = _march(system, rest.x, start_speed, control, applied, controller, law, place, joint, logged)
    return _trace(
        system, joint, path, rest.x - system.timestep * start_speed, times, run, logged if driven else None
    )


@dataclass(frozen=True, eq=False)
class _Place:
    """Where a motor torque T_e goes: an actuator's control, or the coordinates themselves."""

    actuator: int
    per_torque: float
    generalized: Real

    def put(self, control: Real, applied: Real, torque: Real) -> None:
        """Write T_e [N m], shape (n,), into the inputs."""
        if self.actuator >= 0:
            control[:, self.actuator] = self.per_torque * torque
        else:
            applied += np.outer(torque, self.generalized)


def _command(
    run: Run, control: Real, system: OwnSystem, joint: OwnJoint, rest: OwnRest, at: Real, actuator: int, n: float
) -> None:
    commands = run.select("speed-command", role="input")
    if not commands or actuator < 0:
        raise RefusedError(
            f"run {run.id!r}: control = {joint.control!r} needs a speed-command channel and an actuator to give it to"
        )
    rotor = joint.rotor_ratio if joint.rotor is not None else 1.0
    speed = joint.sign * rotor * record_of(commands[0])(at) / n
    if joint.control == "velocity":
        control[:, actuator] = speed
        return
    start = float(np.abs(rotor) * system.motor @ rest.x) * joint.sign
    control[:, actuator] = (
        start + np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))]) * system.timestep
    )


def _controller(
    run: Run, loop: LoggedLoop | None, system: OwnSystem, joint: OwnJoint, rest: OwnRest, logged: Real, at: Real,
    n: float, eta: float, physics: Physics, recorded: bool,
) -> Controller | None:  # fmt: skip
    commands = run.select("speed-command", role="input")
    if loop is None or not commands or not np.any(system.motor):
        return None
    record = physics.acquisition.acted(commands[0], record_of(commands[0]))
    return speed_law(
        loop, logged, record(at), record(at, 1), ratio=n, start_angle=float(system.motor @ rest.x),
        first=float(logged[0]) if recorded else rest.torque / (eta * n), share=loop.share if recorded else 1.0,
        timestep=system.timestep,
    )  # fmt: skip


def _roll(model: mujoco.MjModel, start: Real, speeds: Real, control: Real, applied: Real) -> Real:
    """Coordinates at t_0 ... t_n, shape (n + 1, nv)."""
    data = begin(model, start, speeds)
    state = np.empty(mujoco.mj_stateSize(model, _FULL))
    mujoco.mj_getState(model, data, state, _FULL)
    inputs = np.hstack([control, applied])
    states, _ = rollout.rollout(model, data, state[np.newaxis], inputs[np.newaxis], control_spec=_INPUTS)
    return np.vstack([start, states[0][:, 1 : 1 + model.nq]])


def _march(
    system: OwnSystem, start: Real, speeds: Real, control: Real, applied: Real, controller: Controller | None,
    law: ForceLaw | None, place: _Place, joint: OwnJoint, logged: Real,
) -> tuple[Real, Real]:  # fmt: skip
    """Step by step, for what reacts to the motion: coordinates, shape (n + 1, nv), and the torque that acted."""
    model, h, steps = system.model, system.timestep, len(applied)
    data = begin(model, start, speeds)
    path, acted = np.empty((steps + 1, model.nq)), logged.copy()
    path[0] = start
    lead = system.motor
    for k in range(steps):
        if controller is not None:
            acted[k] = controller(k * h, float(lead @ data.qpos))
            if place.actuator >= 0:
                control[k, place.actuator] = place.per_torque * acted[k]
            else:
                applied[k] += acted[k] * place.generalized
        data.ctrl[:] = control[k]
        data.qfrc_applied[:] = applied[k]
        if law is not None:
            data.qfrc_applied[:] += law(k * h, data.qpos, data.qvel + (0.5 * h) * data.qacc)
        mujoco.mj_step(model, data)
        path[k + 1] = data.qpos
    return path, acted


def _trace(
    system: OwnSystem, joint: OwnJoint, path: Real, before: Real, times: Real, run: Run, torque: Real | None
) -> Trace:
    """Angles, and by central differences speeds and accelerations, at t_0 ... t_{n-1}."""
    signals: dict[str, Real] = {}
    around = np.vstack([before, path])
    for name, function in (("arm", system.arm), ("motor", system.motor), ("sensor", system.sensor)):
        angle = around @ function - joint.sign * system.zero
        if name == "motor" and not np.any(function):
            angle = np.full(len(around), system.held)
        signals[f"{name} angle"] = angle[1:-1]
        signals[f"{name} speed"] = (angle[2:] - angle[:-2]) / (2.0 * system.timestep)
        signals[f"{name} acceleration"] = np.diff(angle, 2) / system.timestep**2
    gravity = float(np.linalg.norm(system.model.opt.gravity))
    for radius, name in accelerometers(run).items():
        q, v, a = (signals[f"sensor {kind}"] for kind in ("angle", "speed", "acceleration"))
        q = signals["arm angle"] if np.any(system.sensor != system.arm) else q
        tangential, radial = radius * a + gravity * np.cos(q), gravity * np.sin(q) - radius * v**2
        signals[name] = np.column_stack([radial, np.zeros_like(q), tangential])
    return Trace(times=times, inputs={} if torque is None else {"motor": torque}, signals=signals)


def accelerometers(run: Run) -> dict[float, str]:
    """A name for every radius [m] at which an accelerometer of the run sits."""
    outputs = run.select("linear-acceleration", role="output", recorded=False)
    radii = sorted({s.channel.radius for s in outputs if s.channel.radius is not None})
    return {radius: f"accelerometer {k}" for k, radius in enumerate(radii, 1)}


def _still(system: OwnSystem, run: Run, times: Real, joint: OwnJoint) -> Trace:
    """A rigid joint on the brake."""
    x = np.zeros((len(times) + 1, system.model.nv))
    lead = int(np.flatnonzero(system.arm)[0])
    x[:, lead] = (run.arm_angle + joint.sign * system.zero) / system.arm[lead]
    return _trace(system, joint, x, x[0], times, run, None)


def _read(campaign: Campaign, run: Run, trace: Trace, origin: float, physics: Physics) -> Run:
    horizontal = campaign.rig.plane == "horizontal"
    if horizontal:  # gravity is across the sensor's axis
        trace = replace(trace, signals={**trace.signals, **_without_weight(trace, run)})
    return with_outputs(campaign, run, physics.sensed(trace), accelerometers(run), origin, physics)


def _without_weight(trace: Trace, run: Run) -> dict[str, Real]:
    found = {}
    for radius, name in accelerometers(run).items():
        v, a = trace.signals["sensor speed"], trace.signals["sensor acceleration"]
        found[name] = np.column_stack([-radius * v**2, np.zeros_like(v), radius * a])
    return found
