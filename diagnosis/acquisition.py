"""Inputs as the machine felt them rather than as they were logged: clocks, lag, gain and slow logs undone."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.fft import irfft, next_fast_len, rfft, rfftfreq
from scipy.signal import cont2discrete, lfilter

from jointscope.diagnosis.folded import without_line
from jointscope.diagnosis.kernel.between import SHORTEST, quintic
from jointscope.recordings.bandlimited import OVERSAMPLING, Bandlimited

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly, Chain
    from jointscope.diagnosis.problem import PreparedRun

Vector = NDArray[np.float64]

_CONTINUED = 256  # samples of the log by which it is continued past its ends
_WEAKEST = 0.3  # an average's transfer is not divided by less than this


def shifted(signal: Bandlimited, run: PreparedRun, chain: Chain) -> Vector:
    """A late device's signal at the true half-step times: what happened at t was stamped (t + delay)(1 + clock)."""
    half = run.t0 + np.arange(2 * run.steps + 1) / (2.0 * run.grid_rate)
    return read(signal, (half + chain.delay) * (1.0 + chain.clock))


def read(signal: Bandlimited, times: Vector) -> Vector:
    """The signal at ``times`` [s] as it would read itself, in compiled steps, same shape."""
    coefficients, lead = signal.quintic
    if coefficients.size < SHORTEST:
        return signal(times)
    inside = np.clip(times, signal.start, signal.end)
    out = np.empty_like(inside)
    quintic(coefficients, (inside - signal.start) * (signal.rate * OVERSAMPLING) + lead, out)
    return out


def load_input(assembly: Assembly) -> Vector:
    """External torque on the arm at half steps [N m], shape (2 n + 1,): recorded over the sensor's true gain.

    A force that drives a carriage to and fro is an amplifier's, whose zero is not known; a hammer's is (no contact).
    """
    run, gain = assembly.run, assembly.chain.force_gain
    force = run.load_half if gain == 1.0 else run.load_half / gain
    offset = assembly.base("torque_offset")
    return force + offset if offset != 0.0 and carries(run) else force


def carries(run: PreparedRun) -> bool:
    """Whether the external force carries a free inertia along an observed path, so that its zero can be told."""
    return run.mode == "observer" and not run.motor_moves and not run.spring and run.load is not None


def driven_torque(assembly: Assembly) -> Vector:
    """eta n T_e at half steps [N m], shape (2 n + 1,)."""
    run, chain = assembly.run, assembly.chain
    if run.motor is None:
        return run.motor_half
    if run.late_motor and (chain.delay != 0.0 or chain.clock != 0.0):
        torque = shifted(run.motor.signal, run, chain)
    else:
        torque = run.motor_half
    age = assembly.base("torque_age")
    if age != 0.0:
        torque = aged(torque, age * 2.0 * run.grid_rate)
    if chain.log_line > 0.0:
        torque = without_line(torque, 2.0 * run.grid_rate, chain.log_line)
    if math.isfinite(chain.log_rate):
        rates = 2.0 * run.grid_rate, run.motor.signal.rate, chain.log_rate
        torque = relogged(torque, *rates, chain.log_kind, chain.log_age)
    for time_constant in chain.lags:
        torque = lagged(torque, time_constant, 2.0 * run.grid_rate)
    if chain.loop > 0.0:
        torque = looped(torque, chain.loop, 2.0 * run.grid_rate, chain.loop_damping)
    factor = assembly.base("efficiency") * assembly.base("torque_scale") * chain.torque_gain
    if chain.heat[0] != 0.0:
        torque = heated(torque, 0.5 * assembly.problem.scales.motor_torque, *chain.heat, 2.0 * run.grid_rate)
    offset = assembly.base("torque_offset")
    if offset != 0.0:
        torque = torque + offset
    driven = torque if factor == 1.0 else torque * factor
    if run.observed is None:
        return driven
    if chain.thinning[0] != 0.0:
        driven = driven - cold_drag(assembly)
    return driven - relaxing_pull(assembly) if chain.relaxing[0] != 0.0 else driven


def cold_drag(assembly: Assembly) -> Vector:
    """c exp(-E/t) v at half steps [N m], E = int (v/v_0)^2 dt: what grease drags that has not been worked, shape (2 n + 1,).

    v is the observed speed, v_0 half of the fastest run's. The grease is cold where a run begins.
    """
    run, (coefficient, time_constant) = assembly.run, assembly.chain.thinning
    step = 0.5 / run.grid_rate
    v = (
        run.observed_half
        if run.observed is not None and run.observed.rate_signal
        else np.gradient(run.observed_half, step)
    )
    reference = max(0.5 * assembly.problem.scales.motor_speed, 1e-12)
    worked = np.cumsum(np.square(v / reference)) * step
    return np.asarray(coefficient * np.exp(-worked / time_constant) * v)


