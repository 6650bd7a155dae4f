"""Damped least squares on whitened residuals, run to a converged optimum.

An unconverged base is the first source of false alarms (B.2, stage 1): what a candidate effect then explains is the
rest of the way to the optimum. Hence Marquardt damping, scaled coordinates, bounds, and |P_B w| / |w| as the measure
of convergence, P_B the projection on the tangent space of the free parameters.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve
from scipy.linalg.blas import dger

from jointscope.diagnosis.coordinates import Coordinates
from jointscope.diagnosis.objective import Objective

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Behind = Callable[[Vector], float]

TOLERANCE = 1e-4  # |P_B w| / |w| at convergence
LOG_STEP = 0.7  # longest step in a logarithm
RELATIVE_STEP = 3.0  # longest step in any other coordinate, in its own units
CORNERS = 4  # limits that a step may run into, one after the other
GOOD = (0.6, 1.6)  # actual over predicted decrease within which the Jacobian is trusted
LAST = 2  # tries, of whose gain ...
PATIENCE = 3.0  # ... a search may lack so many times as much and still catch up


@dataclass(frozen=True, eq=False)
class Fit:
    """An optimum, or the best point reached.

    Attributes:
        x: Coordinates, shape (n,).
        w: Whitened residual there, shape (n_samples,).
        jacobian: dw/dx, shape (n_samples, n); approximate unless ``fresh``.
        gradient_ratio: |P_B w| / |w|.
        converged: Whether the ratio is below tolerance, or no step decreases the cost with a fresh Jacobian.
        simulations: Evaluations of the whole set of runs.
    """

    coordinates: Coordinates
    x: Vector
    w: Vector
    jacobian: Matrix
    gradient_ratio: float
    converged: bool
    fresh: bool
    simulations: int

    @property
    def chi2(self) -> float:
        """w'w."""
        return float(self.w @ self.w)


def _movable(x: Vector, gradient: Vector, where: Coordinates) -> NDArray[np.intp]:
    at_lower = (x <= where.lower + 1e-12) & (gradient > 0.0)
    at_upper = (x >= where.upper - 1e-12) & (gradient < 0.0)
    return np.flatnonzero(~(at_lower | at_upper))


def _step(normal: Matrix, gradient: Vector, damping: float) -> Vector:
    """-(A + damping diag A)^-1 g, scaled so that a column of any unit counts alike.

    Along a column of nothing, or of more than a number holds (a law that flies apart there), there is no step.
    """
    own = np.diag(normal)
    dead = ~((own > 1e-200) & (own < 1e200) & np.isfinite(gradient))
    size = np.sqrt(np.where(dead, 1.0, own))
    scaled = np.where(dead[:, None] | dead, 0.0, normal) / np.outer(size, size)
    scaled[np.diag_indices_from(scaled)] += damping + 1e-10
    scaled[dead, dead] = 1.0
    solution: Vector = -cho_solve(cho_factor(scaled), np.where(dead, 0.0, gradient) / size) / size
    return solution


def tangent_share(jacobian: Matrix, w: Vector, x: Vector, where: Coordinates) -> float:
    """|P_B w| / |w| over the coordinates that are not held by a bound."""
    return _share(jacobian.T @ jacobian, jacobian.T @ w, w, x, where)


def _share(normal: Matrix, gradient: Vector, w: Vector, x: Vector, where: Coordinates) -> float:
    movable = _movable(x, gradient, where)
    if movable.size == 0 or not np.any(w):
        return 0.0
    step = _step(normal[np.ix_(movable, movable)], gradient[movable], 0.0)
    along = np.where(step != 0.0, gradient[movable], 0.0)  # where there is no step a gradient may be no number
    return math.sqrt(max(-float(along @ step), 0.0)) / float(np.linalg.norm(w))


def _hopeless(state: _Search, behind: Behind, lacks: list[float]) -> bool:
    """Whether a search will not catch up: neither at the pace of its last tries nor where its tangents meet the data.

    Args:
        lacks: How far it was behind before every try; the present one is added.
    """
    lacks.append(behind(state.w))
    if len(lacks) <= LAST or lacks[-1] <= PATIENCE * max(lacks[-1 - LAST] - lacks[-1], 0.0):
        return False
    normal, gradient = state.normal
    movable = _movable(state.x, gradient, state.where)
    step = np.zeros_like(state.x)
    step[movable] = _step(normal[np.ix_(movable, movable)], gradient[movable], 0.0)
    return behind(state.w + state.jacobian @ step) > 0.0


