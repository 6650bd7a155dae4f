"""How close the predicted vibration comes to MuJoCo's truth, and what a slow torque log costs."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jointscope.experiments.single_joint.bench import Bench
from jointscope.identification.model_file import BaseModel
from jointscope.models.parameters import Rig
from jointscope.prediction.base_model import ChannelPrediction, RunPrediction, predict_run
from jointscope.prediction.closed_form import predicted_spectrum
from jointscope.prediction.scores import PAPER_BANDS, BandScore, band_score
from jointscope.prediction.spectra import Spectrum, spectrum
from jointscope.prediction.torque_log import TorqueLog
from jointscope.prediction.uncertainty import parameter_bands
from jointscope.recordings.bandlimited import resampled
from jointscope.recordings.campaign import Run

Real = NDArray[np.float64]

CLEARANCE = 10.0 ** (30.0 / 10.0)  # truth over propagated noise, in power
LARGEST_ERROR = 0.2  # [dB], median
SMALLEST_FRAC = 0.995
SMALLEST_SHARE = 0.6  # of the bins of a sweep


@dataclass(frozen=True, kw_only=True, eq=False)
class Accuracy:
    """One run's predicted acceleration against the truth.

    Attributes:
        run: Its id.
        experiment: Its kind.
        score: Over the bins where the truth stands 30 dB above the noise that the recorded inputs carry into the prediction.
        truth: Spectrum of the noise-free acceleration [m/s^2].
        measured: Likewise, of the recorded acceleration.
        predicted: Likewise, from the recorded inputs.
        noise: Of the prediction, magnitude per bin [m/s^2].
        product: The paper's own form: the logged torque's spectrum times the transfer function (11).
        product_score: Its score over the same bins.
    """

    run: str
    experiment: str
    score: BandScore
    truth: Spectrum
    measured: Spectrum
    predicted: Spectrum
    noise: Real
    product: Spectrum
    product_score: BandScore

    @property
    def holds(self) -> bool:
        """Whether the stated bounds hold."""
        wide = self.score.share >= SMALLEST_SHARE or self.experiment != "torque-sweep"
        return self.score.median_error <= LARGEST_ERROR and self.score.frac >= SMALLEST_FRAC and wide


def acceleration(prediction: RunPrediction) -> ChannelPrediction:
    """The accelerometer's channel of a prediction."""
    return next(c for c in prediction.channels if c.signal.channel.quantity == "linear-acceleration")


def true_model(model: BaseModel, rig: Rig) -> BaseModel:
    """``model`` with the rig's true values, so that only the inputs' noise is left in what it predicts."""
    joint = rig.joint
    values = {
        name: getattr(joint, name)
        for name in ("stiffness", "damping", "load_inertia", "load_damping", "motor_damping")
    }
    return replace(model, joint={**model.joint, **values}, parameters=(), covariance=np.zeros((0, 0)))


def measure(model: BaseModel, rig: Rig, recorded: Run, truth: Run, log: TorqueLog | None = None) -> Accuracy:
    """Predict ``recorded`` from its inputs with ``model`` and compare with the noise-free ``truth``."""
    perfect = true_model(model, rig)
    predicted = acceleration(predict_run(model, recorded, log=log))
    noisy = acceleration(predict_run(perfect, recorded))
    clean = acceleration(predict_run(perfect, truth))
    actual = truth.select("linear-acceleration")[0]
    rate = actual.sampling_rate
    T, P = spectrum(actual.samples, rate), spectrum(predicted.values, rate)
    power = np.abs(spectrum(noisy.values - clean.values, rate).amplitude) ** 2
    power = np.convolve(power, np.ones(9) / 9.0, mode="same")  # one draw's power scatters from bin to bin
    product = _product(model, recorded, actual.channel.radius or 1.0)
    low, high = PAPER_BANDS[recorded.experiment][0]
    mask = np.abs(T.amplitude) ** 2 > CLEARANCE * power if log is None else None
    return Accuracy(
        run=recorded.id,
        experiment=recorded.experiment,
        score=band_score(T, P, low, high, mask),
        truth=T,
        measured=spectrum(recorded.select("linear-acceleration")[0].samples, rate),
        predicted=P,
        noise=np.sqrt(power),
        product=product,
        product_score=band_score(T, product, low, high, mask),
    )


def parameter_deviation(model: BaseModel, run: Run) -> Real:
    """What the parameters' covariance does to the predicted spectrum's magnitude, one standard deviation [m/s^2]."""
    prediction = predict_run(model, run)
    channel = acceleration(prediction)
    band = parameter_bands(model, run, prediction)[prediction.channels.index(channel)]
    return band.of_magnitude(channel.values, channel.signal.sampling_rate)


def _product(model: BaseModel, run: Run, radius: float) -> Spectrum:
    """(11): the logged torque's spectrum, on the accelerometer's clock, times the transfer function [m/s^2]."""
    torque, sensor = run.select("torque", location="motor")[0], run.select("linear-acceleration")[0]
    on_clock = resampled(torque.samples, torque.sampling_rate, torque.stream.start, sensor.times)
    return predicted_spectrum(model, spectrum(on_clock, sensor.sampling_rate), radius)


def accuracies(model: BaseModel, bench: Bench) -> tuple[Accuracy, ...]:
    """Every sweep and motion of the bench."""
    pairs = zip(bench.recorded.runs, bench.truth.runs, strict=True)
    return tuple(measure(model, bench.rig, run, truth) for run, truth in pairs if run.experiment != "hammer")


@dataclass(frozen=True, kw_only=True)
class LogCost:
    """What a kind of torque log does to the predicted sweep.

    Attributes:
        kind: What the logger did.
        read_as: What the prediction took it for.
        median_error, bias: Over 10-75 Hz [dB].
        error_at_top: Mean over 70-75 Hz [dB].
        frac: Over 10-75 Hz [-].
    """

    kind: str
    read_as: str
    median_error: float
    bias: float
    error_at_top: float
    frac: float


def log_costs(model: BaseModel, bench: Bench) -> tuple[LogCost, ...]:
    """The strongest sweep through each kind of log, read as samples, and corrected where the kind is known."""
    truth = next(run for run in reversed(bench.truth.runs) if run.experiment == "torque-sweep")
    costs = []
    for kind, run in bench.logs.items():
        readings: list[tuple[str, TorqueLog]] = [("samples", TorqueLog(kind="instantaneous"))]
        if kind == "hold" or kind == "average":
            readings.append((f"{kind} at 500 Hz, undone", TorqueLog(kind=kind, rate=500.0)))
        for read_as, log in readings:
            found = measure(model, bench.rig, run, truth, log)
            top = band_score(found.truth, found.predicted, 70.0, 75.0)
            costs.append(
                LogCost(
                    kind=kind,
                    read_as=read_as,
                    median_error=found.score.median_error,
                    bias=found.score.bias,
                    error_at_top=top.bias,
                    frac=found.score.frac,
                )
            )
    return tuple(costs)
