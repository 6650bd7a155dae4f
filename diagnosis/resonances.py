"""Effects whose size is their own frequency, followed down from where they are rigid, the base refitted on the way.

A joint that the model has rigid is absent at an infinite frequency, not at a zero amplitude: what it does at 100 Hz says
nothing of what it does at 20 Hz. And the base, refitted without it, has taken its other springs elsewhere to stand in for
it, so that the right frequency beside that base is worse than none. But the base beside a slightly softer joint is near
the base beside a slightly stiffer one. Where the misfit along that path has a minimum, the frequency is freed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.base import relative_misfit
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.refit import Fit, fitted_on, least_squares
from jointscope.diagnosis.search import Hypothesis, held_at, name_of, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.objective import Objective

Vector = NDArray[np.float64]

STEP = 1.25  # from one frequency of the path to the next
LOWEST = 8.0  # Hz
HOPELESS = 10.0  # times the base's misfit, beyond which a softer joint is not asked for
ALONG = (3, 8)  # steps and simulations per frequency of the path
FREED = 2  # minima of the paths that are freed
FREE = (30, 100)  # steps and simulations then: modes of neighbouring joints are told apart by converged fits only
MUCH = 0.1  # of the data's rms, left by a leading set in the median channel, beside which modes are sought
WORTH = 0.9  # of what the base leaves; a mode that leaves less is fitted on ...
ON = (60, 250)  # ... for so many steps and simulations


def resonances_beside(
    objective: Objective, parent: Hypothesis, candidates: Sequence[ActiveEffect]
) -> list[Hypothesis]:
    """The same beside a leading set that leaves much: a joint that yields somewhere hides behind play in another."""
    others = [active for active in candidates if name_of(active.spec) not in parent.names]
    if not any(active.spec.of_own_frequency for active in others):
        return []
    predictions = objective.predictions(*parent.fit.coordinates.unpack(parent.fit.x))
    if relative_misfit(objective.prepared, predictions) < MUCH:
        return []
    return resonances(objective, parent.fit, others)


def resonances(objective: Objective, base: Fit, candidates: Sequence[ActiveEffect]) -> list[Hypothesis]:
    """Every mode of a frequency of its own that explains anything beside ``base`` and its effects, if any, fitted."""
    shapes: dict[str, dict[tuple[float, ...], ActiveEffect]] = {}
    for active in candidates:
        if active.spec.of_own_frequency:
            at = active.spec.amplitude
            shape = (*active.values[:at], *active.values[at + 1 :])
            shapes.setdefault(name_of(active.spec), {}).setdefault(shape, active)
    found = []
    for of_name in shapes.values():
        starts = [
            start for active in of_name.values() for start in _minima(_path(objective, base, active))[:FREED]
        ]
        freed = [_freed(objective, start) for start in sorted(starts, key=lambda fit: fit.chi2)[:FREED]]
        best = min(freed, key=lambda fit: fit.chi2)
        if (
            not best.converged and best.chi2 < WORTH * base.chi2
        ):  # beside free inertias a frequency's valley is narrow
            best = fitted_on(objective, best, *ON)
        if best.chi2 < base.chi2:
            found.append(Hypothesis(best.coordinates.effects, best, profile_loss(objective, best.w)))
    return found


def _path(objective: Objective, base: Fit, active: ActiveEffect) -> list[Fit]:
    """The base refitted beside the mode at ever lower frequencies, the mode's own figures held."""
    spec = active.spec
    theta, others = base.coordinates.unpack(base.x)
    where = coordinates(objective.problem, (*base.coordinates.effects, spec))
    own = range(base.coordinates.n, where.n)
    values = np.array(active.values)
    jacobian = np.concatenate([base.jacobian, np.zeros((len(base.w), len(own)))], axis=1)
    frequency = spec.parameters[spec.amplitude].upper / STEP
    path: list[Fit] = []
    while frequency > LOWEST and not (path and path[-1].chi2 > HOPELESS * base.chi2):
        values[spec.amplitude] = frequency
        x = where.pack(theta, (*others, ActiveEffect(spec, tuple(float(v) for v in values))))
        fit = least_squares(
            objective, held_at(where, x, list(own)), x, jacobian=jacobian, iterations=ALONG[0], tolerance=1e-2,
            simulations=ALONG[1],
        )  # fmt: skip
        path.append(replace(fit, coordinates=where))
        (theta, effects), jacobian = where.unpack(fit.x), fit.jacobian
        others = effects[:-1]
        frequency /= STEP
    return path


def _minima(path: Sequence[Fit]) -> list[Fit]:
    """Fits along the path that are better than either neighbour, best first; never empty."""
    costs = [math.inf, *(fit.chi2 for fit in path), math.inf]
    lowest = [fit for k, fit in enumerate(path) if costs[k] > fit.chi2 <= costs[k + 2]]
    return sorted(lowest, key=lambda fit: fit.chi2)


def _freed(objective: Objective, start: Fit) -> Fit:
    where, own = start.coordinates, range(start.coordinates.n_base, start.coordinates.n)
    jacobian = start.jacobian.copy()
    jacobian[:, own.start :] = objective.columns(start.x, where, start.w, own)
    return least_squares(
        objective, where, start.x, jacobian=jacobian, iterations=FREE[0], tolerance=3e-3, simulations=FREE[1]
    )
