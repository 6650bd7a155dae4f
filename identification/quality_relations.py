"""What the channels of one run owe each other: kinematics, and the rigid-body mechanics of the whole joint.

Each relation is a gain, measured over expected, that is 1 within a window where nothing is wrong.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import RefusedError
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
from jointscope.recordings.pulses import Pulse, find_pulses

Real = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Party:
    """A signal in a relation: multiplying it by s multiplies the relation's gain by s**exponent."""

    signal: Signal
    exponent: int


@dataclass(frozen=True, eq=False)
class Relation:
    """One thing that channels must agree on.

    Attributes:
        gain: Measured over expected, with its sign; only the sign counts where ``high`` is infinite.
        low: Smallest gain that is no contradiction.
        high: Largest.
        says: What was compared, for the message.
        hard: Whether it can accuse a channel by itself; soft ones only break ties.
    """

    parties: tuple[Party, ...]
    gain: float
    low: float
    high: float
    says: str
    hard: bool = True

    def holds(self, gain: float | None = None) -> bool:
        """Whether the gain, or another one, is inside the window."""
        return self.low <= (self.gain if gain is None else gain) <= self.high


def run_relations(run: Run, rig: Nameplate) -> Iterator[Relation]:
    """Every relation that the run's channels carry."""
    if run.experiment == "hammer":
        yield from _hits(run, rig)
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
    if channel.quantity != "linear-acceleration" or first.channel.quantity == "linear-acceleration":
        return motion
    if rig.plane == "vertical" and ORDER[first.channel.quantity] == 0 and channel.radius:
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


@dataclass(frozen=True)
class InertiaRange:
    """What the nameplate leaves possible [kg m^2]: least, likely and most; no upper bound where it is silent."""

    least: float
    likely: float
    most: float

    @property
    def known(self) -> bool:
        """Whether an inertia outside is a contradiction."""
        return math.isfinite(self.most)

    def __str__(self) -> str:
        return f"{self.least:.3g} to {self.most:.3g} kg m^2 is possible"


def whole_inertia(rig: Nameplate) -> InertiaRange:
    """Of motor and arm together, at the output."""
    J_M = 0.0
    if rig.motor_inertia is not None and rig.reduction_ratio is not None:
        J_M = (rig.motor_inertia + (rig.reducer_inertia or 0.0)) * rig.reduction_ratio**2
    arm = arm_inertia(rig)
    if J_M > 0.0 and arm.known:
        return InertiaRange(J_M + arm.least, J_M + arm.likely, J_M + arm.most)
    if J_M > 0.0:
        return InertiaRange(J_M, 2.0 * J_M, 30.0 * J_M)
    return InertiaRange(arm.least, 1.0, math.inf)


def arm_inertia(rig: Nameplate) -> InertiaRange:
    """Of the arm alone: with its centre of mass at r at least m r^2, hardly more than three times that."""
    if rig.inertia_reference is not None:
        return InertiaRange(0.8 * rig.inertia_reference, rig.inertia_reference, 1.25 * rig.inertia_reference)
    if rig.arm_mass is not None and rig.arm_com_radius:
        least = rig.arm_mass * rig.arm_com_radius**2
        return InertiaRange(least, 1.2 * least, 3.0 * least)
    return InertiaRange(0.0, 1.0, math.inf)


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
    return float(solution[0] / scale[0]) if abs(solution[0]) > 6.0 * error else None


def _hits(run: Run, rig: Nameplate) -> Iterator[Relation]:
    """While the hammer pushes, the arm beneath it accelerates with the push."""
    for force in run.select("force", role="input"):
        pulses = find_pulses(force.samples, force.sampling_rate, share=0.5)
        if not pulses:
            continue
        says = f"{force.channel.column}: a hammer only pushes"
        yield Relation((Party(force, 1),), math.copysign(1.0, pulses[0].height), 0.0, math.inf, says, hard=False)
        for quantity in ("linear-acceleration", "acceleration", "angular-acceleration"):
            for response in run.select(quantity, role="output"):
                if response.channel.direction == "tangential" and response.device == force.device:
                    yield from _driving_point(force, response, pulses[0], rig)


