"""Where the base leaves much: modes fitted from where most is left beside the joint's own resonance.

To first order in a small amplitude a mode near the joint's own resonance explains most of any mismatch there, and one
elsewhere only what its start's shape has the right sign for. But a search from the right frequency finds the shape. So of
each plain law of a mode the starts at the highest peaks of what is left are fitted as well. A mode as heavy as the arm moves the
joint's resonance itself, and what a base leaves that took its stiffness from that one has peaks at neither; where most is
left, starts above the base's resonance are fitted too. Of hits in several postures, a mount that slides along the tangent of
each is the way to the one that slides along one direction: from the base, what a posture lacks stands for all of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from jointscope.diagnosis.base import relative_misfit
from jointscope.diagnosis.effects.lines import spectral_peaks
from jointscope.diagnosis.effects.spec import ActiveEffect
from jointscope.diagnosis.refit import fitted_on
from jointscope.diagnosis.resonances import FREE
from jointscope.diagnosis.search import Effort, Hypothesis, fit_child, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.effects.lines import Residuals
    from jointscope.diagnosis.objective import Objective
    from jointscope.diagnosis.problem import Problem
    from jointscope.diagnosis.refit import Fit

MUCH = 0.1  # of the data's rms, left by the base in the median channel
NEAR = math.log(1.1)  # of a peak, within which a law must have a start
TRIED = 4  # peaks
MOST = 0.5  # of the data's rms, likewise, beyond which a mode may be as heavy as the arm
ABOVE = (1.2, 1.5, 1.9, 2.4)  # times the base's resonance, where such a mode is sought
PLAIN = ("one-shape", "absorber", "turning-mount", "sliding-mount", "carrier")
SLIDING, TURNED = "sliding-mount", "sliding-mount-turned"
WAYS = 6  # over half a turn, after which such a mount is the same
BAND = (0.6, 8.0)  # times the joint's resonance


def modes_apart(
    objective: Objective,
    base: Fit,
    candidates: Sequence[ActiveEffect],
    whole: Problem,
    left: Residuals,
    effort: Effort,
) -> list[Hypothesis]:
    """The best fit of each plain law of a mode from the highest peaks; none where the base is near the data.

    Args:
        candidates: Trials of every law.
        whole: The problem with its runs whole, of which the objective's may be a part.
        left: What the base leaves of all runs of ``whole``.
    """
    laws = _laws(candidates)
    theta, _ = base.coordinates.unpack(base.x)
    misfit = relative_misfit(objective.prepared, objective.predictions(theta, ())) if laws else 0.0
    if misfit < MUCH:
        return []
    resonance = objective.problem.scales.frequency
    low, high = (factor * resonance for factor in BAND)
    peaks = list(spectral_peaks(whole, left, low, high, TRIED, narrow=False))
    if misfit > MOST:
        peaks.extend(factor * resonance for factor in ABOVE)
    found = []
    for trials in laws:
        reached: Fit | None = None
        for peak in peaks:
            near = min(trials, key=lambda a: (abs(math.log(a.values[0] / peak)), -a.values[a.spec.amplitude]))
            if abs(math.log(near.values[0] / peak)) < NEAR:
                reach = math.inf if reached is None else profile_loss(objective, reached.w)
                fit = fit_child(objective, base, [near], effort, reach=reach)
                if fit is not None and (reached is None or fit.chi2 < reached.chi2):
                    reached = fit
        if reached is not None:
            best = fitted_on(objective, reached, *FREE)
            found.append(Hypothesis((trials[0].spec,), best, profile_loss(objective, best.w)))
    return [*found, *_turned(objective, base, found, candidates, effort)]


def _turned(
    objective: Objective,
    base: Fit,
    found: Sequence[Hypothesis],
    candidates: Sequence[ActiveEffect],
    effort: Effort,
) -> list[Hypothesis]:
    """The mount that slides one way in every posture, from the one that slides along the tangent of each."""
    turned = next((a.spec for a in candidates if a.spec.variant == TURNED), None)
    plain = next((h for h in found if h.specs[0].variant == SLIDING), None)
    if turned is None or plain is None:
        return []
    theta, (mount,) = plain.fit.coordinates.unpack(plain.fit.x)
    ways = [ActiveEffect(turned, (*mount.values, math.pi * k / WAYS)) for k in range(WAYS)]
    near = min(ways, key=lambda way: objective.misfit(theta, (way,)))
    fit = fit_child(objective, base, [near], effort, [theta])
    if fit is None:
        return []
    best = fitted_on(objective, fit, *FREE)
    return [Hypothesis((turned,), best, profile_loss(objective, best.w))]


def _laws(candidates: Sequence[ActiveEffect]) -> list[list[ActiveEffect]]:
    """The trials of each plain law of a mode."""
    laws: dict[int, list[ActiveEffect]] = {}
    for active in candidates:
        if active.spec.family == "mode" and active.spec.variant in PLAIN and not active.spec.of_own_frequency:
            laws.setdefault(id(active.spec), []).append(active)
    return list(laws.values())
