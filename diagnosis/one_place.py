r"""Whether what a model leaves sits at one place of the travel: a test of every place that needs no candidate.

A magnet near the arm, a cable that is pulled, a dent in a bearing acts where the joint passes it, there and back, and nowhere
else: no law that acts everywhere finds it, a table of a few nodes over the whole travel hardly feels it, and noise does not
know where the joint is. Per kind of channel the whitened residual w of the fitted runs is regressed, within four widths s of
every place p that the joint passes, on

    (A + B u) exp(-u^2/2),   u = (q - p)/s,

of its own for either way of passing, q the recorded angle at the joint output. The best place, its width and its shape are
then held against the runs that were not fitted. How large it is there is free, as a place that is passed faster is felt less:
with the fitted shape m, (w'm)^2 / 2 m'm is a square of one normal deviate, halved.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.adjudicate import Judged, Judgement
from jointscope.diagnosis.noise import Key, block_key
from jointscope.diagnosis.objective import Objective
from jointscope.diagnosis.remainder import Place, Remainder
from jointscope.diagnosis.turning import TRAVEL, angles_at_outputs
from jointscope.recordings.campaign import FORCES

Vector = NDArray[np.float64]

WIDTHS = (0.005, 0.01, 0.02, 0.04)  # of the travel
REACH = 4.0  # widths within which a place is felt
ENDS = 0.05  # of the travel at either end, where every motion begins and stops
PASSING = 0.01  # s over which the way of passing is read
SLOW = 0.1  # of the rms speed, below which the joint does not pass
FEWEST = 20  # samples about a place
PARAMETERS = 6  # two amplitudes for either way, place and width


@dataclass(frozen=True, eq=False)
class Passed:
    """Samples of one kind of channel in all runs that pass, by angle.

    Attributes:
        w: Whitened residual, shape (n,).
        q: Angle at the joint output [rad], ascending, shape (n,).
        forth: Whether the joint turned forth rather than back, shape (n,).
    """

    w: Vector
    q: Vector
    forth: NDArray[np.bool_]

    def about(self, place: Place) -> tuple[Vector, NDArray[np.float64]]:
        """w within reach of a place, shape (k,), and what it is regressed on, shape (k, 4)."""
        within = slice(
            *np.searchsorted(self.q, [place.angle - REACH * place.width, place.angle + REACH * place.width])
        )
        u = (self.q[within] - place.angle) / place.width
        bump = np.exp(-0.5 * u * u)
        shapes = np.stack([bump, u * bump], axis=1)
        forth = self.forth[within, None]
        return self.w[within], np.concatenate([shapes * forth, shapes * ~forth], axis=1)


def passed(objective: Objective, judged: Judged, key: Key, *, held: bool) -> Passed | None:
    """The samples of this kind of channel while the joint passes; ``None`` where no run travels."""
    predictions = judged.predictions_held if held else judged.predictions
    ws, qs, ways = [], [], []
    for i, (run, predicted) in enumerate(zip(objective.prepared, predictions, strict=True)):
        angles = angles_at_outputs(run)
        if not angles or np.ptp(angles[0]) < TRAVEL:
            continue
        whitener = objective.whiteners[i]
        parts = np.split(objective.whiten_run(i, predicted), np.cumsum(whitener.sizes)[:-1])
        for output, q, part, own in zip(run.outputs, angles, parts, whitener.filters, strict=True):
            if block_key(run, output) != key:
                continue
            lag = max(1, round(PASSING * output.rate))
            padded = np.pad(q, lag, mode="edge")
            way = (padded[2 * lag :] - padded[: -2 * lag])[own.keep]
            moves = np.abs(way) > SLOW * math.sqrt(float(np.mean(np.square(way))) + 1e-300)
            ws.append(part[moves])
            qs.append(q[own.keep][moves])
            ways.append(way[moves] > 0.0)
    if not ws:
        return None
    q = np.concatenate(qs)
    order = np.argsort(q, kind="stable")
    return Passed(np.concatenate(ws)[order], q[order], np.concatenate(ways)[order])


def _places(samples: Passed, unit: str) -> list[Place]:
    low, high = float(samples.q[0]), float(samples.q[-1])
    travel = high - low
    return [
        Place(float(angle), width * travel, unit)
        for width in WIDTHS
        for angle in np.arange(low + ENDS * travel, high - ENDS * travel, width * travel)
    ]


def _explained(samples: Passed, place: Place) -> tuple[float, Vector]:
    """w'w that a place explains, and its four amplitudes."""
    w, columns = samples.about(place)
    if w.size < FEWEST:
        return 0.0, np.zeros(4)
    right = columns.T @ w
    step = np.asarray(np.linalg.lstsq(columns.T @ columns, right, rcond=1e-6)[0], dtype=np.float64)
    return float(right @ step), step


def in_one_place(judgement: Judgement, judged: Judged) -> tuple[Remainder, ...]:
    """The best place of every kind of channel that was fitted and held out in runs that travel."""
    objective, held = judgement.objective, judgement.held
    unit = "m" if objective.problem.rig.motion == "translational" else "rad"
    keys = dict.fromkeys(
        block_key(run, o) for run in objective.prepared for o in run.outputs if o.quantity not in FORCES
    )
    found = []
    for key in keys:
        fitted = passed(objective, judged, key, held=False)
        kept = passed(held, judged, key, held=True)
        if fitted is None or kept is None or fitted.q.size < FEWEST:
            continue
        places = _places(fitted, unit)
        tried = objective.map(functools.partial(_explained, fitted), places)
        best = int(np.argmax([explained for explained, _ in tried]))
        place, (explained, step) = places[best], tried[best]
        samples = fitted.w.size
        dispersion = max(1.0, float(fitted.w @ fitted.w) / samples)
        gain = 0.5 * explained / dispersion - 0.5 * PARAMETERS * math.log(samples) - math.log(len(places))
        w, columns = kept.about(place)
        shape = columns @ step
        along, size = float(w @ shape), float(shape @ shape)
        held_gain = 0.5 * along * abs(along) / (size * dispersion) if size > 0.0 else 0.0
        _, there = fitted.about(place)
        within = there[:, 0] + there[:, 2] > math.exp(-0.5)  # less than a width away
        loud = math.sqrt(float(np.mean(np.square(there[within] @ step)))) if within.any() else 0.0
        found.append(Remainder(key, gain, held_gain, 0.0, loud, dispersion=dispersion, place=place))
    return tuple(sorted(found, key=lambda r: -r.gain))
