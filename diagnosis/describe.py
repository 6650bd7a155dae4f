"""Where a mismatch shows: the band, the runs and what it depends on, from what the answer explains of the residual."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.adjudicate import Judged, Judgement
from jointscope.diagnosis.noise import ANGULAR, dynamic_level
from jointscope.diagnosis.objective import Predictions

if TYPE_CHECKING:
    from jointscope.diagnosis.prepare import PreparedRun

Vector = NDArray[np.float64]

BAND = (0.05, 0.95)  # of the energy that lies within the stated band
NOTABLE = 0.3  # of the most affected run's share of error, for a run to be named
DEPENDS = {
    "coulomb-friction": ("velocity-sign",),
    "stribeck-friction": ("velocity-sign", "velocity"),
    "load-dependent-friction": ("velocity-sign", "transmitted-torque"),
    "quadratic-damping": ("velocity",),
    "backlash": ("wind-up", "level"),
    "stiffness-nonlinearity": ("wind-up", "level"),
    "hysteresis": ("wind-up", "wind-up-rate-sign", "level"),
    "structural-damping": ("wind-up-rate-sign", "frequency"),
    "transmission-error": ("position",),
    "torque-ripple": ("position",),
    "drive-lag": ("frequency",),
    "torque-gain": ("motor-torque",),
    "gravity": ("position",),
    "payload": ("run",),
    "link-flexibility": ("frequency",),
    "base-compliance": ("frequency",),
    "neighbour-flexibility": ("frequency",),
    "end-stop": ("position",),
    "stiffness-drift": ("time",),
    "external-vibration": ("time", "frequency"),
    "delay": ("frequency",),
    "clock-drift": ("time", "frequency"),
    "sensor-tilt": ("position", "velocity"),
    "sensor-resonance": ("frequency",),
    "sensor-saturation": ("level",),
    "sensor-gain": ("level",),
    "torque-logging": ("frequency",),
}  # fmt: skip


@dataclass(frozen=True)
class Showing:
    """Where the difference between two models shows.

    Attributes:
        frequency_hz: Band that holds 90 % of it [Hz], or ``None``.
        runs: Ids of the runs that show it most, most first.
    """

    frequency_hz: tuple[float, float] | None
    runs: tuple[str, ...]


def showing(judgement: Judgement, chosen: Judged) -> Showing:
    """The band and the runs in which ``chosen`` differs from the base."""
    runs = (*judgement.objective.prepared, *judgement.held.prepared)
    base = (*judgement.base.predictions, *judgement.base.predictions_held)
    model = (*chosen.predictions, *chosen.predictions_held)
    return differing(runs, base, model)


def differing(runs: Sequence[PreparedRun], base: Predictions, model: Predictions) -> Showing:
    """The band and the runs in which two predictions differ, each channel relative to its own signal."""
    frequencies: list[Vector] = []
    energies: list[Vector] = []
    shares: dict[str, float] = {}
    for run, old, new in zip(runs, base, model, strict=True):
        for output, a, b in zip(run.outputs, old, new, strict=True):
            level = dynamic_level(output)
            if level == 0.0:
                continue
            difference = np.where(output.mask, b - a, 0.0) / level
            power = np.square(np.abs(np.fft.rfft(difference)), dtype=np.float64) / max(len(difference), 1) ** 2
            frequency = np.asarray(np.fft.rfftfreq(len(difference), 1.0 / output.rate), dtype=np.float64)
            if output.quantity not in ANGULAR or not energies:
                frequencies.append(frequency)
                energies.append(power)
            shares[run.run.id] = max(shares.get(run.run.id, 0.0), float(np.sqrt(np.mean(np.square(difference)))))
    if not energies or not any(np.any(e) for e in energies):
        return Showing(None, ())
    frequency, power = np.concatenate(frequencies), np.concatenate(energies)
    order = np.argsort(frequency, kind="stable")
    total = np.cumsum(power[order])
    edges = np.searchsorted(total, np.array(BAND) * total[-1])
    low, high = frequency[order][np.minimum(edges, len(order) - 1)]
    top = max(shares.values())
    named = sorted((run for run, share in shares.items() if share >= NOTABLE * top), key=lambda run: -shares[run])
    return Showing((float(low), float(high)), tuple(named))
