"""Whether what a model leaves still follows what drove the run: a test that needs no candidate.

Per kind of channel the whitened residual is regressed on the inputs at a few lags and on what was predicted, squared with
its sign; the model's own parameters stay where the fit left them, which can only understate the gain. The
coefficients of the fitted runs are then held against the held-out ones. Noise cannot carry over; whatever does is physics,
or a fault of the recording, that the model lacks (B.2, stage 2b).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.adjudicate import Judged, Judgement
from jointscope.diagnosis.gates import AS_FORETOLD, HELD, MATERIAL
from jointscope.diagnosis.noise import ANGULAR, Key, block_key, dynamic_level
from jointscope.diagnosis.objective import Objective
from jointscope.diagnosis.silent_bands import as_recorded, unrecorded

if TYPE_CHECKING:
    from jointscope.diagnosis.prepare import Output, PreparedRun

Vector = NDArray[np.float64]

LAGS = np.arange(-4, 13, 2) * 1e-3  # s; past inputs count further back than coming ones
N_REGRESSORS = 2 * len(LAGS) + 2
RIDGE = 1e-6
COLOURED = 3.0  # times what the white part of a log's noise does, which is all that the log shows of its noise
FOLLOWS = 20.0  # nats, net of Occam, above which a residual is said to follow the input
PLACED = 12.0  # nats by which held-out runs must show what sits at one place: five standard deviations
LOUD = 0.5  # times the noise, that what sits at one place must be there


@dataclass(frozen=True)
class Place:
    """Where in the travel something sits.

    Attributes:
        angle: At the joint output [``unit``].
        width: Half of it [``unit``].
        unit: rad, or m where the axis slides.
    """

    angle: float
    width: float
    unit: str = "rad"


@dataclass(frozen=True)
class Remainder:
    """What one kind of channel still owes to the input.

    Attributes:
        gain: On the fitted runs, net of Occam [nats].
        held_gain, foretold: On the held-out runs, found and due if true [nats].
        material: RMS of what is explained, which is no more than is left, over the signal's [-]; over the noise's, there,
            where it is ``place``.
        echo: The same of what the white noise of a torque log makes the model do; 0 where no log drives it.
        dispersion: By how much the gains were divided, since the model leaves that many times what noise is [-].
        order: Periods per turn of the joint output, where it is what repeats with the turn and not what follows the input.
        place: Where it sits, where it is what the joint meets at one place and not what follows the input.
        unrecorded: Whether a log drives it, and what is explained lies where the recordings hold nothing.
    """

    key: Key
    gain: float
    held_gain: float
    foretold: float
    material: float
    echo: float = 0.0
    dispersion: float = 1.0
    order: float | None = None
    place: Place | None = None
    unrecorded: bool = False

    @property
    def stands(self) -> bool:
        """Real, carried over, material, and more than the noise of the input may do, which follows its log too."""
        if self.place is not None:
            return self.gain > FOLLOWS and self.held_gain > PLACED and self.material > LOUD
        due = max(HELD, AS_FORETOLD * self.foretold)
        least = max(MATERIAL, COLOURED * self.echo)
        real = self.gain > FOLLOWS and self.held_gain > due and self.material > least
        return real and not self.unrecorded


def _regressors(run: PreparedRun, output: Output, predicted: Vector) -> NDArray[np.float64]:
    """Columns at the output's samples, shape (n, k): inputs at lags, and the prediction squared with its sign."""
    columns = []
    for drive in (run.motor if run.motor_moves else None, run.load):
        for lag in LAGS:
            columns.append(np.zeros(len(output.times)) if drive is None else drive.signal(output.times - lag))
    departure = predicted - np.median(predicted)
    columns.extend([departure * np.abs(departure), departure**3])
    return np.stack(columns, axis=1)


@dataclass(frozen=True, eq=False)
class _Rows:
    """Residual and regressors of the runs that hold a kind of channel.

    Attributes:
        w: Whitened residual of each run, once, shape (n,).
        columns: Regressors of its outputs of that kind, whitened, the run's other outputs silent, shape (n, k).
        raw: The same as they are at the scored samples, shape (n_scored, k).
        signal: Squared signal over these samples [the output's unit squared].
        left: The same of what the model leaves: where a whitener hardly looks, columns may stand for more than that.
        recorded: As ``w``, of the recording itself.
        driven: Whether a torque's log drives all of them.
    """

    w: Vector
    columns: NDArray[np.float64]
    raw: NDArray[np.float64]
    signal: float
    left: float
    recorded: Vector
    driven: bool


