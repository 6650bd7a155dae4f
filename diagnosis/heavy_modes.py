r"""Modes as heavy as the arm, started where the joint beside them rings as what stood in for it does.

The base, refitted without such a mode, has put its one resonance lambda = K_0/J_0 on one of the two that there are, with the
response 1/J_0 of that one. Beside a mount of frequency w and share s = J_L/J_b, or a neighbour of J_p = s J_L, a joint of the
stiffness K and the inertia J_L resonates there and responds as much where

    mount:      K/J_L = k = lambda (w^2 - lambda)/(w^2 - (1 + s) lambda),   J_L = J_0/(1 + (1 - lambda/k)^2/s)
    neighbour:  r = lambda/(w^2 - lambda),  J_L = J_0 (1 + phi r)^2/(1 - s + s (1 + r)^2),   K = lambda J_L (1 + s r)

phi = 0, and of an arm whose outer part of J_p bends the share by which hammer and sensor ride on that part

(the two-mass eigenproblem solved for the joint). lambda may be the lower or the upper one of the two. Where the recordings
ring at another, mu, as well, w lies between them and the share follows:

    mount:      1 + s = w^2 (mu (w^2 - mu) - lambda (w^2 - lambda))/(lambda mu (lambda - mu))
    neighbour:  s = (lambda - mu)/(mu^2/(w^2 - mu) - lambda^2/(w^2 - lambda))

A base that ended at neither says nothing; so what the recordings themselves ring at is tried as well, with the inertia that
was expected. Over a grid of w and s, and of how it lies where that differs from posture to posture, the nearest to the data
is fitted; from a small share the search would have to take the base through what explains nothing.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.base import worst_misfit
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.effects.lines import recorded, spectral_peaks
from jointscope.diagnosis.modes_apart import MUCH
from jointscope.diagnosis.refit import fitted_on, least_squares
from jointscope.diagnosis.resonances import FREE
from jointscope.diagnosis.search import Hypothesis, keeps_up, name_of, profile_loss

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.objective import Objective
    from jointscope.diagnosis.problem import Problem
    from jointscope.diagnosis.refit import Fit

Vector = NDArray[np.float64]

TURNED = ("sliding-mount-turned", "carrier-turned")
MOUNTS = ("turning-mount", "sliding-mount", "carrier", *TURNED)
LINKS = ("one-shape", "elbow")
LAWS = (*MOUNTS, "absorber", *LINKS)
_K, _C, _J = (BASE_INDEX[name] for name in ("stiffness", "damping", "load_inertia"))
WAYS = 3  # over half a turn, that a mount may slide or a neighbour's axis lie
ECCENTRICITIES = (0.4, 1.3)  # of its axis: one farther away than the arm's centre of percussion, and one nearer
FREQUENCIES = (0.5, 0.7, 0.88, 1.15, 1.4, 1.8, 2.3, 3.0)  # w/sqrt(lambda)
SHARES = (0.1, 0.3, 0.7, 1.5)
HEAVIEST = 0.85  # of the arm's inertia, a neighbour or an outer part
BEGUN = (12, 35)  # steps and simulations, after which one that explains little is left
RIDES = 0.8  # the share by which hammer and sensor ride on the outer part of an arm, to begin with
LIGHTEST = 0.1  # of the base's inertia, what is left to the joint
BETWEEN = 12  # frequencies of a mode that two resonances are laid out for
APART, TOGETHER = (
    0.05,
    0.1,
)  # of their squares' ratio: farther apart, or nearer, they are not one joint's and one mode's
MOST = 5.0  # the share of a mount
RINGING = 2  # highest peaks of the recordings, tried beside the parent's own resonance
BAND = (0.3, 4.0)  # times the joint's resonance, in which they are sought


def beside_mount(squared: float, inertia: float, own: float, share: float) -> tuple[float, float] | None:
    """K [N m/rad] and J_L [kg m^2] beside a mount, or ``None`` where no joint rings so.

    Args:
        squared: lambda [rad^2/s^2], where the joint is to resonate.
        inertia: J_0 [kg m^2], as which it is to respond there.
        own: w^2 of the mount alone [rad^2/s^2].
        share: J_L over the mount's inertia [-].
    """
    apart = own - (1.0 + share) * squared
    alone = squared * (own - squared) / apart if apart != 0.0 else 0.0
    if alone <= 0.0:
        return None
    load = inertia / (1.0 + (1.0 - squared / alone) ** 2 / share)
    return alone * load, load


def beside_neighbour(
    squared: float, inertia: float, own: float, share: float, rides: float = 0.0
) -> tuple[float, float] | None:
    """The same beside a neighbour, or under an outer part, that is ``share`` of J_L; phi is ``rides``."""
    ratio = squared / (own - squared) if own != squared else 0.0
    stiffer = 1.0 + share * ratio
    if ratio == 0.0 or stiffer <= 0.0:
        return None
    load = inertia * (1.0 + rides * ratio) ** 2 / (1.0 - share + share * (1.0 + ratio) ** 2)
    return squared * load * stiffer, load


def heavy_modes(
    objective: Objective, parent: Fit, candidates: Sequence[ActiveEffect], best: float = math.inf
) -> list[Hypothesis]:
    """The best fit of each law of a heavy mode beside ``parent``; none where that is near the data, or holds a mode.

    Args:
        candidates: Trials of every law.
        best: Loss of the best set of as many effects that is known.
    """
    held = parent.coordinates.effects
    laws = heavy_laws(candidates, held)
    theta, effects = parent.coordinates.unpack(parent.x)
    if not laws or any(spec.family == "mode" for spec in held) or theta[_K] <= 0.0:
        return []
    if worst_misfit(objective.prepared, objective.predictions(theta, effects)) < MUCH:
        return []
    expected, peaks = objective.problem.base.start, rung(objective.problem)
    without = profile_loss(objective, parent.w)
    found = []
    laid = [group for trial in laws for group in groups(theta, expected, peaks, trial)]
    for starts in filter(None, laid):
        spec = starts[0][1].spec
        where = coordinates(objective.problem, (*held, spec))
        base, active = starts[objective.nearest([(base, (*effects, active)) for base, active in starts])]
        x = where.pack(base, (*effects, active))
        fit = least_squares(objective, where, x, iterations=BEGUN[0], tolerance=3e-3, simulations=BEGUN[1])
        if not fit.converged and keeps_up(profile_loss(objective, fit.w), without, min(best, without)):
            fit = fitted_on(objective, fit, *FREE)
        if fit.chi2 < parent.chi2:
            found.append(Hypothesis((*held, spec), fit, profile_loss(objective, fit.w)))
    return found


def heavy_laws(candidates: Sequence[ActiveEffect], held: Sequence[EffectSpec]) -> list[ActiveEffect]:
    """One trial of each law of a heavy mode that no effect beside it has the name of."""
    taken = {name_of(spec) for spec in held}
    first: dict[int, ActiveEffect] = {}
    for active in candidates:
        spec = active.spec
        if spec.family == "mode" and spec.variant in LAWS and name_of(spec) not in taken:
            first.setdefault(id(spec), active)
    return list(first.values())


def groups(
    theta: Vector, expected: Vector, peaks: Sequence[float], trial: ActiveEffect
) -> Iterator[list[tuple[Vector, ActiveEffect]]]:
    """Starts of a law, those in valleys of their own apart: of each the nearest is fitted."""
    for ways in posed(trial):
        yield [
            start
            for way in ways
            for start in (
                *_starts(theta, way),
                *(s for squared in peaks for s in _expected(expected, way, squared)),
            )
        ]
    if trial.spec.variant not in TURNED:
        yield [start for squared in peaks for start in _of_two(theta, trial, squared)]


def posed(trial: ActiveEffect) -> list[list[ActiveEffect]]:
    """The trial, or every way that it may lie where it lies differently in each posture; each list has its own valley."""
    if trial.spec.variant not in TURNED:
        return [[trial]]
    ways = [math.pi * k / WAYS for k in range(WAYS)]
    if not trial.values[5:]:
        return [[ActiveEffect(trial.spec, (*trial.values[:4], way)) for way in ways]]
    both = [*ways, *(way - math.pi for way in ways)]
    return [
        [ActiveEffect(trial.spec, (*trial.values[:4], way, kappa)) for way in both] for kappa in ECCENTRICITIES
    ]


def rung(problem: Problem) -> list[float]:
    """lambda [rad^2/s^2] of the highest peaks of the recordings themselves."""
    low, high = (factor * problem.scales.frequency for factor in BAND)
    peaks = spectral_peaks(problem, recorded(problem), low, high, RINGING, narrow=False)
    return [(2.0 * math.pi * f) ** 2 for f in peaks]


def _starts(theta: Vector, trial: ActiveEffect) -> Iterator[tuple[Vector, ActiveEffect]]:
    """Base parameters and the mode, its other numbers as in ``trial``, where the base ``theta`` stood in for both."""
    squared, expected = float(theta[_K] / theta[_J]), float(theta[_J])
    for own, share, joint in _beside(trial, squared, expected):
        if not LIGHTEST * expected < joint[1] < expected / LIGHTEST:
            continue
        base = theta.copy()
        base[_K], base[_J] = joint
        mount = trial.spec.variant in MOUNTS
        base[_C] *= (joint[0] / joint[1] / squared) ** 2 if mount else joint[1] / expected
        yield base, moved(trial, own, share, joint[1])


def _expected(start: Vector, trial: ActiveEffect, squared: float) -> Iterator[tuple[Vector, ActiveEffect]]:
    """The same where the joint has the inertia and the damping that were expected, and ``squared`` is where it all rings."""
    for own, share, joint in _beside(trial, squared, float(start[_J])):
        base = start.copy()
        base[_K] = joint[0] / joint[1] * start[_J]
        yield base, moved(trial, own, share, float(start[_J]))


def _of_two(theta: Vector, trial: ActiveEffect, other: float) -> Iterator[tuple[Vector, ActiveEffect]]:
    """The same where the recordings ring at ``other`` too: the share with which both are the joint's and the mode's."""
    squared, expected = float(theta[_K] / theta[_J]), float(theta[_J])
    mount = trial.spec.variant in MOUNTS
    rides = RIDES if trial.spec.variant in LINKS else 0.0
    if not APART < other / squared < 1.0 / APART or abs(other / squared - 1.0) < TOGETHER:
        return
    for own in np.geomspace(min(squared, other), max(squared, other), BETWEEN + 2)[
        1:-1
    ]:  # they lie on either side of it
        share = between_mount(squared, other, own) if mount else between_neighbour(squared, other, own)
        if share is None or not (0.0 < share < (MOST if mount else HEAVIEST)):
            continue
        joint = (
            beside_mount(squared, expected, own, share)
            if mount
            else beside_neighbour(squared, expected, own, share, rides)
        )
        if joint is None or not LIGHTEST * expected < joint[1] < expected / LIGHTEST:
            continue
        base = theta.copy()
        base[_K], base[_J] = joint
        base[_C] *= joint[1] / expected
        yield base, moved(trial, float(own), share, joint[1])


def between_mount(one: float, other: float, own: float) -> float | None:
    """Share of a mount of ``own`` w^2 with which a joint resonates at both lambdas [rad^2/s^2]; ``None`` where none does."""
    apart = one * other * (one - other)
    difference = other * (own - other) - one * (own - one)
    return difference * own / apart - 1.0 if apart != 0.0 else None


def between_neighbour(one: float, other: float, own: float) -> float | None:
    """The same of a neighbour, or of an outer part that is this share of J_L."""
    if own in (one, other):
        return None
    lever = other**2 / (own - other) - one**2 / (own - one)
    return (one - other) / lever if lever != 0.0 else None


def _beside(
    trial: ActiveEffect, squared: float, inertia: float
) -> Iterator[tuple[float, float, tuple[float, float]]]:
    """w^2, share, and K and J_L, for every frequency and share that can be."""
    mount = trial.spec.variant in MOUNTS
    for factor, ratio in itertools.product(FREQUENCIES, SHARES):
        own, share = squared * factor**2, ratio if mount else min(ratio / (1.0 + ratio), HEAVIEST)
        rides = RIDES if trial.spec.variant in LINKS else 0.0
        joint = (
            beside_mount(squared, inertia, own, share)
            if mount
            else beside_neighbour(squared, inertia, own, share, rides)
        )
        if joint is not None:
            yield own, share, joint


def moved(trial: ActiveEffect, own: float, share: float, load: float) -> ActiveEffect:
    frequency = math.sqrt(own) / (2.0 * math.pi)
    if trial.spec.variant not in LINKS:
        return ActiveEffect(trial.spec, (frequency, share, *trial.values[2:]))
    damping, _, *place = trial.values[2:]
    return ActiveEffect(trial.spec, (frequency, share * load, damping, RIDES / math.sqrt(share), *place))
