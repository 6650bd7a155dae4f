"""Where much is left: modes fitted from where most is left beside the joint's own resonance.

To first order in a small amplitude a mode near the joint's own resonance explains most of any mismatch there, and one
elsewhere only what its start's shape has the right sign for. But a search from the right frequency finds the shape. So of
each name's first law of a mode the starts at the highest peaks of what is left are fitted as well.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from jointscope.diagnosis.base import relative_misfit
from jointscope.diagnosis.effects.lines import spectral_peaks
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.resonances import FREE
from jointscope.diagnosis.search import Effort, Hypothesis, fit_child, name_of, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect
    from jointscope.diagnosis.effects.lines import Residuals
    from jointscope.diagnosis.objective import Objective
    from jointscope.diagnosis.refit import Fit

MUCH = 0.1  # of the data's rms, left in the median channel
NEAR = math.log(1.1)  # of a peak, within which a law must have a start
TRIED = 4  # peaks
BAND = (0.6, 8.0)  # times the joint's resonance


def modes_apart(
    objective: Objective, parent: Hypothesis, candidates: Sequence[ActiveEffect], left: Residuals, effort: Effort
) -> list[Hypothesis]:
    """The best fit of each name's first law of a mode from the highest peaks; none where the parent is near the data.

    Args:
        parent: The base, or a set that has no mode yet.
        candidates: Trials of every law.
        left: What the parent leaves.
    """
    if any(spec.family == "mode" for spec in parent.specs):
        return []
    laws = _first_laws(candidates)
    theta, effects = parent.fit.coordinates.unpack(parent.fit.x)
    if not laws or relative_misfit(objective.prepared, objective.predictions(theta, effects)) < MUCH:
        return []
    low, high = (factor * objective.problem.scales.frequency for factor in BAND)
    peaks = spectral_peaks(objective.problem, left, low, high, TRIED, narrow=False)
    found = []
    for trials in laws:
        fits = []
        for peak in peaks:
            near = min(trials, key=lambda a: (abs(math.log(a.values[0] / peak)), -a.values[a.spec.amplitude]))
            if abs(math.log(near.values[0] / peak)) < NEAR:
                fits.append(fit_child(objective, parent.fit, [near], effort))
        reached = [fit for fit in fits if fit is not None]
        if reached:
            best = _to_its_end(objective, min(reached, key=lambda fit: fit.chi2))
            found.append(Hypothesis((*parent.specs, trials[0].spec), best, profile_loss(objective, best.w)))
    return found


def _to_its_end(objective: Objective, fit: Fit) -> Fit:
    """The fit as far as it goes: one that begins far from the data is short of it when a first fit's budget is spent."""
    return least_squares(
        objective,
        fit.coordinates,
        fit.x,
        jacobian=fit.jacobian,
        iterations=FREE[0],
        tolerance=3e-3,
        simulations=FREE[1],
    )


def _first_laws(candidates: Sequence[ActiveEffect]) -> list[list[ActiveEffect]]:
    first: dict[str, list[ActiveEffect]] = {}
    for active in candidates:
        spec = active.spec
        if spec.family != "mode" or spec.of_own_frequency or spec.parameters[0].name != "frequency":
            continue
        trials = first.setdefault(name_of(spec), [])
        if not trials or trials[0].spec is spec:
            trials.append(active)
    return list(first.values())