@dataclass(eq=False)
class _Search:
    """Where the optimiser stands; columns are fresh when they were differenced at this very ``x``."""

    objective: Objective
    where: Coordinates
    x: Vector
    w: Vector
    jacobian: Matrix
    spent: int
    base_fresh: bool
    effects_fresh: bool
    _normal: tuple[Matrix, Vector] | None = None

    @property
    def normal(self) -> tuple[Matrix, Vector]:
        """J'J and J'w where it stands."""
        if self._normal is None:
            self._normal = self.jacobian.T @ self.jacobian, self.jacobian.T @ self.w
        return self._normal

    @property
    def share(self) -> float:
        """|P_B w| / |w|, see :func:`tangent_share`."""
        return _share(*self.normal, self.w, self.x, self.where)

    def move(self, x: Vector, w: Vector) -> None:
        """Stand at ``x``, where the residual is ``w``."""
        self.x, self.w, self._normal = x, w, None
        self.base_fresh = self.effects_fresh = False

    def learn(self, moved: Vector, missed: Vector, *, stays: bool) -> None:
        """Broyden's update: J moved as it turned out, ``missed`` more than expected.

        Where the search ``stays``, columns that were differenced here are right, and the stale ones missed it.
        """
        if stays:
            moved = moved.copy()
            moved[: self.where.n_base] *= not self.base_fresh
            moved[self.where.n_base :] *= not self.effects_fresh
        if float(moved @ moved) < 1e-200:  # of such a step nothing is learnt
            return
        transposed = np.ascontiguousarray(self.jacobian).T
        self.jacobian = dger(1.0 / float(moved @ moved), moved, missed, a=transposed, overwrite_a=1).T
        self._normal = None

    def refresh(self, which: range) -> None:
        if len(which) == 0:
            return
        self._normal = None
        self.jacobian[:, which.start : which.stop] = self.objective.columns(self.x, self.where, self.w, which)
        self.spent += len(which)
        self.effects_fresh = self.effects_fresh or which.stop == self.where.n
        self.base_fresh = self.base_fresh or which.start == 0

    def refresh_stale(self) -> None:
        """The effects' columns first: they change most from point to point, and they are few."""
        effects = range(self.where.n_base, self.where.n)
        if not self.effects_fresh and len(effects):
            self.refresh(effects)
        elif not self.base_fresh:
            self.refresh(range(0, self.where.n_base))

    @property
    def fresh(self) -> bool:
        return self.base_fresh and (self.effects_fresh or self.where.n == self.where.n_base)


def _bounded_step(
    x: Vector, normal: Matrix, gradient: Vector, movable: NDArray[np.intp], where: Coordinates, damping: float
) -> Vector:
    """The damped step within bounds and step limits: where it meets one, the other coordinates make up for it."""
    limit = np.where(where.logarithm, LOG_STEP, RELATIVE_STEP)
    low, high = np.maximum(-limit, where.lower - x), np.minimum(limit, where.upper - x)
    moved, free = np.zeros_like(x), movable
    for _ in range(CORNERS):
        held = np.setdiff1d(movable, free)
        rest = gradient[free] + normal[np.ix_(free, held)] @ moved[held]
        step = _step(normal[np.ix_(free, free)], rest, damping)
        moved[free] = np.clip(step, low[free], high[free])
        free = free[moved[free] == step]
        if free.size in (0, step.size):
            break
    return moved


def _try(state: _Search, damping: float) -> tuple[Vector, Vector, float] | None:
    """A damped step within bounds and step limits: (target, w there, actual over predicted decrease)."""
    where = state.where
    normal, gradient = state.normal
    movable = _movable(state.x, gradient, where)
    if movable.size == 0:
        return None
    moved = _bounded_step(state.x, normal, gradient, movable, where, damping)
    target = np.clip(state.x + moved, where.lower, where.upper)
    if not np.any(moved):
        return None
    candidate = state.objective.residual(target, where)
    state.spent += 1
    expected = state.w + state.jacobian @ moved
    predicted = float(state.w @ state.w - expected @ expected)
    actual = float(state.w @ state.w - candidate @ candidate)
    if actual > 0.0 or not state.fresh:  # Broyden: a secant is better than a column differenced elsewhere
        state.learn(moved, candidate - expected, stays=actual <= 0.0)
    return target, candidate, actual / predicted if predicted > 0.0 else -1.0


