r"""What users of a joint care about, in closed form for many parameter sets at once.

Time responses come from the transfer functions through a damped inverse Fourier transform: evaluated at
s = sigma + j w, the response is damped by exp(-sigma t), so the periodic images of the transform vanish, and
multiplying by exp(sigma t) gives it back.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointscope.models.parameters import Joint

Array = NDArray[np.float64]
Complex = NDArray[np.complexfloating]

HAMMER_RATE, HAMMER_RECORD = 4096.0, 1.0  # [Hz], [s]: fine enough for a contact of a few milliseconds
SWEEP_RATE, SWEEP_RECORD = 1024.0, 3.0  # [Hz], [s]
HAMMER_PEAK, HAMMER_CONTACT = 200.0, 6e-3  # [N], [s]
HAMMER_RADIUS = 0.8  # [m]
ACCELEROMETER_RADIUS = 0.95  # [m]
SWEEP_TORQUE, SWEEP_FROM, SWEEP_TO = 1.0, 4.0, 80.0  # [N m on the motor shaft], [Hz], [Hz]
HAMMER_BAND, SWEEP_BAND = (2.0, 50.0), (10.0, 75.0)  # [Hz]


@dataclass(frozen=True, kw_only=True)
class Grid:
    """Times [s], over twice the record, and Laplace points [rad/s] of the damped transform."""

    times: Array
    rate: float
    sigma: float
    s: Complex


def damped_grid(rate: float, record: float) -> Grid:
    """The grid for responses of ``record`` [s] sampled at ``rate`` [Hz]."""
    count = int(2 * record * rate)
    sigma = 8.0 / (2.0 * record)
    w = 2.0 * math.pi * np.fft.rfftfreq(count, 1.0 / rate)
    return Grid(times=np.arange(count) / rate, rate=rate, sigma=sigma, s=sigma + 1j * w)


def hammer_force(times: Array) -> Array:
    """The half-sine pulse [N] at ``times`` [s]."""
    inside = (times >= 0.0) & (times <= HAMMER_CONTACT)
    return np.where(inside, HAMMER_PEAK * np.sin(np.pi * times / HAMMER_CONTACT), 0.0)


def sweep_torque(times: Array) -> Array:
    """The linear 4-80 Hz sweep on the motor shaft [N m] at ``times`` [s], zero after the record."""
    phase = 2.0 * np.pi * (SWEEP_FROM * times + (SWEEP_TO - SWEEP_FROM) / (2.0 * SWEEP_RECORD) * times**2)
    return np.where(times <= SWEEP_RECORD, SWEEP_TORQUE * np.sin(phase), 0.0)


def response(transfer: Complex, drive: Array, grid: Grid) -> Array:
    """The first half of the response to ``drive``, shape (..., n // 2); ``transfer`` is given at ``grid.s``."""
    damped = np.fft.rfft(drive * np.exp(-grid.sigma * grid.times))
    answer = np.fft.irfft(transfer * damped, n=grid.times.size) * np.exp(grid.sigma * grid.times)
    return np.asarray(answer[..., : grid.times.size // 2])


def band_rms(signal: Array, rate: float, band: tuple[float, float]) -> Array:
    """Root mean square of what ``signal`` holds in ``band`` [Hz], shape (...,)."""
    spectrum = np.fft.rfft(signal) / signal.shape[-1]
    f = np.fft.rfftfreq(signal.shape[-1], 1.0 / rate)
    inside = (f >= band[0]) & (f <= band[1])
    return np.asarray(np.sqrt(2.0 * np.sum(np.abs(spectrum[..., inside]) ** 2, axis=-1)))


def transfers(p: dict[str, Array], s: Complex) -> tuple[Complex, Complex]:
    """Hammer accelerance (17) s^2 and shaft torque to arm acceleration eta n G_a (7, 11), each shape (samples, len(s))."""
    J_M = (p["motor_inertia"] + p["reducer_inertia"]) * p["reduction_ratio"] ** 2
    J_L, K, c, b_m, b_l = (p[k] for k in ("load_inertia", "stiffness", "damping", "motor_damping", "load_damping"))
    hammer = s**2 / (J_L * s**2 + (c + b_l) * s + K)
    shaft = c * s + K
    # torque balance of (4) eliminated for the motor side; the same D(s) as (5)
    D = (J_M * s + b_m) * (J_L * s**2 + (b_l + c) * s + K) + shaft * (J_L * s + b_l)
    return hammer, p["efficiency"] * p["reduction_ratio"] * s * shaft / D


def evaluate(nominal: Joint, names: tuple[str, ...], values: Array) -> dict[str, Array]:
    """Every output for every parameter set.

    Args:
        nominal: The joint whose other parameters stay.
        names: Parameters that vary, in the order of the columns.
        values: Shape (samples, len(names)) [SI].

    Returns:
        Output name -> shape (samples,), units in ``study.OUTPUTS``.
    """
    keys = Joint.__dataclass_fields__
    p = {key: np.full((values.shape[0], 1), float(getattr(nominal, key))) for key in keys}
    centre = {key: np.array([[float(getattr(nominal, key))]]) for key in keys}
    for column, name in enumerate(names):
        p[name] = values[:, column : column + 1]
    grid = damped_grid(HAMMER_RATE, HAMMER_RECORD)
    blow = hammer_force(grid.times) * HAMMER_RADIUS
    hit = response(transfers(p, grid.s)[0], blow, grid) * ACCELEROMETER_RADIUS
    grid = damped_grid(SWEEP_RATE, SWEEP_RECORD)
    swept = response(transfers(p, grid.s)[1], sweep_torque(grid.times), grid) * ACCELEROMETER_RADIUS
    w = 2j * np.pi * np.linspace(*SWEEP_BAND, 261)
    ratio = np.abs(transfers(p, w)[1]) / np.abs(transfers(centre, w)[1])
    J_M = (p["motor_inertia"] + p["reducer_inertia"]) * p["reduction_ratio"] ** 2
    two_pi = 2.0 * np.pi
    return {
        "antiresonance": (np.sqrt(p["stiffness"] / p["load_inertia"]) / two_pi)[:, 0],
        "resonance": (np.sqrt(p["stiffness"] * (1.0 / J_M + 1.0 / p["load_inertia"])) / two_pi)[:, 0],
        "hammer_peak": np.max(np.abs(hit), axis=-1),
        "hammer_band_rms": band_rms(hit, HAMMER_RATE, HAMMER_BAND),
        "sweep_peak": np.max(np.abs(swept), axis=-1),
        "sweep_band_rms": band_rms(swept, SWEEP_RATE, SWEEP_BAND),
        "prediction_error": np.sqrt(np.mean((20.0 * np.log10(ratio)) ** 2, axis=-1)),
    }