def relaxing_pull(assembly: Assembly) -> Vector:
    """k (q - z), t z' = q - z at half steps [N m]: a spring that lets go by and by, slack where a run begins, shape (2 n + 1,).

    q is the observed angle, or the observed speed's integral.
    """
    run, (stiffness, time_constant) = assembly.run, assembly.chain.relaxing
    rate = 2.0 * run.grid_rate
    assert run.observed is not None
    q = np.cumsum(run.observed_half) / rate if run.observed.rate_signal else run.observed_half
    return np.asarray(stiffness * (q - lagged(q, time_constant, rate)))


@njit(cache=True, nogil=True, error_model="numpy")
def aged(u: Vector, steps: float) -> Vector:
    """``u`` later by a part of a step, by the parabola through three neighbours; it stays at its ends; shape of ``u``."""
    later = u.copy()
    slope, bend = 0.5 * steps, 0.5 * steps * steps
    for k in range(1, u.shape[0] - 1):
        later[k] += slope * (u[k - 1] - u[k + 1]) + bend * (u[k - 1] - 2.0 * u[k] + u[k + 1])
    return later


def heated(u: Vector, reference: float, share: float, time_constant: float, rate: float) -> Vector:
    """u (1 - share h), t h' = (u/reference)^2 - h from h = 0: a torque constant that falls as the motor warms; shape of ``u``."""
    warmth = lagged(np.concatenate([[0.0], np.square(u / reference)]), time_constant, rate)[1:]
    return u * np.maximum(1.0 - share * warmth, 0.1)


def lagged(u: Vector, time_constant: float, rate: float) -> Vector:
    """First-order lag, exact for an input that is linear between samples; settled at the first; shape of ``u``."""
    r = time_constant * rate
    decay = math.exp(-1.0 / r)
    b1 = 1.0 - r * (1.0 - decay)
    b0 = 1.0 - decay - b1
    return np.asarray(u[0] + lfilter([b1, b0], [1.0, -decay], u - u[0]), dtype=np.float64)


def looped(u: Vector, time_constant: float, rate: float, damping: float = math.sqrt(0.5)) -> Vector:
    """1/(1 + s t + (s t / 2 zeta)^2), exact for an input that is linear between samples; settled at the first; shape of ``u``.

    A closed current loop; after Kessler's magnitude optimum zeta^2 = 1/2, and t is twice the sum of its small delays.
    """
    squared = (2.0 * damping / time_constant) ** 2
    system = ([squared], [1.0, squared * time_constant, squared])
    b, a, _ = cont2discrete(system, 1.0 / rate, method="foh")
    return np.asarray(u[0] + lfilter(b.ravel(), a.ravel(), u - u[0]), dtype=np.float64)


def relogged(u: Vector, rate: float, stream_rate: float, log_rate: float, kind: str, age: float = 0.0) -> Vector:
    """The signal that a log held, averaged or thinned out at ``log_rate`` [Hz] stands for; shape of ``u``.

    Args:
        u: The log, sampled or interpolated at ``rate`` [Hz], shape (n,).
        rate: Of ``u``.
        stream_rate: Of the log's file.
        log_rate: The log's own.
        kind: ``held`` (a staircase), ``averaged`` (mean over the last interval), ``averaged-held`` (a staircase of such
            means), ``aliased`` (thinned without a filter, then drawn with straight lines) or ``folded`` (as it is).
        age: Of a value when it is first written [s]: updates and samples keep different times.
    """
    window = 1.0 / log_rate
    pad = min(u.size - 1, math.ceil(_CONTINUED * rate / stream_rate))
    size_of = next_fast_len(u.size + 2 * pad, real=True)
    padded = np.concatenate([np.full(pad, u[0]), u, np.full(size_of - u.size - pad, u[-1])])
    ramp = np.linspace(padded[0], padded[-1], padded.size)
    spectrum = rfft(padded - ramp)
    f = np.asarray(rfftfreq(padded.size, 1.0 / rate), dtype=np.float64)
    size = np.ones_like(f)
    delay = age
    if kind.startswith("averaged"):
        size = np.sinc(f * window)
        delay += 0.5 * window
    if kind.endswith("held"):
        size = size * _dirichlet(f, window, stream_rate)
        delay += 0.5 * max(window - 1.0 / stream_rate, 0.0)  # the sample at the update itself is on time
    if kind == "aliased":
        size = np.sinc(f * window) ** 2
    inverse = np.exp(2j * np.pi * f * delay) / np.maximum(np.abs(size), _WEAKEST)
    inverse = np.where(f <= 0.5 * log_rate, inverse, 0.0 if log_rate < stream_rate else 1.0)
    restored = irfft(spectrum * inverse, padded.size) + ramp
    return np.asarray(restored[pad : pad + u.size], dtype=np.float64)


def _dirichlet(f: Vector, window: float, rate: float) -> Vector:
    """Transfer of a hold over ``window`` seen at ``rate``: the mean of its repeated samples."""
    count = window * rate
    top = np.sinc(f * window)
    bottom = np.sinc(f / rate)
    return np.asarray(top / np.maximum(bottom, 0.1) if count > 1.0 else np.ones_like(f))
