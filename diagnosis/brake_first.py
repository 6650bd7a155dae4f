"""Where hits on the brake are the plain base's, what is left out acts where the motor moves: the hits' own base.

A base that is fitted to all runs goes where the loudest mismatch pulls it. A kinematic error of 130 urad took a stiffness of
38.2 kN m/rad to its lower bound, 0.8 kN m/rad, from which no law finds the data; six hits on the brake, which that error does
not move, alone say 38.2. Such a base is the point that every law is tried from (:mod:`jointscope.diagnosis.other_base`),
wherever it foretells the hits far better than the base of all runs does.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from jointscope.diagnosis.base import EARLY_ORDER, relative_misfit, rewhiten
from jointscope.diagnosis.noise import white
from jointscope.diagnosis.objective import whitened
from jointscope.diagnosis.refit import Fit, least_squares

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from jointscope.diagnosis.objective import Objective

    Vector = NDArray[np.float64]

FEWEST = 3  # hits on the brake
POOR = 0.3  # of the hits' rms, left by the base of all runs
BETTER = 0.3  # times that, which the hits' own base must leave at most


def braked_hits(objective: Objective) -> list[int]:
    """Positions of the hits in which a brake holds the motor, where other runs move it; none where all or none are."""
    found = [
        i for i, run in enumerate(objective.prepared) if run.mode == "braked" and run.run.experiment == "hammer"
    ]
    moved = any(run.motor_moves for run in objective.prepared)
    return found if len(found) >= FEWEST and moved else []


def of_the_brake(objective: Objective, base: Fit) -> Vector | None:
    """Base parameters that the hits on the brake alone give; ``None`` where the base of all runs foretells these about as well.

    What they do not tell stays as the campaign states it.
    """
    hits = braked_hits(objective)
    if not hits:
        return None
    alone = objective.restricted(hits)
    theta, _ = base.coordinates.unpack(base.x)
    left = relative_misfit(alone.prepared, alone.predictions(theta, ()))
    if left < POOR:
        return None
    where = base.coordinates
    noise = white(alone.prepared)
    own = whitened(alone, noise, None)
    fits = [least_squares(own, where, x, iterations=15) for x in (where.pack(where.start, ()), base.x)]
    fit = min(fits, key=lambda fit: fit.chi2)
    own, _, _ = rewhiten(own, fit, noise, EARLY_ORDER)
    fit = least_squares(own, where, fit.x, iterations=10)
    found, _ = where.unpack(fit.x)
    return found if relative_misfit(alone.prepared, alone.predictions(found, ())) < BETTER * left else None
