"""Whether hits show a mode that other runs ask for: nothing excites a structure's modes as evenly as a hammer.

The noise of a torque log rings at the joint's own resonance, and a further mode beside that resonance makes up for it: on a
null with three noisy phase currents a bend of the arm gained 115 nats in the motions and nothing in eight hits.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import PreparedRun
    from jointscope.diagnosis.search import Hypothesis

Vector = NDArray[np.float64]

SHOWN = 12.0  # nats that a mode gains in all hits together
ENOUGH = 4  # hits, below which they decide nothing


def modes(hypothesis: Hypothesis) -> set[str]:
    """The names of a hypothesis's modes that hits are made to show."""
    return {
        f"{spec.name}@{spec.location}"
        for spec in hypothesis.specs
        if spec.family == "mode" and "hammer" in spec.revealed_by
    }


def unheard(runs: Sequence[PreparedRun], gains: Vector) -> bool:
    """Whether hits beside other experiments, at these gains per run [nats], shape (n_runs,), do not show a mode."""
    hits = np.array([run.run.experiment == "hammer" for run in runs])
    if int(hits.sum()) < ENOUGH or bool(hits.all()):
        return False
    return float(gains[hits].sum()) < SHOWN
