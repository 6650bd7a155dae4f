"""How near a wrong name can come to a case: a look-alike's strength and shape fitted to it together with the base."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from jointscope.sim.concealed.law import Effect
from jointscope.sim.concealed.strength import Sight
from jointscope.sim.concealed.yardstick import Yardstick, changed, misfit_of, off

Real = NDArray[np.float64]


def refitted(
    yard: Yardstick, sight: Sight, rival: Effect, free: Sequence[str], limits: tuple[float, float], steps: int = 24
) -> float:
    """z_d by a full refit: how far ``rival``, with the base and its own parameters free, stays from the truth.

    Levenberg-Marquardt on the whitened misfit with logarithms of the base's parameters, of the rival's strength and of
    its ``free`` parameters as unknowns; hits' gain and timing projected out. Slopes by secants, kept up by Broyden's
    update, taken anew where a step fails; it ends where fresh slopes don't gain a per cent either.

    Args:
        yard: Where.
        sight: The truth.
        rival: Where to start from.
        free: Its parameters that may change beside its strength.
        limits: Of the strength.
        steps: Most trials.
    """
    names = list(yard.steps)
    bounds = np.sort(np.log(np.array(limits) / rival.values[rival.law.strength]))

    def left(x: Real) -> Real:
        rig = changed(yard.rig, dict(zip(names, x[: len(names)], strict=True)))
        values = dict(rival.values)
        for name, shift in zip((rival.law.strength, *free), x[len(names) :], strict=True):
            values[name] = values[name] * float(np.exp(shift))
        try:
            misfit = misfit_of(rig, yard.plan, yard.runs, sight.record, None, (Effect(rival.law, values),))
        except FloatingPointError:
            return np.full(yard.origin.size, np.inf)
        return off(yard.scatter, yard.white(misfit) - yard.origin)

    x = np.zeros(len(names) + 1 + len(free))
    shift = np.array([0.01] * len(names) + [0.1] + [0.03] * len(free))
    r, damping, fresh = left(x), 1e-3, False
    if not np.all(np.isfinite(r)):
        return float("inf")
    slopes = np.zeros((r.size, 0))
    for _ in range(steps):
        if not slopes.size:
            slopes = _slopes(left, x, r, shift)
            fresh = True
        before = float(np.linalg.norm(r))
        trial = x + _damped(slopes, r, damping)
        trial[len(names)] = np.clip(trial[len(names)], *bounds)
        new = left(trial)
        after = float(np.linalg.norm(new))
        if np.isfinite(after) and np.any(trial != x):
            move = trial - x
            slopes = slopes + np.outer(new - r - slopes @ move, move) / float(move @ move)
        if after < before:
            x, r, damping = trial, new, damping / 5.0
        else:
            damping *= 10.0
        if after > 0.99 * before:
            if fresh and (after <= before or damping > 1e-2):
                break
            if not fresh:
                slopes = np.zeros((r.size, 0))
        else:
            fresh = False
    return float(np.linalg.norm(r))


def _slopes(left: Callable[[Real], Real], x: Real, r: Real, shift: Real) -> Real:
    """dr/dx by secants, shape (n, k); nothing along what the engine can't follow one step away, which then stays put."""
    slopes = np.column_stack([(left(x + h * e) - r) / h for h, e in zip(shift, np.eye(x.size), strict=True)])
    return np.where(np.all(np.isfinite(slopes), axis=0), slopes, 0.0)


def _damped(slopes: Real, r: Real, damping: float) -> Real:
    size = np.maximum(np.linalg.norm(slopes, axis=0), 1e-12)
    scaled = slopes / size
    move = -np.linalg.solve(scaled.T @ scaled + damping * np.eye(size.size), scaled.T @ r) / size
    return np.asarray(np.clip(move, -1.0, 1.0))