def _rows(objective: Objective, judged: Judged, key: Key, held: bool) -> _Rows:
    predictions = judged.predictions_held if held else judged.predictions
    w, columns, raw, recorded, driven = [], [], [], [], True
    signal = left = 0.0
    for i, (run, predicted) in enumerate(zip(objective.prepared, predictions, strict=True)):
        arrays, hold_it = [], False
        for output, y in zip(run.outputs, predicted, strict=True):
            if block_key(run, output) != key:
                arrays.append(np.zeros((len(output.data), N_REGRESSORS)))
                continue
            x, hold_it = _regressors(run, output, y), True
            arrays.append(x)
            raw.append(x[output.mask])
            signal += dynamic_level(output) ** 2 * int(output.mask.sum())
            left += float(np.sum(np.square((output.data - y)[output.mask])))
        if hold_it:
            w.append(objective.whiten_run(i, predicted))
            columns.append(objective.whiteners[i](arrays))
            recorded.append(as_recorded(run, objective.whiteners[i]))
            driven &= run.motor is not None and run.load is None
    if not w:
        nothing = np.zeros((0, N_REGRESSORS))
        return _Rows(np.zeros(0), nothing, nothing, 0.0, 0.0, np.zeros(0), False)
    parts = np.concatenate(w), np.concatenate(columns), np.concatenate(raw)
    return _Rows(*parts, signal, left, np.concatenate(recorded), driven)


def remainders(judgement: Judgement, judged: Judged) -> tuple[Remainder, ...]:
    """Every kind of channel that was fitted and held out; angles that an observer follows hold their input already."""
    objective, held = judgement.objective, judgement.held
    if not held.runs:
        return ()
    keys = dict.fromkeys(
        block_key(run, o) for run in objective.prepared for o in run.outputs if o.quantity not in ANGULAR
    )
    found = []
    for key in keys:
        fitted, kept = _rows(objective, judged, key, False), _rows(held, judged, key, True)
        if kept.w.size == 0:
            continue
        size = np.linalg.norm(fitted.columns, axis=0)
        alive = size > 1e-9 * max(float(size.max()), 1e-300)
        if not alive.any():
            continue
        a = fitted.columns[:, alive] / size[alive]
        normal = a.T @ a + RIDGE * np.eye(a.shape[1])
        step = np.linalg.solve(normal, a.T @ fitted.w) / size[alive]
        dispersion = max(1.0, float(fitted.w @ fitted.w) / fitted.w.size)
        left = fitted.w - fitted.columns[:, alive] @ step
        gain = 0.5 * float(fitted.w @ fitted.w - left @ left) / dispersion
        gain -= 0.5 * int(alive.sum()) * math.log(fitted.w.size)
        change = kept.columns[:, alive] @ step
        held_gain = 0.5 * float(kept.w @ kept.w - (kept.w - change) @ (kept.w - change)) / dispersion
        explained = fitted.raw[:, alive] @ step
        energy = min(float(explained @ explained), fitted.left)
        material = math.sqrt(energy / fitted.signal) if fitted.signal > 0.0 else 0.0
        foretold = 0.5 * float(change @ change) / dispersion
        echo = _echo(judgement, key, fitted.signal + kept.signal)
        own = np.any(fitted.columns != 0.0, axis=1)
        quiet = fitted.driven and unrecorded(fitted.recorded[own], fitted.w[own], left[own])
        found.append(Remainder(key, gain, held_gain, foretold, material, echo, dispersion, unrecorded=quiet))
    return tuple(sorted(found, key=lambda r: -r.gain))


def _echo(judgement: Judgement, key: Key, signal: float) -> float:
    """RMS of what the noise of a torque log does in this kind of channel, over the signal's [-]."""
    experiment, _, quantity, location, direction = key[:5]
    energy = judgement.echo.energies.get((experiment, quantity, location, direction), 0.0)
    return math.sqrt(energy / signal) if signal > 0.0 else 0.0


def _what(left: Remainder) -> str:
    if left.order is None:
        return "follows the input"
    return f"repeats {left.order:.4g} times per turn of the joint"


def _sentence(left: Remainder) -> str:
    what = f"{left.key[0]}, {left.key[2]} of the {left.key[3]}: "
    if left.place is None:
        return f"{what}{100.0 * left.material:.2g} % of the signal still {_what(left)}, in runs that were not fitted too"
    place = left.place
    where = f"at {place.angle:.4g} {place.unit} of the joint (within {place.width:.2g} {place.unit})"
    return f"{what}what is left {where} is {left.material:.2g} times its noise, in runs that were not fitted too"


def remainder_json(left: Sequence[Remainder]) -> list[dict[str, Any]]:
    """``remainder`` of diagnosis.json: the kinds of channel whose residual still follows the input or repeats with the turn."""
    return [
        {
            "experiment": r.key[0], "channel": f"{r.key[2]}@{r.key[3]}", "gain_nats": round(r.gain, 1),
            "held_out_gain_nats": round(r.held_gain, 1),
            "share_of_signal": round(r.material, 5) if r.place is None else None,
            "place": None if r.place is None else {"value": round(r.place.angle, 6), "unit": r.place.unit},
            "sentence": _sentence(r),
        }
        for r in left
        if r.stands
    ]  # fmt: skip
