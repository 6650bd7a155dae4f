"""From the model's states to what each instrument writes down.

Order of the chain: the motion at the sensor, gravity and centripetal parts along its axis, sensitivity, mount
resonance, high-pass of an ac coupling, the recorder's clock and anti-aliasing, saturation.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.fft
from numba import njit
from numpy.typing import NDArray

from jointscope.diagnosis import kernel
from jointscope.diagnosis.assembly import beyond
from jointscope.diagnosis.superposition import superposed
from jointscope.diagnosis.wind_up import WIND_UP
from jointscope.recordings.campaign import FORCES, gearing
from jointscope.recordings.drift import FOLLOWING

if TYPE_CHECKING:
    from jointscope.diagnosis.assembly import Assembly
    from jointscope.diagnosis.problem import Output, PreparedRun

Vector = NDArray[np.float64]

REACH = 20  # half width of the recorder's anti-aliasing kernel [samples of the slower rate]
_BLOCK = 1024  # outputs side by side, which stay in the nearest cache
_TABLE = 512  # entries per sample of its table
_ON_NODE = 1e-6  # of a node's distance from the next, within which a time is at the node
_MOST_ALIKE = 8  # samples that may lie differently to the nodes, each with taps of its own
_KAISER = 10.0
SMOOTH = (*FOLLOWING, WIND_UP)  # nothing in them reaches half the rate
ACCELERATIONS = ("linear-acceleration", "angular-acceleration", "acceleration")


@lru_cache(maxsize=1)
def _table() -> Vector:
    offset = np.arange(REACH * _TABLE + 2) / _TABLE
    window = np.i0(_KAISER * np.sqrt(np.clip(1.0 - (offset / REACH) ** 2, 0.0, 1.0))) / np.i0(_KAISER)
    return np.asarray(np.sinc(offset) * window * (offset <= REACH), dtype=np.float64)


@njit(cache=True, nogil=True, error_model="numpy")
def _extended(x: Vector, k: int) -> float:
    """Node ``k`` of ``x``, odd about its ends."""
    n = x.shape[0]
    if k < 0:
        return float(2.0 * x[0] - x[min(-k, n - 1)])
    if k >= n:
        return float(2.0 * x[n - 1] - x[max(2 * n - 2 - k, 0)])
    return float(x[k])


@njit(cache=True, nogil=True, error_model="numpy")
def _read(x: Vector, rate: float, t0: float, times: Vector, cutoff: float, table: Vector, out: Vector) -> None:
    """``x`` on a grid of ``rate`` from ``t0``, band-limited below half of ``cutoff``, at ``times``; odd at the ends."""
    wide = REACH * rate / cutoff
    for i in range(times.shape[0]):
        at = (times[i] - t0) * rate
        first = math.ceil(at - wide)
        last = math.floor(at + wide)
        total, weight = 0.0, 0.0
        for j in range(first, last + 1):
            position = abs(j - at) * cutoff / rate * _TABLE
            cell = int(position)
            part = position - cell
            h = table[cell] + part * (table[cell + 1] - table[cell])
            total += h * _extended(x, j)
            weight += h
        out[i] = total / weight


@njit(cache=True, nogil=True, error_model="numpy")
def _phase(phases: Vector, node: int, first: int, count: int) -> Vector:
    """Every step-th sample of what ``phases`` holds, shape (step, n), ``count`` of them from ``node`` + ``first`` steps on."""
    step = phases.shape[0]
    at = first + node // step
    return phases[node % step, at : at + count]


@njit(cache=True, nogil=True, error_model="numpy")
def _decimate(x: Vector, step: int, first: int, taps: Vector, out: Vector) -> None:
    """``out[i]`` of the nodes from ``first + i step`` on, weighed by ``taps``: the same where the wanted times are so spaced.

    The number of taps is a multiple of four.
    """
    n, count, width = x.shape[0], out.shape[0], taps.shape[0]
    begin = min(max((step - 1 - first) // step, 0), count)  # inside, no tap reaches beyond an end
    end = max(min((n - width - first) // step + 1, count), begin)
    phases = np.empty((step, n // step + 1))
    for p in range(step):
        for k in range((n - p + step - 1) // step):
            phases[p, k] = x[p + k * step]
    for start in range(begin, end, _BLOCK):
        block = out[start : min(start + _BLOCK, end)]
        block[:] = 0.0
        for j in range(0, width, 4):  # four taps at a time: the block is read and written a quarter as often
            a = _phase(phases, first + j, start, block.size)
            b = _phase(phases, first + j + 1, start, block.size)
            c = _phase(phases, first + j + 2, start, block.size)
            d = _phase(phases, first + j + 3, start, block.size)
            h_a, h_b, h_c, h_d = taps[j], taps[j + 1], taps[j + 2], taps[j + 3]
            for i in range(block.size):
                block[i] += h_a * a[i] + h_b * b[i] + h_c * c[i] + h_d * d[i]
    for i in range(count):
        if begin <= i < end:
            continue
        total = 0.0
        for j in range(width):
            total += taps[j] * _extended(x, first + i * step + j)
        out[i] = total


@njit(cache=True, nogil=True, error_model="numpy")
def _between(x: Vector, rate: float, t0: float, times: Vector, out: Vector) -> None:
    """``x`` on a grid of ``rate`` from ``t0`` at ``times`` by Lagrange's cubic through four nodes."""
    n = x.shape[0]
    for i in range(times.shape[0]):
        at = (times[i] - t0) * rate
        k = min(max(math.floor(at), 1), n - 3)
        s = min(max(at, -0.5), n - 0.5) - k
        a, b, c, d = x[k - 1], x[k], x[k + 1], x[k + 2]
        out[i] = (
            -a * s * (s - 1.0) * (s - 2.0) / 6.0
            + b * (s + 1.0) * (s - 1.0) * (s - 2.0) / 2.0
            - c * (s + 1.0) * s * (s - 2.0) / 2.0
            + d * (s + 1.0) * s * (s - 1.0) / 6.0
        )


