r"""Signed torque from three phase currents alone: no encoder, only the current vector and, if there is one, the speed command.

Three phases i_k = -i_q sin(p theta - 2 pi k/3) make the vector v = -j (2/3) sum_k i_k e^(j 2 pi k/3) = i_q e^(j p theta)
(Clarke). Its square has no sign to lose, so 2 p theta is followed through every change of sign of i_q: a Kalman
filter and smoother over [p theta, its rate] whose measurement is the angle of v^2, worth as much as |v| stands above the
noise, and whose prediction turns with the commanded speed. What is left open is one sign for the whole run; gravity
gives it: at rest the torque is known to hold the arm. Where the current stays small for so long that the rotor may have
turned by more than a quarter of an electrical turn unseen, the sign behind that place is a guess, and the place is reported.

The noise is what the phases' sum shows, which the currents themselves can't reach.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray

from jointscope.errors import RefusedError
from jointscope.recordings.bandlimited import resampled
from jointscope.recordings.campaign import Nameplate, Run, Signal
from jointscope.recordings.motor_torque import envelope

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

_DOUBT = 0.5  # rad: one standard deviation at which a half turn of the vector can be mistaken (a quarter turn is 3 of them)
_HEARD = 5.0  # noise standard deviations above which a vector's angle counts: noise alone never gets there


@dataclass(frozen=True, kw_only=True)
class Doubt:
    """A place where the sign of the torque may have been lost: between ``start`` and ``end`` [s] the current was small."""

    start: float
    end: float


@dataclass(frozen=True, kw_only=True, eq=False)
class TorqueFromCurrents:
    """T_e from the current vector.

    Attributes:
        values: T_e on the motor shaft [N m], shape (n,).
        times: On the run's clock [s], shape (n,).
        rate: [Hz].
        electrical_angle: p theta, up to a constant multiple of half a turn [rad], shape (n,).
        doubts: Where the sign is ambiguous; empty where it is safe throughout.
        anchored: Whether gravity fixed the sign at the start.
        noise: Standard deviation of the current's noise [A].
    """

    values: Real
    times: Real
    rate: float
    electrical_angle: Real
    doubts: tuple[Doubt, ...]
    anchored: bool
    noise: float


def current_vector(phases: tuple[Real, Real, Real]) -> Complex:
    """i_q e^(j p theta) [A], shape (n,), from phases u, v, w (Clarke, amplitude kept)."""
    u, v, w = phases
    turn = np.exp(2j * np.pi / 3.0)
    return np.asarray(-2j / 3.0 * (u + v * turn + w * turn**2), dtype=np.complex128)


def current_noise(phases: tuple[Real, Real, Real]) -> float:
    """Standard deviation of one phase's noise [A], from what keeps their sum from zero (an offset is no noise)."""
    total = np.sum(phases, axis=0)
    if float(np.max(np.abs(total))) > 1e-9 * float(np.max(np.abs(phases))):
        return float(np.std(total) / math.sqrt(3.0))
    # two measured phases and a third made from them: the sum says nothing; what is left is the samples' own roughness,
    # fourth differences of white noise having 70 times its variance
    rough = [float(np.median(np.abs(np.diff(phase, 4)))) / (0.6745 * math.sqrt(70.0)) for phase in phases[:2]]
    return max(rough)


