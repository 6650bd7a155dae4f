"""What the channels of one run owe each other: kinematics, and the rigid-body mechanics of the whole joint.

Each relation is a gain, measured over expected, that is 1 within a window where nothing is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import RefusedError
from jointscope.identification.quality_hits import hit_relations
from jointscope.identification.quality_inertia import whole_inertia
from jointscope.identification.quality_relation import Party, Relation
from jointscope.identification.quality_signals import (
    ORDER,
    Grid,
    common_grid,
    differentiated,
    energy_frequency,
    high_passed,
    low_passed,
    motions,
    on_grid,
    ratio_to_output,
    rigid_band,
)
from jointscope.models.parameters import STANDARD_GRAVITY
from jointscope.recordings.campaign import Nameplate, Run, Signal
from jointscope.recordings.motor_torque import motor_torque

Real = NDArray[np.float64]
_WORKED = 0.15  # net over gross work of a drive, from which on what it drives moves its way


def across(run: Run, rig: Nameplate) -> Iterator[Relation]:
    """What motor and arm owe each other at low frequency; nothing where the motor is braked or nothing moves slowly."""
    band = None if run.brake else rigid_band(run)
    if band is not None:
        yield from _across(run, rig, band)


def run_relations(run: Run, rig: Nameplate) -> Iterator[Relation]:
    """Every relation that the run's channels carry."""
    if run.experiment == "hammer":
        yield from hit_relations(run, rig)
    if run.brake:
        return
    band = rigid_band(run)
    if band is None:
        return
    for location in ("motor", "arm", "load"):
        yield from _same_shaft(motions(run, rig, location), run, rig, band)
    yield from _across(run, rig, band)
    yield from _command(run, rig, band)
    yield from _rigid_body(run, rig, band)


def _regressed(y: Real, x: Real) -> tuple[float, float]:
    """Gain of y over x and their correlation, means removed."""
    x, y = x - x.mean(), y - y.mean()
    norm = float(np.linalg.norm(x) * np.linalg.norm(y))
    return float(x @ y / (x @ x)), float(x @ y / norm) if norm > 0.0 else 0.0


