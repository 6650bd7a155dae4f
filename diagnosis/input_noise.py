"""The noise of a logged torque, which moves an angle that an observer holds.

A recorded input u + eta drives the model; an observer with poles A ties it to the recorded angle, so what is left of
that angle at the true parameters is -eta/(J A) + e. It is filtered by A/B, B the spectral factor of |A|^2 + share w^4:
monic over monic and minimum phase, so no determinant is owed, and what is left is white (an ARMAX model's prediction
error, Ljung 1999, section 4.2). What eta would make ring at the joint's own resonance is taken off the input itself
(``input_estimate``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter
from scipy.signal.windows import hann

from jointscope.diagnosis.poles import Pole, joint_poles
from jointscope.diagnosis.recorder_step import recorder_step
from jointscope.recordings.campaign import gearing

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import Output, PreparedRun, Problem

Vector = NDArray[np.float64]
WINDOW = 0.25  # s
RECORDED = 0.8  # of half the rate, above which a recorder's own filter may take the noise off
BANDS, FEWEST = 8, 6  # of which the quietest tells, and lines in each
EXCITED = 0.1  # of the power that is about everywhere, below which a quiet band is the floor of what was excited
QUIET = 25.0  # per cent of the windows, whose level is the log's noise


@dataclass(frozen=True, eq=False)
class Ringing:
    """A/B of one channel.

    Attributes:
        numerator, denominator: Coefficients of A and B, shape (3,), the first 1.
        rate: Sampling rate [Hz].
    """

    numerator: Vector
    denominator: Vector
    rate: float

    def __call__(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Filter along the first axis from rest; same shape."""
        return np.asarray(lfilter(self.numerator, self.denominator, x, axis=0))


def ringing(pole: Pole, share: float, rate: float) -> Ringing:
    """The filter at ``rate`` [Hz] that whitens noise with spectrum 1 + share w^4 / |A(jw)|^2.

    A = s^2 + 2 zeta w s + w^2; its spectral factor has w_b^4 = (1 + share) w^4 and
    1 - 2 zeta_b^2 = (1 - 2 zeta^2) / sqrt(1 + share).

    Args:
        pole: Of the observer.
        share: Power of the torque's noise over the sensor's, both as seen by the sensor far below the pole [-].
        rate: Of the sensor [Hz].
    """
    frequency, zeta = pole
    broad = np.sqrt(max(0.5 * (1.0 - (1.0 - 2.0 * zeta**2) / np.sqrt(1.0 + share)), zeta**2))
    wide = second_order(frequency * (1.0 + share) ** 0.25, float(broad), rate)
    return Ringing(second_order(frequency, zeta, rate), wide, rate)


def shaken(pole: Pole, peak: float, rate: float) -> Ringing:
    """The same for an acceleration of a joint that is shaken, with noise ``peak`` times the sensor's power at its pole."""
    return ringing(pole, 4.0 * pole[1] ** 2 * peak, rate)


def second_order(frequency: float, zeta: float, rate: float) -> Vector:
    """Monic polynomial in z^-1 with the sampled poles of s^2 + 2 zeta w s + w^2, shape (3,)."""
    w = 2.0 * math.pi * min(frequency, 0.45 * rate) / rate
    if zeta < 1.0:
        r, turn = math.exp(-zeta * w), w * math.sqrt(1.0 - zeta**2)
        return np.array([1.0, -2.0 * r * math.cos(turn), r * r])
    apart = w * math.sqrt(zeta**2 - 1.0)
    slow, fast = math.exp(-zeta * w + apart), math.exp(-zeta * w - apart)
    return np.array([1.0, -slow - fast, slow * fast])


@dataclass(frozen=True)
class Inlet:
    """How the noise of a torque log, and what shakes the joint, reach the outputs of the model that was fitted.

    Attributes:
        inertia: Of everything that moves [kg m^2 or kg].
        factor: Torque at the output per unit of the log [-].
        poles: Where the joint rings, by whether its motor moves.
    """

    inertia: float
    factor: float
    poles: Mapping[bool, Pole]