def torque_from_currents(
    run: Run, rig: Nameplate, holding_torque: float, joint: str | None = None
) -> TorqueFromCurrents:
    """Signed T_e of ``run`` from its phase currents and, where there is one, its speed command. Outputs aren't read.

    Args:
        run: Has three phase currents.
        rig: Torque constant, pole pairs and the motor's inertia.
        holding_torque: That the motor needs to hold the arm at the start [N m on its shaft]; its sign counts.
        joint: Whose motor; any where ``None``.

    Raises:
        RefusedError: Phases or nameplate values are missing.
    """
    phases = [s for s in run.select("phase-current", location="motor") if joint in (None, s.channel.joint)]
    if len(phases) < 3:
        raise RefusedError(f"run {run.id}: {len(phases)} phase currents; the vector needs three of one device")
    if rig.torque_constant is None or rig.pole_pairs is None:
        missing = "torque_constant" if rig.torque_constant is None else "pole_pairs"
        raise RefusedError(f"run {run.id}: phase currents need rig.{missing} to become a torque")
    first = phases[0]
    peak = math.sqrt(2.0) if first.channel.per == "rms" else 1.0
    u, v, w = (peak * phase.samples for phase in phases[:3])
    vector, noise = current_vector((u, v, w)), current_noise((u, v, w))
    commands = [s for s in run.select("speed-command", role="input") if joint in (None, s.channel.joint)]
    turning = rig.pole_pairs * _on(commands[0], first) if commands else np.zeros(vector.size)
    restless = _restlessness(vector, rig, rig.torque_constant, rig.pole_pairs)
    angle, before, heard = follow_vector(vector, first.sampling_rate, turning, noise, restless)
    current = np.real(vector * np.exp(-1j * angle))
    lead = max(8, int(0.02 * first.sampling_rate))
    anchored = abs(np.mean(current[:lead])) > 3.0 * noise / math.sqrt(lead) and holding_torque != 0.0
    if anchored and np.mean(current[:lead]) * holding_torque < 0.0:
        current, angle = -current, angle + np.pi
    return TorqueFromCurrents(
        values=rig.torque_constant * current,
        times=first.times,
        rate=first.sampling_rate,
        electrical_angle=angle,
        doubts=_doubts(before, heard, first.times),
        anchored=bool(anchored),
        noise=noise,
    )


def envelope_torque(run: Run, rig: Nameplate, joint: str | None = None) -> Real:
    """\\|T_e\\| [N m], shape (n,), from the first phase's Hilbert envelope (paper, Equations 28-29).

    Raises:
        RefusedError: No phase current, or no torque constant.
    """
    phases = [s for s in run.select("phase-current", location="motor") if joint in (None, s.channel.joint)]
    if not phases or rig.torque_constant is None:
        raise RefusedError(f"run {run.id}: the envelope needs a phase current and rig.torque_constant")
    return rig.torque_constant * envelope(phases[0].samples)


def follow_vector(
    vector: Complex, rate: float, turning: Real, noise: float, restlessness: float
) -> tuple[Real, Real, NDArray[np.bool_]]:
    """Follow p theta of i_q e^(j p theta) through changes of sign of i_q.

    Args:
        vector: Shape (n,) [A].
        rate: [Hz].
        turning: Expected d(p theta)/dt [rad/s], shape (n,); zeros where nothing is known.
        noise: Of each component of the vector [A].
        restlessness: Spectral density of what turns the rotor unexpectedly [rad^2/s^3].

    Returns:
        p theta up to a half turn [rad]; its standard deviation just before each sample was heard [rad]; and which samples
        were heard; shape (n,) each.
    """
    angle, before, heard = _kalman(
        np.ascontiguousarray(vector),
        1.0 / rate,
        np.ascontiguousarray(turning),
        max(noise, 1e-9),
        restlessness,
        _HEARD,
    )
    return angle, before, heard


def _on(signal: Signal, clock: Signal) -> Real:
    return resampled(signal.samples, signal.sampling_rate, signal.stream.start, clock.times)


def _restlessness(vector: Complex, rig: Nameplate, torque_constant: float, pole_pairs: int) -> float:
    """Density of the electrical acceleration that the currents themselves can cause on a bare rotor, 10 ms at a time."""
    inertia = (rig.motor_inertia or 0.0) + (rig.reducer_inertia or 0.0)
    if inertia <= 0.0:
        inertia = 1e-4
    acceleration = (
        pole_pairs * torque_constant * float(np.std(np.abs(vector)) + 0.1 * np.mean(np.abs(vector))) / inertia
    )
    return 0.01 * acceleration**2


