"""What of the base's error is unlike noise: it grows with the signal, its own past foretells it, it fades as a hit does.

No two runs driven alike are needed for any of them, and no candidate.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.channels import ACCELERATIONS
from jointscope.diagnosis.noise import ANGULAR, Key, block_key
from jointscope.diagnosis.own_hit import is_hit

if TYPE_CHECKING:
    from jointscope.diagnosis.adequacy import Adequacy
    from jointscope.diagnosis.adjudicate import Judgement
    from jointscope.diagnosis.noise import BlockNoise
    from jointscope.diagnosis.prepare import PreparedRun

MATTERS: Final = 0.02  # of the signal's rms, below which an error's colour says nothing
MOSTLY: Final = 0.5  # error over signal, beyond which a record is noise for the most part
WHITE: Final = 2.0  # times its innovation, below which noise is about white
FADED: Final = 5.0  # times the power of the last third, which the third after the hit must have
IN_PROPORTION: Final = 0.05  # error over signal, growing with it, that is no noise of an accelerometer
LEAST: Final = 100  # samples of a third from which their powers are told apart to a few tenths


def _error_sizes(fit: Adequacy) -> dict[Key, float]:
    """Error of the base over the signal, both rms, per kind of channel [-]."""
    return {block.key: math.sqrt(max(block.base, 0.0)) for block in fit.blocks}


def grows_with_signal(judgement: Judgement, fit: Adequacy) -> float:
    """Largest error of an accelerometer, or of what a prescribed motion takes, that grows with its signal [-]: no noise does.

    A record that is noise for the most part has an envelope of noise, and says nothing of it where that noise is white and,
    in hits, does not fade as they do.
    """
    taken = {block_key(r, o) for r in judgement.objective.prepared for o in r.outputs if r.takes(o)}
    told = {key: n for key, n in judgement.noise.blocks.items() if key[2] in ACCELERATIONS or key in taken}
    return _most_grown(judgement, told, _error_sizes(fit))


def still_grows(judgement: Judgement, fit: Adequacy, followed: float) -> float:
    """The same of any channel beside a model, where that explains no more than ``followed`` of what repeats itself there [-]."""
    sizes = {block.key: math.sqrt(max(block.model, 0.0)) for block in fit.blocks}
    explained = {block.key for block in fit.blocks if block.explained > followed}
    told = {key: n for key, n in judgement.noise.blocks.items() if key not in explained}
    return _most_grown(judgement, told, sizes)


def _most_grown(judgement: Judgement, told: dict[Key, BlockNoise], sizes: dict[Key, float]) -> float:
    """Largest kappa of ``told`` that is no noise's, by the sizes of the errors over their signals."""
    if not told:
        return 0.0
    fading = {
        key
        for run, predicted in zip(judgement.objective.prepared, judgement.base.predictions, strict=True)
        for key in fades(run, predicted)
    }
    return max(
        (
            n.grown
            for key, n in told.items()
            if sizes.get(key, 0.0) < MOSTLY or n.marginal > WHITE * n.sigma or key in fading
        ),
        default=0.0,
    )


def left_in_proportion(judgement: Judgement, fit: Adequacy, explained: float) -> float:
    """How far beyond noise an accelerometer's error grows beside a model that explains little [-]; 1 at the limit.

    Only where no two runs are alike, which would tell how much of the mismatch is explained; 0 where the model explains at
    least ``explained`` of the base's error, noise and all. A record that is noise for the most part says nothing here either.
    """
    if math.isfinite(fit.explained) or not fit.at_least < explained:
        return 0.0
    return grows_with_signal(judgement, fit) / IN_PROPORTION


def foreseen(judgement: Judgement, fit: Adequacy) -> float:
    """Size of a channel's error over that of what its own past does not foretell, where the error matters [-].

    An instrument's noise is nearly as large as its innovation (1.7 times at most on 40 nulls); what a model leaves out
    repeats itself from sample to sample. So does an angle, which integrates whatever noise its torque has.
    """
    sizes, blocks = _error_sizes(fit), judgement.noise.blocks.items()
    told = [n for key, n in blocks if key[2] not in ANGULAR and sizes.get(key, 0.0) > MATTERS]
    return max((n.marginal / n.sigma for n in told), default=0.0)


def fades(run: PreparedRun, predicted: Sequence[NDArray[np.float64]]) -> set[Key]:
    """Kinds of channels of a hit of which most of what is left is gone by the end of the record.

    Args:
        predicted: One per output of ``run``, shape (n,) each.
    """
    if not is_hit(run):
        return set()
    found = set()
    for output, y in zip(run.outputs, predicted, strict=True):
        left = np.square((output.data - y)[output.mask])
        began = int(np.argmax(np.abs(output.data[output.mask]))) if left.size else 0
        third = (left.size - began) // 3
        if third >= LEAST and np.sum(left[began : began + third]) > FADED * np.sum(left[-third:]):
            found.add(block_key(run, output))
    return found
