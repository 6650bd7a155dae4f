"""What force the base leaves on a single free inertia along its recorded path, and how much of it instruments may make.

An observer holds such a model to its path, and what a lacking force leaves in the recorded position is slow: as noise of its
own colour it costs nothing. A grease that thinned within each run left 15 % of the force, where the encoder's white noise
makes a thousandth of it, and was taken for noise. So where nothing else is found the forces are compared as they are.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.adjudicate import Judgement
from jointscope.diagnosis.errors import rms
from jointscope.diagnosis.noise import block_key
from jointscope.diagnosis.predict import inverse_force
from jointscope.diagnosis.problem import PreparedRun
from jointscope.recordings.bandlimited import bandlimited

Vector = NDArray[np.float64]

ASTRAY = 0.06  # of the force's rms, that must be left: friction whose form is a little wrong leaves 0.04
BEYOND_NOISE = 5.0  # times what the instruments' white noise makes of it
SEED = 20224


@dataclass(frozen=True)
class ForceLeft:
    """RMS over the force's [-] of what is left of a run, of the fitted and of the held-out ones the smallest.

    Attributes:
        share: Of recorded less modelled force.
        noise: Of what white noise as large as the path's own makes the modelled force do.
    """

    share: float
    noise: float

    @property
    def lack(self) -> float:
        """Above 1 where a force is missing."""
        return min(self.share / ASTRAY, self.share / (BEYOND_NOISE * self.noise) if self.noise > 0.0 else np.inf)


def force_left(judgement: Judgement) -> ForceLeft | None:
    """What the base leaves in every run, ``None`` where the rig is not a single free inertia or nothing was held out."""
    theta, _ = judgement.base.fit.coordinates.unpack(judgement.base.fit.x)
    problem = judgement.objective.problem
    found: list[ForceLeft] = []
    for objective in (judgement.objective, judgement.held):
        if not objective.runs:
            return None
        for run in objective.prepared:
            pair = inverse_force(run, theta, (), problem)
            if pair is None:
                return None
            size = rms(pair[0])
            moved = [inverse_force(other, theta, (), problem) for other in _noisier(run, judgement)]
            noise = max((rms(m[1] - pair[1]) for m in moved if m is not None), default=0.0)
            if size > 0.0:
                found.append(ForceLeft(rms(pair[0] - pair[1]) / size, noise / size))
    return min(found, key=lambda left: left.lack, default=None)


def _noisier(run: PreparedRun, judgement: Judgement) -> Iterator[PreparedRun]:
    """The run with its path's white noise once more, where it is followed and compared."""
    for output in run.outputs:
        block = judgement.noise.blocks.get(block_key(run, output))
        if run.observed is None or block is None or output.quantity not in ("angle", "position"):
            continue
        noise = block.sigma * np.random.default_rng([SEED, run.index]).standard_normal(output.data.size)
        start = float(output.times[0])
        path = run.observed.signal(output.times) + noise
        more = bandlimited(path, output.rate, start)
        yield replace(run, observed=replace(run.observed, signal=more))
        return