def _doubts(before: Real, heard: NDArray[np.bool_], times: Real) -> tuple[Doubt, ...]:
    """Gaps between heard samples at whose end the angle had become uncertain."""
    doubts: list[Doubt] = []
    index = np.flatnonzero(heard)
    if index.size == 0:
        return (Doubt(start=float(times[0]), end=float(times[-1])),)
    for place in np.flatnonzero(heard & (before > _DOUBT)):
        if place == index[0]:
            continue  # before the first heard sample there is nothing to lose
        last = index[np.searchsorted(index, place) - 1]
        start, end = float(times[last]), float(times[place])
        if doubts and start - doubts[-1].end < 0.01:
            doubts[-1] = Doubt(start=doubts[-1].start, end=end)
        else:
            doubts.append(Doubt(start=start, end=end))
    return tuple(doubts)


@numba.njit(cache=True)
def _kalman(vector, dt, turning, noise, density, heard_above):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    """Forward filter over [angle, unexpected rate] and Rauch-Tung-Striebel smoother; modulus ambiguity pi."""
    n = vector.size
    x = np.empty((n, 2))  # filtered
    P = np.empty((n, 3))  # p11, p12, p22
    xm = np.empty((n, 2))  # predicted
    Pm = np.empty((n, 3))
    before = np.empty(n)
    heard = np.zeros(n, dtype=np.bool_)
    a, w = 0.5 * np.angle(vector[0] * vector[0]), 0.0
    p11, p12, p22 = 2.5, 0.0, density * 0.1
    for i in range(n):
        if i > 0:
            a += dt * (w + 0.5 * (turning[i] + turning[i - 1]))
            p11 += dt * (2.0 * p12 + dt * p22) + density * dt**3 / 3.0
            p12 += dt * p22 + density * dt**2 / 2.0
            p22 += density * dt
        xm[i, 0], xm[i, 1] = a, w
        Pm[i, 0], Pm[i, 1], Pm[i, 2] = p11, p12, p22
        before[i] = np.sqrt(p11)
        size = abs(vector[i])
        if size > heard_above * noise:
            heard[i] = True
            r = (noise / size) ** 2
            turned = vector[i] * np.exp(-1j * a)
            error = 0.5 * np.angle(turned * turned)
            s = p11 + r
            k1, k2 = p11 / s, p12 / s
            a += k1 * error
            w += k2 * error
            p22 -= k2 * p12
            p12 -= k1 * p12
            p11 -= k1 * p11
        x[i, 0], x[i, 1] = a, w
        P[i, 0], P[i, 1], P[i, 2] = p11, p12, p22
    out = np.empty(n)
    sa, sw = x[n - 1, 0], x[n - 1, 1]
    out[n - 1] = sa
    for i in range(n - 2, -1, -1):
        det = Pm[i + 1, 0] * Pm[i + 1, 2] - Pm[i + 1, 1] ** 2
        if det <= 0.0:
            out[i] = x[i, 0]
            sa, sw = x[i, 0], x[i, 1]
            continue
        i11, i12, i22 = Pm[i + 1, 2] / det, -Pm[i + 1, 1] / det, Pm[i + 1, 0] / det
        c11 = P[i, 0] + dt * P[i, 1]  # P F'
        c12 = P[i, 1]
        c21 = P[i, 1] + dt * P[i, 2]
        c22 = P[i, 2]
        g11, g12 = c11 * i11 + c12 * i12, c11 * i12 + c12 * i22
        g21, g22 = c21 * i11 + c22 * i12, c21 * i12 + c22 * i22
        da, dw = sa - xm[i + 1, 0], sw - xm[i + 1, 1]
        sa = x[i, 0] + g11 * da + g12 * dw
        sw = x[i, 1] + g21 * da + g22 * dw
        out[i] = sa
    return out, before, heard