def inlet(problem: Problem, theta: Vector) -> Inlet:
    """The inlet of the base at ``theta``."""
    b = dict(zip(problem.base.names, (float(v) for v in theta), strict=True))
    two = problem.rig.topology == "two-inertia"
    inertia = b["load_inertia"] + (b["motor_inertia"] if two else 0.0)
    return Inlet(max(inertia, 1e-300), b["efficiency"] * b["torque_scale"], joint_poles(problem, theta))


def log_noise(samples: Vector, rate: float) -> float:
    """Standard deviation of a torque log's white noise [the log's unit]: what its quiet cells of time and frequency hold.

    In every quarter second the median over frequency, and of these the lower quartile over time: a sweep fills few
    cells at a time, and a drive that works its encoder's steps into the torque does so while it moves. Third differences
    (:func:`white_part`) take a sweep's upper end for noise: two to ten times too much on a third of the logs of a draw.
    Random torque that fills most of the band at all times is no noise: its floor is where nothing was excited. A white
    force up to 350 of 512 Hz was taken for noise, and damped: mass and stiffness came out 4 % small.

    Args:
        samples: As logged, shape (n,).
        rate: Of the log [Hz].
    """
    length = 4 * max(2, round(WINDOW * rate / 4))
    if samples.size < 2 * length:
        return white_part(samples)
    window = hann(length, sym=False)
    cells = np.lib.stride_tricks.sliding_window_view(samples, length)[:: length // 4]
    spectra = np.fft.rfft((cells - cells.mean(axis=1, keepdims=True)) * window, axis=1)[:, 2:-1]
    power = np.square(np.abs(spectra)) / (math.log(2.0) * float(np.sum(np.square(window))))
    quiet = math.sqrt(min(_quiet(power), _floor(power)))
    return min(max(quiet, recorder_step(samples) / math.sqrt(12.0)), white_part(samples))


def _quiet(power: Vector) -> float:
    """Of cells of time and frequency, shape (n_windows, n_lines), the lower quartile over time of the median over frequency."""
    return float(np.percentile(np.median(power, axis=1), QUIET))


def _floor(power: Vector) -> float:
    """The same of the quietest tenth of the band, where that is far below the rest: ``inf`` where it isn't."""
    bands = np.array_split(power[:, : round(RECORDED * power.shape[1])], BANDS, axis=1)
    floor = min((_quiet(band) for band in bands if band.shape[1] >= FEWEST), default=math.inf)
    return floor if floor < EXCITED * _quiet(power) else math.inf


def white_part(x: Vector) -> float:
    """Standard deviation of the white part of a smooth record: robust third differences over sqrt(20)."""
    if x.size < 64:
        return 0.0
    return float(1.4826 * np.median(np.abs(np.diff(x, 3))) / math.sqrt(20.0))


def noise_share(run: PreparedRun, output: Output, way: Inlet, step: float, observer: float) -> float:
    """Power density of the torque log's noise over the sensor's own, as the output sees them far below ``pole`` [-].

    0 where nothing drives the run, or where the record stands still and shows no noise of its own.

    Args:
        run: Driven by a logged torque.
        output: An angle that an observer holds.
        way: How torque becomes motion.
        step: The recorder's step [the output's unit].
        observer: w_0 of the observer [rad/s], which turns a torque into an angle.
    """
    if run.motor is None:
        return 0.0
    torque = way.factor * run.motor.noise / math.sqrt(run.motor.signal.rate)
    lever = gearing(output.quantity, output.location, run.ratio)
    reached = torque / way.inertia * lever / observer**2
    own = max(white_part(output.data[output.mask]), step / math.sqrt(12.0)) / math.sqrt(output.rate)
    return (reached / own) ** 2 if own > 0.0 else 0.0