@lru_cache(maxsize=256)
def _taps(part: float, ratio: float) -> tuple[int, Vector]:
    """Weights of the nodes about a time ``part`` of a node past one, by ``ratio`` nodes per sample: the first, and all."""
    first, last = math.ceil(part - REACH * ratio), math.floor(part + REACH * ratio)
    nodes = np.arange(first, first + 4 * (-(-(last - first + 1) // 4)))
    taps = np.interp(np.abs(nodes - part) * _TABLE / ratio, np.arange(_table().size), _table())
    taps[nodes > last] = 0.0
    return first, np.asarray(taps / taps.sum())


def _commensurate(ratio: float) -> int:
    """Samples after which a grid of ``ratio`` nodes per sample meets them alike again; 0 where that is too many."""
    alike = (q for q in range(1, _MOST_ALIKE + 1) if abs(q * ratio - round(q * ratio)) < 1e-9 * q * ratio)
    return next(alike, 0)


def recorded(x: Vector, grid_rate: float, t0: float, times: Vector, rate: float) -> Vector:
    """What a recorder of ``rate`` [Hz] holds at ``times`` [s] of a signal on the grid, shape of ``times``.

    Band-limited below half of ``rate``, as the campaign format says that a sample is.
    """
    out = np.empty(times.size)
    ratio = grid_rate / rate
    every = _commensurate(ratio)
    if not every or abs((times[-1] - times[0]) * rate - (times.size - 1)) > 1e-6:
        _read(x, grid_rate, t0, times, min(rate, grid_rate), _table(), out)
        return out
    for k in range(min(every, times.size)):
        at = (times[0] - t0) * grid_rate + k * ratio
        node = math.floor(at + _ON_NODE)
        part = at - node if at - node > _ON_NODE else 0.0
        if ratio == 1.0 and part == 0.0:
            return np.asarray(x[node : node + times.size], dtype=np.float64).copy()
        first, taps = _taps(part, max(ratio, 1.0))
        samples = np.empty(out[k::every].size)
        _decimate(x, round(every * ratio), node + first, taps, samples)
        out[k::every] = samples
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def _high_passed(x: Vector, b: float, a: float, before: float) -> Vector:
    """y_k = b (x_k - x_{k-1}) + a y_{k-1}, settled at ``before``."""
    out = np.empty(x.shape[0])
    y = 0.0
    for k in range(x.shape[0]):
        y = b * (x[k] - before) + a * y
        before = x[k]
        out[k] = y
    return out


def high_pass(x: Vector, corner: float, rate: float, settled: float | None = None) -> Vector:
    """First-order high-pass at ``corner`` [Hz], settled at ``settled`` or at the first sample; same shape."""
    k = math.tan(math.pi * corner / rate)
    before = float(x[0]) if settled is None else settled
    return np.asarray(_high_passed(np.ascontiguousarray(x), 1.0 / (1.0 + k), (1.0 - k) / (1.0 + k), before))


def mount_resonance(x: Vector, frequency: float, damping: float, rate: float) -> Vector:
    """w^2/(s^2 + 2 zeta w s + w^2) at ``frequency`` [Hz] of a signal sampled at ``rate`` [Hz], settled at first."""
    return _passed(x, rate, lambda f: 1.0 / (1.0 - (f / frequency) ** 2 + 2j * damping * f / frequency))


def low_pass(x: Vector, corner: float, rate: float) -> Vector:
    """1/(1 + s/w) at ``corner`` [Hz] of a signal sampled at ``rate`` [Hz], settled at the first sample; same shape."""
    return _passed(x, rate, lambda f: 1.0 / (1.0 + 1j * f / corner))


def _passed(x: Vector, rate: float, transfer: Callable[[Vector], NDArray[Any]]) -> Vector:
    """``x`` through an analogue transfer function of f [Hz], exact for what the grid can hold.

    A discrete filter would be 10 % of the effect off at a sixth of the rate.
    """
    pad = max(1024, x.size // 8)
    size = scipy.fft.next_fast_len(x.size + 2 * pad, real=True)
    tail = np.linspace(x[-1], x[0], size - x.size - pad)
    padded = np.concatenate([np.full(pad, x[0]), x, tail]) - x[0]
    f = np.asarray(np.fft.rfftfreq(size, 1.0 / rate), dtype=np.float64)
    passed = scipy.fft.irfft(scipy.fft.rfft(padded) * transfer(f), size)
    return np.asarray(passed[pad : pad + x.size] + x[0], dtype=np.float64)


def observe(states: Vector, assembly: Assembly, run: PreparedRun, output: Output) -> Vector:
    """One channel's prediction, shape of ``output.data``, from the kernel's rows, shape (n + 1, kernel.N_OUT)."""
    chain = assembly.chain
    x = _at_sensor(states, assembly, run, output)
    sensors = chain.sensors(output) if output.quantity in ACCELERATIONS else ()
    if output.quantity in ACCELERATIONS:
        for sensor in sensors:
            if sensor.gain != 1.0:
                x = sensor.gain * x
            if math.isfinite(sensor.resonance):
                x = mount_resonance(x, sensor.resonance, sensor.resonance_damping, run.grid_rate)
            if math.isfinite(sensor.bandwidth):
                x = low_pass(x, sensor.bandwidth, run.grid_rate)
        if output.low_cutoff is not None:
            x = high_pass(x, output.low_cutoff, run.grid_rate, _at_rest(states, assembly, run, output))
    if output.high_pass is not None:
        x = high_pass(x, output.high_pass, run.grid_rate)
    times = output.times
    if output.late and (chain.delay != 0.0 or chain.clock != 0.0):
        times = times / (1.0 + chain.clock) - chain.delay
    if output.quantity in SMOOTH:
        y = _smooth(x, run, times - (chain.encoder_delay if _of_arm_encoder(output) else 0.0))
        if output.quantity == WIND_UP and chain.encoder_delay != 0.0:
            q = np.ascontiguousarray(states[:, kernel.X_Q])
            y += _smooth(q, run, times) - _smooth(q, run, times - chain.encoder_delay)
    else:
        y = recorded(x, run.grid_rate, run.t0, times, output.rate)
    for sensor in sensors:
        if not math.isfinite(sensor.saturation):
            continue
        if math.isfinite(sensor.knee):
            y = y / np.power(1.0 + np.power(np.abs(y) / sensor.saturation, sensor.knee), 1.0 / sensor.knee)
        else:
            y = np.clip(y, -sensor.saturation, sensor.saturation)
    return y


def _at_rest(states: Vector, assembly: Assembly, run: PreparedRun, output: Output) -> float | None:
    """What an accelerometer reads before a run that begins at rest, whatever noise its input's first sample holds."""
    if run.run.initial != "rest":
        return None
    if output.quantity != "linear-acceleration" or output.location == "motor":
        return 0.0
    still = _specific_force(states[:1], np.zeros(1), assembly, output)
    return math.prod(sensor.gain for sensor in assembly.chain.sensors(output)) * float(still[0])


def _of_arm_encoder(output: Output) -> bool:
    return output.location != "motor" and output.quantity in FOLLOWING


def _smooth(x: Vector, run: PreparedRun, times: Vector) -> Vector:
    y = np.empty(times.size)
    _between(x, run.grid_rate, run.t0, times, y)
    return y


def _at_sensor(states: Vector, assembly: Assembly, run: PreparedRun, output: Output) -> Vector:
    """The physical quantity at the sensor on the simulation grid, in the output's unit."""
    quantity, motor = output.quantity, output.location == "motor"
    n = gearing(quantity, output.location, run.ratio)
    q, v, a = (
        (kernel.X_QS, kernel.X_VS, kernel.X_AS) if motor and run.spring else (kernel.X_Q, kernel.X_V, kernel.X_A)
    )
    if quantity in ("angle", "position"):
        column = states[:, q]  # of a rigid axis the motor turns as the arm does
        return np.asarray((column - column[0] + run.initial_angle) * n)
    if quantity == WIND_UP:
        return np.asarray(states[:, kernel.X_QS] - states[:, kernel.X_Q])
    if quantity in ("angular-velocity", "velocity"):
        return np.asarray(states[:, v] * n if motor else states[:, v])
    if quantity in FORCES and run.mode == "prescribed-load":
        return np.asarray(states[:, kernel.X_TEXT] / (output.radius or 1.0))
    if quantity in FORCES:
        column = states[:, kernel.X_TEXT if run.mode == "prescribed-motor" else kernel.X_TAU]
        return np.asarray(column / assembly.drive_factor)
    if motor:
        return np.asarray(states[:, a] * n)
    acceleration = states[:, kernel.X_A]
    if assembly.S[kernel.AT_LINK] >= 0 and assembly.P[kernel.LINK_SENSE] != 0.0:
        follows = beyond(output.radius, assembly.elbow, assembly.curve) if output.radius else 1.0
        acceleration = acceleration + follows * assembly.P[kernel.LINK_SENSE] * states[:, kernel.X_LINK]
    if assembly.S[kernel.AT_BASE] >= 0:
        lever = assembly.P[kernel.BASE_TURN] + assembly.P[kernel.BASE_SLIDE] / (output.radius or math.inf)
        if lever != 1.0:
            acceleration = acceleration + (lever - 1.0) * states[:, kernel.X_MOUNT]
    if assembly.bends.shapes:
        acceleration = superposed(acceleration, assembly, run, output)
    if quantity != "linear-acceleration":
        return np.asarray(acceleration)
    return _specific_force(states, np.asarray(acceleration), assembly, output)


def _specific_force(states: Vector, acceleration: Vector, assembly: Assembly, output: Output) -> Vector:
    """Accelerometer on the arm: tangential r q'' + g cos q, radial -r q'^2 + g sin q, mixed by its tilt [m/s^2]."""
    radius = output.radius or 1.0
    tilt, g = sum(sensor.tilt for sensor in assembly.chain.sensors(output)), output.gravity
    radial = output.direction == "radial"
    along, across = (math.sin(tilt), math.cos(tilt)) if radial else (math.cos(tilt), math.sin(tilt))
    if radial:
        along = -along
    if g == 0.0 and across == 0.0:
        return along * radius * acceleration
    return np.asarray(_mixed(states, acceleration, along, across, radius, g))


@njit(cache=True, nogil=True, error_model="numpy")
def _mixed(states: Vector, acceleration: Vector, along: float, across: float, radius: float, g: float) -> Vector:
    """along (r q'' + g cos q) + across (g sin q - r q'^2), the cosine expanded about a nearby angle (1e-8)."""
    out = np.empty(acceleration.shape[0])
    centre, cosine, sine = 1e9, 0.0, 0.0
    for k in range(out.shape[0]):
        q, v = states[k, 3], states[k, 4]
        d = q - centre
        if abs(d) > 0.02:
            centre, cosine, sine, d = q, math.cos(q), math.sin(q), 0.0
        even, odd = 1.0 - 0.5 * d * d, d - d * d * d / 6.0
        up, out_ = cosine * even - sine * odd, sine * even + cosine * odd
        out[k] = along * (radius * acceleration[k] + g * up) + across * (g * out_ - radius * v * v)
    return out


assert (kernel.X_Q, kernel.X_V) == (3, 4)  # columns that _mixed reads
