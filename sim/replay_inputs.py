"""A recorded run's inputs as functions of time: what pushed the arm, what the motor gave, what the drive was told."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import RefusedError
from jointscope.recordings.bandlimited import bandlimited
from jointscope.recordings.campaign import Campaign, Run, Signal, gearing
from jointscope.recordings.motor_torque import motor_torque
from jointscope.sim.physics import Acquisition, Record
from jointscope.sim.stepping import Controller

Real = NDArray[np.float64]
Torque = Callable[[Real], Real]


@dataclass(frozen=True, kw_only=True)
class LoggedLoop:
    """A speed loop closed around the replayed rig: T_e = log + share (law - log).

    law = sat(K_p e + K_i int e dt + J_f w_c' + b_f w_c + T_0), e = w_c - w_m on the motor shaft, T_0 the first logged
    torque, or the holding torque where none was logged.

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


def logged_torque(campaign: Campaign, run: Run, acquisition: Acquisition | None = None) -> Torque | None:
    """T_e on the motor shaft as a function of time [s]; ``None`` where no channel of it is an input.

    In N m from a torque, a current or phase currents (with the motor's angle) and the nameplate; per ampere, volt or
    unit where the scale is unknown, as the model's gear is then. On a rig that slides: the motor's force [N].

    Args:
        campaign: For its nameplate.
        run: Only channels with ``role = "input"`` are read, and the motor's angle where phase currents need it.
        acquisition: From what was recorded to what acted.

    Raises:
        RefusedError: Only |T_e| is known.
    """
    inputs = _inputs_only(run)
    forces = inputs.select("force", location="motor")
    found = None if forces else motor_torque(inputs, campaign.rig)
    if found is not None:
        if not found.signed:
            raise RefusedError(
                f"run {run.id!r}: fewer than three phase currents, or no motor angle, leave the torque's sign unknown"
            )
        signal, samples = found.source, found.values
    else:
        voltages = inputs.select("voltage", location="motor")
        if not forces and not voltages:
            return None
        signal = (forces or voltages)[0]
        samples = signal.samples
    record: Record = bandlimited(samples, signal.sampling_rate, signal.stream.start)
    return acquisition.acted(signal, record) if acquisition is not None else record


def _inputs_only(run: Run) -> Run:
    """The run without its outputs; of them only the motor's angle stays, for the sign of phase currents."""
    phases = bool(run.select("phase-current", role="input"))
    streams = tuple(
        replace(
            stream,
            channels=tuple(
                channel
                for channel in stream.channels
                if channel.role == "input"
                or (phases and channel.quantity == "angle" and channel.location == "motor")
            ),
        )
        for stream in run.streams
    )
    return replace(run, streams=streams)


def arm_forces(run: Run, times: Real, acquisition: Acquisition) -> tuple[Real, Real]:
    """Hammer force [N] at the run's hammer radius, and torque (on a rig that slides: force) on the load, shape (n,)."""
    hammer, torque = np.zeros(len(times)), np.zeros(len(times))
    for signal in run.select(role="input"):
        channel = signal.channel
        if channel.location == "motor" or channel.quantity not in ("force", "torque"):
            continue
        values = acquisition.acted(signal, record_of(signal))(times)
        if channel.quantity == "force" and channel.radius is not None:
            hammer += values
        else:
            torque += values
    return hammer, torque


def hammer_radius(run: Run) -> float | None:
    """Where the hammer hits [m], or ``None`` where no force has a radius.

    Raises:
        RefusedError: Forces act at several radii.
    """
    forces = {s.channel.radius for s in run.select("force", role="input") if s.channel.radius is not None}
    if len(forces) > 1:
        raise RefusedError(f"run {run.id!r}: forces at {len(forces)} radii; replay drives one")
    return next(iter(forces), None)


def initial_speed(campaign: Campaign, run: Run) -> float:
    """Speed of the rig at the output [rad/s or m/s] where a run says that it began in motion; else 0.

    From the first samples of what it recorded of its motion, the one use of an output: the slope of an angle over at
    most 25 samples and 0.1 s, or the first value of a speed.
    """
    if run.initial != "estimate":
        return 0.0
    for kinds, order in ((("angle", "position"), 1), (("angular-velocity", "velocity"), 0)):
        for location in ("motor", "arm", "load"):
            for signal in run.select(role="output"):
                if signal.channel.quantity not in kinds or signal.channel.location != location:
                    continue
                n = gearing(signal.channel.quantity, location, campaign.rig.reduction_ratio or 1.0)
                count = min(25, max(2, int(0.1 * signal.sampling_rate) + 1)) if order else 1
                first = signal.samples[:count] / n
                return float(np.polyfit(signal.times[:count], first, 1)[0]) if order else float(first[0])
    return 0.0


def record_of(signal: Signal) -> Record:
    """A channel as a function of time."""
    return bandlimited(signal.samples, signal.sampling_rate, signal.stream.start)


def speed_law(
    loop: LoggedLoop,
    logged: Real,
    command: Real,
    rate: Real,
    *,
    ratio: float,
    start_angle: float,
    first: float,
    share: float,
    timestep: float,
) -> Controller:
    """The drive's loop as a controller.

    Args:
        loop: Its law.
        logged: Logged torque on the stepping grid [N m], shape (n,).
        command: Commanded motor speed on that grid [rad/s], and its ``rate`` [rad/s^2], shape (n,).
        ratio: n.
        start_angle: q_s at the start [rad].
        first: What the integrator holds at the start [N m].
        share: Of the law in the torque [-].
        timestep: h [s].
    """
    h = timestep
    feedforward = loop.acceleration_feedforward * rate + loop.velocity_feedforward * command
    last, integrator, k = start_angle, first, 0

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
