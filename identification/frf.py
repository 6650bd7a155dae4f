r"""Frequency response functions from repeated hits: H1, H2, Hv with coherence and the scatter's covariance.

With A hits, S_xx = mean |U|^2, S_yy = mean |Y|^2, S_yx = mean Y U*:

    H1 = S_yx/S_xx                          unbiased for noise on the output only
    H2 = S_yy/S_yx*                         unbiased for noise on the input only
    Hv = total least squares: S_yx/S_xx scaled for noise in proportion on both (geometric mean of H1 and H2)
    coherence = |S_yx|^2/(S_xx S_yy)

Bendat and Piersol, Random Data, 4th ed., chapters 6 and 9. An exponential window e^{-sigma t} on both records moves the
response to G(s + sigma): the damping it adds is exact and is taken off again in ``without_window``.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import RefusedError

Real = NDArray[np.float64]
Complex = NDArray[np.complexfloating[Any, Any]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Frf:
    """An averaged frequency response.

    Attributes:
        frequency: [Hz], shape (n,).
        h1: Output per input, shape (n,).
        h2: Likewise.
        hv: Likewise.
        coherence: [-], shape (n,); NaN with a single hit, where it is one by definition and says nothing.
        variance: Of the complex h1 from the hits' scatter, E|h1 - G|^2, shape (n,); NaN with a single hit.
        averages: Number of hits.
        shift: sigma of the exponential window [1/s]: the response is G(s + sigma).
    """

    frequency: Real
    h1: Complex
    h2: Complex
    hv: Complex
    coherence: Real
    variance: Real
    averages: int
    shift: float = 0.0

    @property
    def s(self) -> Complex:
        """Where on the s plane G was observed [rad/s]."""
        return self.shift + 2j * np.pi * self.frequency


def from_spectra(frequency: Real, inputs: Complex, outputs: Complex, shift: float = 0.0) -> Frf:
    """Average spectra of shape (n_hits, n)."""
    hits = inputs.shape[0]
    if hits < 1:
        raise RefusedError("no hit is left to average")
    xx = np.mean(np.abs(inputs) ** 2, axis=0)
    yy = np.mean(np.abs(outputs) ** 2, axis=0)
    yx = np.mean(outputs * np.conj(inputs), axis=0)
    h1 = yx / np.maximum(xx, np.finfo(float).tiny)
    h2 = yy / np.where(np.abs(yx) > 0.0, np.conj(yx), 1.0)
    if hits == 1:
        blind = np.full(frequency.size, np.nan)
        return Frf(
            frequency=frequency, h1=h1, h2=h2, hv=h1, coherence=blind, variance=blind, averages=1, shift=shift
        )
    coherence = np.clip(np.abs(yx) ** 2 / np.maximum(xx * yy, np.finfo(float).tiny), 0.0, 1.0)
    error = outputs - h1 * inputs
    variance = (
        np.sum(np.abs(inputs) ** 2 * np.abs(error) ** 2, axis=0)
        / np.maximum(hits * xx, np.finfo(float).tiny) ** 2
        * hits
        / (hits - 1.0)
    )
    return Frf(
        frequency=frequency,
        h1=h1,
        h2=h2,
        hv=np.sqrt(np.abs(h1) * np.abs(h2)) * np.exp(1j * np.angle(h1)),
        coherence=coherence,
        variance=variance,
        averages=hits,
        shift=shift,
    )


def estimate_frf(
    inputs: Real, outputs: Real, rate: float, *, force_window: float | None = None, exponential: float = 0.0
) -> Frf:
    """FRF of records of shape (n_hits, n) at ``rate`` [Hz], as the textbooks have it.

    Args:
        inputs: Force or torque, one hit per row, each hit's largest sample being its pulse.
        outputs: Response, likewise.
        rate: Sampling rate [Hz].
        force_window: Length kept around each pulse [s], the last and first tenth tapered; ``None`` keeps the record.
        exponential: sigma of e^{-sigma t} on both records [1/s]; remembered in the result's ``shift``.
    """
    u = np.asarray(inputs, dtype=float) - np.median(inputs, axis=1, keepdims=True)
    y = np.asarray(outputs, dtype=float) - np.median(outputs, axis=1, keepdims=True)
    if force_window is not None:
        u = u * np.array([_around_pulse(row, rate, force_window) for row in u])
    if exponential:
        decay = np.exp(-exponential * np.arange(u.shape[1]) / rate)
        u, y = u * decay, y * decay
    frequency = np.asarray(np.fft.rfftfreq(u.shape[1], 1.0 / rate)[1:], dtype=np.float64)
    return from_spectra(frequency, np.fft.rfft(u)[:, 1:] / rate, np.fft.rfft(y)[:, 1:] / rate, exponential)


def _around_pulse(force: Real, rate: float, length: float) -> Real:
    offset = np.abs(np.arange(force.size) - int(np.argmax(np.abs(force)))) / rate
    flat, edge = 0.4 * length, 0.5 * length
    taper = 0.5 * (1.0 + np.cos(np.pi * np.clip((offset - flat) / (edge - flat), 0.0, 1.0)))
    return np.where(offset <= edge, taper, 0.0)


def without_window(a1: float, a2: float, shift: float) -> tuple[float, float]:
    """(a1, a2) of G(s) from those fitted to G(s + shift) as if it were G(s).

    (s + sigma)^2 + a1 (s + sigma) + a2 = s^2 + (a1 + 2 sigma) s + (a2 + a1 sigma + sigma^2).
    """
    true = a1 - 2.0 * shift
    return true, a2 - true * shift - shift**2