def least_squares(
    objective: Objective,
    where: Coordinates,
    x: Vector,
    *,
    jacobian: Matrix | None = None,
    iterations: int = 12,
    tolerance: float = TOLERANCE,
    simulations: int = 10_000,
    behind: Behind | None = None,
) -> Fit:
    """Minimise w'w from ``x`` by Levenberg-Marquardt with Broyden updates between fresh Jacobians.

    Args:
        jacobian: A Jacobian known near ``x`` (the base's columns at the base's optimum, say); it is refreshed where
            its predictions fail, the effects' columns first.
        iterations: Steps tried at most.
        simulations: Evaluations spent at most; the best point reached is returned.
        behind: How far a residual is behind what is of use, which is nought and less; a search that will not get there is
            left where it is.
    """
    x = np.clip(x, where.lower, where.upper)
    w = objective.residual(x, where)
    known = np.zeros((len(w), where.n)) if jacobian is None else jacobian.copy()
    known[:, list(where.held)] = 0.0
    state = _Search(objective, where, x, w, known, 1, False, False)
    if jacobian is None:
        state.refresh(range(where.n))
    damping, growth, converged = 1e-3, 2.0, False
    lacks: list[float] = []
    for _ in range(iterations):
        if state.share < tolerance:
            if not state.fresh and simulations - state.spent > where.n:
                state.refresh(range(where.n))
            if state.share < tolerance:
                converged = True
                break
        if simulations - state.spent < 1 or (behind is not None and _hopeless(state, behind, lacks)):
            break
        attempt = _try(state, damping)
        if attempt is None:
            converged = state.fresh
            break
        target, candidate, trust = attempt
        if candidate @ candidate < state.w @ state.w:
            state.move(target, candidate)
            damping, growth = max(damping * (0.33 if trust > 0.7 else 1.0), 1e-9), 2.0
        else:
            damping, growth = max(damping * growth, 1e-3), growth * 2.0
        if not GOOD[0] < trust < GOOD[1] and simulations - state.spent > where.n:
            state.refresh_stale()
        if damping > 1e6:
            break
    ratio = state.share
    return Fit(
        where, state.x, state.w, state.jacobian, ratio, converged or ratio < tolerance, state.fresh, state.spent
    )


def fitted_on(objective: Objective, fit: Fit, iterations: int, simulations: int) -> Fit:
    """The fit as far as it goes: one that began far from the data is short of it when a first fit's budget is spent."""
    return least_squares(
        objective, fit.coordinates, fit.x, jacobian=fit.jacobian, iterations=iterations, tolerance=3e-3,
        simulations=simulations,
    )  # fmt: skip


def with_fresh_jacobian(objective: Objective, fit: Fit) -> Fit:
    """The fit with its Jacobian recomputed where it stands."""
    if fit.fresh:
        return fit
    w = objective.residual(fit.x, fit.coordinates)
    jacobian = objective.columns(fit.x, fit.coordinates, w, range(fit.coordinates.n))
    ratio = tangent_share(jacobian, w, fit.x, fit.coordinates)
    return Fit(
        fit.coordinates, fit.x, w, jacobian, ratio, fit.converged, True, fit.simulations + 1 + fit.coordinates.n
    )


def unspent(fit: Fit) -> Matrix:
    """The Jacobian with nothing in the columns of limited nuisances that stand at a bound: they give no more, shape (n, n_x)."""
    where = fit.coordinates
    at_bound = (fit.x <= where.lower + 1e-12) | (fit.x >= where.upper - 1e-12)
    spent = [k for k in where.limited if at_bound[k]]
    if not spent:
        return fit.jacobian
    left = fit.jacobian.copy()
    left[:, spent] = 0.0
    return left


def covariance(fit: Fit, overdispersion: float = 1.0) -> Matrix:
    """Covariance of the coordinates, (J'J/c^2 + B)^-1, shape (n, n); coordinates the data do not see get infinity.

    B is what their bounds say of the base's own parameters: of one that is anywhere in a range of width b, 12/b^2. A
    torque's offset that no posture tells from the arm's weight is known by that alone.
    """
    normal = fit.jacobian.T @ fit.jacobian / overdispersion
    size = np.sqrt(np.diag(normal))
    seen = size > 1e-100
    width = (fit.coordinates.upper - fit.coordinates.lower)[: fit.coordinates.n_base]
    of_bounds = np.zeros(len(size))
    of_bounds[: len(width)][width > 0.0] = 12.0 / width[width > 0.0] ** 2
    normal[np.diag_indices_from(normal)] += of_bounds
    result = np.full(normal.shape, 0.0)
    result[np.diag_indices_from(result)] = np.inf
    if np.any(seen):
        size = np.sqrt(np.diag(normal))
        scaled = normal[np.ix_(seen, seen)] / np.outer(size[seen], size[seen])
        inverse = np.linalg.pinv(scaled, rcond=1e-12, hermitian=True)
        result[np.ix_(seen, seen)] = inverse / np.outer(size[seen], size[seen])
    return result