def _driving_point(force: Signal, response: Signal, pulse: Pulse, rig: Nameplate) -> Iterator[Relation]:
    peak, first, last = pulse.peak, pulse.first, pulse.last
    f = np.nan_to_num(force.samples - np.nanmedian(force.samples))
    a = np.nan_to_num(response.samples - np.nanmedian(response.samples[: max(first, 8)]))
    part = slice(max(0, first - 2), min(f.size, max(peak + 2, (peak + last) // 2 + 1)))
    norm = float(np.linalg.norm(f[part]) * np.linalg.norm(a[part]))
    noise = 1.4826 * float(np.median(np.abs(a[: max(first - 4, 8)])))
    if norm == 0.0 or np.max(np.abs(a[part])) < 8.0 * noise:
        return
    correlation = float(f[part] @ a[part]) / norm
    if abs(correlation) < 0.6:
        return
    parties = (Party(response, 1), Party(force, -1))
    says = f"{response.channel.column} right after the hit of {force.channel.column}"
    arm = arm_inertia(rig)
    mass = _apparent_mass(f, a, pulse, force.sampling_rate)
    radii = force.channel.radius and response.channel.radius
    known = radii and arm.known and force.channel.calibrated and response.channel.calibrated
    if not known or mass is None:
        yield Relation(parties, math.copysign(1.0, correlation), 0.0, math.inf, says)
        return
    lever = float(force.channel.radius or 1.0)
    if response.channel.quantity == "linear-acceleration":
        lever *= float(response.channel.radius or 1.0)
    gain = math.copysign(arm.likely / (abs(mass) * lever), correlation)
    says += f", apparent inertia {abs(mass) * lever:.3g} kg m^2 where {arm}"
    yield Relation(parties, gain, 0.5 * arm.likely / arm.most, 2.0 * arm.likely / arm.least, says)


def _apparent_mass(f: Real, a: Real, pulse: Pulse, rate: float) -> float | None:
    """J in A = F/(J + c/(j w) - K/w^2) over the lines that stand out of the noise; ``None`` if vague.

    Fitted together with stiffness and damping, so that a soft tip that excites only below the resonance is no inertia;
    weighted so that the response's error is least (Sanathanan and Koerner, 1963).

    Args:
        f: Force of one hit, shape (n,), zero at rest.
        a: Response, likewise.
    """
    contact = slice(max(0, pulse.first - 4), pulse.last + 5)
    F = np.fft.rfft(np.concatenate([np.zeros(contact.start), f[contact], np.zeros(f.size - contact.stop)]))
    A = np.fft.rfft(a)
    quiet = a[: pulse.first - 4] if pulse.first >= 20 else a[-a.size // 10 :]
    noise = float(np.std(quiet)) * math.sqrt(a.size)
    omega = 2.0 * math.pi * np.fft.rfftfreq(f.size, 1.0 / rate)
    used = (np.abs(A) > 6.0 * noise) & (np.abs(F) > 0.3 * np.abs(F[1:8]).max()) & (omega > 0.0)
    if np.count_nonzero(used) < 16:
        return None
    F, A, omega = F[used], A[used], omega[used]
    columns = np.column_stack([A, A / (1j * omega), -A / omega**2])  # (lines, 3)
    weight = np.abs(A / F)
    for _ in range(4):
        M = np.concatenate([(columns * weight[:, None]).real, (columns * weight[:, None]).imag])
        y = np.concatenate([(F * weight).real, (F * weight).imag])
        scale = np.linalg.norm(M, axis=0)
        solution, _, rank, _ = np.linalg.lstsq(M / scale, y, rcond=1e-9)
        if rank < 3:
            return None
        J, c, K = solution / scale
        weight = 1.0 / np.abs(J + c / (1j * omega) - K / omega**2)
    variance = float(np.sum((y - M / scale @ solution) ** 2)) / (y.size - 3)
    error = math.sqrt(variance * np.linalg.inv((M / scale).T @ (M / scale))[0, 0]) / scale[0]
    # without lines well above the resonance the inertia is a matter of the model, not of the data
    inertial = K <= 0.0 or omega[-1] > 1.5 * math.sqrt(K / abs(J))
    return float(J) if inertial and abs(J) > 10.0 * error else None
