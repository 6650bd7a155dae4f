"""What the parameters' covariance makes of a prediction: bands in time and frequency, to first order."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jointscope.identification.drive_law import Drive
from jointscope.identification.model_file import BaseModel
from jointscope.prediction.base_model import RunPrediction, predict_run
from jointscope.prediction.spectra import Spectrum, Window, spectrum
from jointscope.prediction.torque_log import TorqueLog
from jointscope.recordings.campaign import Run

Real = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ChannelBand:
    """How the parameters' uncertainty moves one predicted channel.

    Attributes:
        deviations: Change per standard deviation along each principal direction of the covariance, SI,
            shape (directions, n).
    """

    deviations: Real

    @property
    def standard_deviation(self) -> Real:
        """Of each predicted sample, SI, shape (n,)."""
        variance: Real = np.sum(self.deviations**2, axis=0)
        return np.sqrt(variance)

    def of_magnitude(self, predicted: Real, rate: float, window: Window = "tukey") -> Real:
        """Standard deviation of the spectrum's magnitude, shape of its frequency axis."""
        central = spectrum(predicted, rate, window).amplitude
        phase = np.exp(-1j * np.angle(central))
        moved = [(spectrum(row, rate, window).amplitude * phase).real for row in self.deviations]
        return np.sqrt(np.sum(np.square(moved), axis=0)) if moved else np.zeros(central.size)


def parameter_bands(
    model: BaseModel,
    run: Run,
    prediction: RunPrediction,
    *,
    declared: bool = False,
    drive: Drive | None = None,
    log: TorqueLog | None = None,
    share: float | None = None,
) -> tuple[ChannelBand, ...]:
    """One band per channel of ``prediction``, by central differences along the covariance's principal directions.

    Costs two predictions per estimated parameter. Without estimated parameters the bands are empty.
    """
    directions = _principal(model)
    halves = []
    for direction in directions:
        up, down = (
            predict_run(_moved(model, sign * direction), run, declared=declared, drive=drive, log=log, share=share)
            for sign in (1.0, -1.0)
        )
        halves.append([0.5 * (a.values - b.values) for a, b in zip(up.channels, down.channels, strict=True)])
    return tuple(
        ChannelBand(
            np.array([half[place] for half in halves])
            if halves
            else np.zeros((0, channel.values.size), dtype=float)
        )
        for place, channel in enumerate(prediction.channels)
    )


def magnitude_interval(predicted: Spectrum, deviation: Real) -> tuple[Real, Real]:
    """95 % interval of the magnitude, shape (n,) each, never below zero."""
    magnitude = np.abs(predicted.amplitude)
    return np.maximum(magnitude - 1.96 * deviation, 0.0), magnitude + 1.96 * deviation


def _principal(model: BaseModel) -> list[Real]:
    if not model.parameters or model.terms:
        return []
    # scaled to correlations first: stiffness and inertia differ by five orders of magnitude
    sigma = np.sqrt(np.diag(model.covariance))
    known = sigma > 0.0
    safe = np.where(known, sigma, 1.0)
    weights, vectors = np.linalg.eigh(model.covariance / np.outer(safe, safe))
    return [
        np.sqrt(weight) * vector * sigma
        for weight, vector in zip(weights, vectors.T, strict=True)
        if weight > 1e-12
    ]


def _moved(model: BaseModel, change: Real) -> BaseModel:
    values = dict(model.joint)
    for name, step in zip(model.parameters, change, strict=True):
        # a value that is known to within itself stays physical
        values[name] = max(values[name] + float(step), 1e-6 * abs(values[name]))
    return replace(model, joint=values)