def trimmed(x: Real, grid: Grid, band: float) -> Real:
    """Without the ends, where filters and differences lean on nothing."""
    cut = min(round(0.5 * grid.rate / band), x.size // 8)
    return x[cut : x.size - cut]


def as_motion(signal: Signal, grid: Grid, rig: Nameplate, band: float, order: int) -> Real:
    """The signal's ``order``-th derivative of the output's angle [rad/s^order], low-passed at ``band`` [Hz]."""
    factor = ratio_to_output(signal, rig) or 1.0
    x = low_passed(on_grid(signal, grid), grid.rate, band) * factor
    return differentiated(x, grid.rate, order - ORDER[signal.channel.quantity])


def _compared(
    first: Signal, second: Signal, rig: Nameplate, run: Run, band: float, low: float, high: float, says: str
) -> Iterator[Relation]:
    """``second`` over ``first``, both as the motion that the higher of their orders is."""
    order = max(ORDER[first.channel.quantity], ORDER[second.channel.quantity])
    grid = common_grid([first, second])
    if grid is None or band > 0.4 * grid.rate:
        return
    a = as_motion(first, grid, rig, band, order)
    b = as_motion(second, grid, rig, band, order)
    a = as_sensed(a, first, second, run, rig, grid, band)
    gain, correlation = _regressed(trimmed(b, grid, band), trimmed(a, grid, band))
    if abs(correlation) > 0.8:
        yield Relation((Party(second, 1), Party(first, -1)), gain, low, high, says)


def as_sensed(
    motion: Real, first: Signal, sensor: Signal, run: Run, rig: Nameplate, grid: Grid, band: float
) -> Real:
    """What an accelerometer makes of a motion: gravity's share and the high-pass of its coupling."""
    channel = sensor.channel
    if ORDER[channel.quantity] != 2 or ORDER[first.channel.quantity] == 2:
        return motion
    on_an_arm = channel.quantity == "linear-acceleration"
    if on_an_arm and rig.plane == "vertical" and ORDER[first.channel.quantity] == 0 and channel.radius:
        q = as_motion(first, grid, rig, band, 0)
        q = q - q[0] + run.arm_angle
        motion = motion + STANDARD_GRAVITY / channel.radius * np.cos(q)
    if channel.coupling == "ac" and channel.low_cutoff:
        motion = high_passed(motion, grid.rate, channel.low_cutoff)
    return motion


def _same_shaft(signals: list[Signal], run: Run, rig: Nameplate, band: float) -> Iterator[Relation]:
    """Angle, speed and acceleration of one shaft are each other's derivatives, in any band."""
    for place, first in enumerate(signals):
        for second in signals[place + 1 :]:
            order = max(ORDER[first.channel.quantity], ORDER[second.channel.quantity])
            highest = first if ORDER[first.channel.quantity] == order else second
            wide = energy_frequency(np.nan_to_num(highest.samples), highest.sampling_rate, 0.8)
            rate = min(first.sampling_rate, second.sampling_rate)
            corner = min(max(band, 1.2 * wide), 0.1 * rate)
            says = f"{second.channel.column} against {first.channel.column} of the same shaft"
            yield from _compared(first, second, rig, run, corner, 0.87, 1.15, says)


def _across(run: Run, rig: Nameplate, band: float) -> Iterator[Relation]:
    """At low frequency the arm turns with the motor, n times slower."""
    motor, arm = motions(run, rig, "motor"), [*motions(run, rig, "arm"), *motions(run, rig, "load")]
    if not motor or not arm:
        return
    for second in arm:
        first = min(motor, key=lambda s: abs(ORDER[s.channel.quantity] - ORDER[second.channel.quantity]))
        if second.channel.quantity == "linear-acceleration":
            first = motor[0]
        ratio = "" if rig.motion == "translational" else f" over n = {rig.reduction_ratio:g}"
        says = f"{second.channel.column} against {first.channel.column}{ratio} below {band:.3g} Hz"
        yield from _compared(first, second, rig, run, band, 0.7, 1.45, says)


def _command(run: Run, rig: Nameplate, band: float) -> Iterator[Relation]:
    """A speed loop follows its command."""
    motor = motions(run, rig, "motor")
    for command in run.select("speed-command"):
        if motor and np.ptp(command.samples) > 0.0:
            says = f"{command.channel.column} against the speed of {motor[0].channel.column}"
            yield from _compared(motor[0], command, rig, run, band, 0.8, 1.25, says)


def _rigid_body(run: Run, rig: Nameplate, band: float) -> Iterator[Relation]:
    """n eta T_e = (J_M + J_L) q'' + friction + gravity at low frequency."""
    drive = _drive(run, rig)
    if drive is None:
        return
    source, lever, calibrated = drive
    moved = [*motions(run, rig, "motor"), *motions(run, rig, "arm"), *motions(run, rig, "load")]
    # an accelerometer gives neither speed nor angle: friction and gravity could not be told from inertia
    moved = [signal for signal in moved if ORDER[signal.channel.quantity] < 2 and signal.channel.calibrated]
    seen = set()
    for motion in moved:
        if motion.channel.location in seen:
            continue
        seen.add(motion.channel.location)
        inertia = _apparent_inertia(run, rig, source, lever, motion, band)
        if inertia is None:
            continue
        whole = whole_inertia(rig)
        known = calibrated and whole.known
        likely = whole.likely if known else 1.0
        window = (0.8 * whole.least / likely, 1.25 * whole.most / likely) if known else (0.0, math.inf)
        unit = "kg" if rig.motion == "translational" else "kg m^2"
        figure = f", apparent inertia {inertia:.3g} {unit}" + (f" where {whole}" if known else "")
        says = f"{source.channel.column} against the acceleration of {motion.channel.column}{figure if calibrated else ''}"
        yield Relation((Party(source, 1), Party(motion, -1)), inertia / likely, *window, says)


def _drive(run: Run, rig: Nameplate) -> tuple[Signal, float, bool] | None:
    """The driving signal, what it is worth in torque at the output, and whether that figure is known."""
    if rig.motion == "translational":
        forces = [s for s in run.select("force", role="input") if np.ptp(s.samples) > 0.0]
        if forces and run.experiment != "hammer":
            return forces[0], 1.0, forces[0].channel.calibrated
    try:
        torque = motor_torque(run, rig)
    except RefusedError:
        return None
    if torque is None or not torque.signed or torque.source.channel.quantity == "phase-current":
        return None
    if np.nanstd(torque.values) == 0.0 or not np.isfinite(torque.values).all():
        return None
    peak = float(np.nanmax(np.abs(torque.source.samples)))
    lever = float(np.nanmax(np.abs(torque.values))) / peak
    known = torque.unit == "N m" and rig.reduction_ratio is not None
    return torque.source, lever * (rig.reduction_ratio or 1.0) * (rig.efficiency or 1.0), known


def _apparent_inertia(
    run: Run, rig: Nameplate, source: Signal, lever: float, motion: Signal, band: float
) -> float | None:
    """J of T = J q'' + b q' + T_c sign(q') + gravity, by least squares below ``band``; ``None`` if not significant."""
    grid = common_grid([source, motion])
    if grid is None or band > 0.2 * grid.rate:
        return None
    torque = low_passed(lever * on_grid(source, grid), grid.rate, band)
    speed, acceleration = (as_motion(motion, grid, rig, band, order) for order in (1, 2))
    columns = [acceleration, speed, low_passed(np.tanh(20.0 * speed / np.std(speed)), grid.rate, band)]
    if ORDER[motion.channel.quantity] == 0:
        q = as_motion(motion, grid, rig, band, 0)
        q = q - q[0] + run.arm_angle
        if rig.plane == "vertical" and rig.motion == "rotational":
            # fitted even where m g r is known: in a wrong unit the torque holds it in that unit too
            columns += [np.cos(q), np.sin(q)] if np.ptp(q) > 0.3 else [np.cos(q)]
    A = np.column_stack([trimmed(c - c.mean(), grid, band) for c in columns])
    y = trimmed(torque - torque.mean(), grid, band)
    scale = np.linalg.norm(A, axis=0)
    if not (scale > 0.0).all():
        return None
    solution, _, rank, _ = np.linalg.lstsq(A / scale, y, rcond=1e-6)
    if rank < A.shape[1]:
        return None
    independent = max(8.0, 2.0 * band * y.size / grid.rate)  # a band-limited record has no more values than these
    noise = float(np.var(y - A / scale @ solution)) * y.size / max(independent - rank, 1.0)
    error = math.sqrt(noise * np.linalg.inv((A / scale).T @ (A / scale))[0, 0])
    if solution[0] < 0.0 and rig.plane != "vertical":
        power = trimmed(torque * speed, grid, band)
        if float(np.sum(power)) > _WORKED * float(np.sum(np.abs(power))):
            return None  # the drive works on it: friction holds it, and what looks like an inertia is a bristle's spring
    return float(solution[0] / scale[0]) if abs(solution[0]) > 6.0 * error else None
