"""Where a mismatch sits, by a force without a name: torque tabled against one variable, at motor, transmission or arm.

Every table is fitted to first order on top of the base (base parameters free, ridge on the nodes), and judged on the
held-out runs. What its sensors cannot tell apart, it does not: locations are compared by evidence, and the answer is the
leading one only where it leads by more than the tempered margin. The winning table is the measured shape of an unknown
force, a usable model, and the black box that a named law is compared with.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.adjudicate import Judged, Judgement, evidence
from jointscope.diagnosis.coordinates import Coordinates, coordinates
from jointscope.diagnosis.effects import LATENT, ActiveEffect
from jointscope.diagnosis.effects.latent import node_range, nodes
from jointscope.diagnosis.objective import Objective
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.search import Hypothesis

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import EffectSpec

Vector = NDArray[np.float64]

RIDGE = 1e-3  # of the strongest node's energy: nodes that the runs hardly visit stay at nothing
MARGIN = 3.0  # temperature of the evidence [nats per nat of belief]


@dataclass(frozen=True, eq=False)
class Table:
    """A force without a name at one place.

    Attributes:
        active: The law with its node torques [N m].
        base: Base parameters that go with it, shape (n_theta,).
        nodes: Where they stand [rad or rad/s], shape (9,).
        gain: On the fitted runs, net of Occam [nats].
        held_gain: On the held-out runs [nats]; ``nan`` without any.
    """

    active: ActiveEffect
    base: Vector
    nodes: Vector
    gain: float
    held_gain: float

    @property
    def location(self) -> str:
        """motor, transmission or load."""
        return self.active.spec.location

    @property
    def variable(self) -> str:
        """What the torque depends on."""
        return self.active.spec.variant

    @property
    def score(self) -> float:
        """Evidence over the parent [nats]."""
        return self.gain + (0.0 if math.isnan(self.held_gain) else self.held_gain)


@dataclass(frozen=True, eq=False)
class Places:
    """Evidence for where a force is missing.

    Attributes:
        tables: Best first.
        probabilities: Per location, of those that the channels permit.
        location: The leading one where it is surer than the rest together, else ``None``.
    """

    tables: tuple[Table, ...]
    probabilities: dict[str, float]
    location: str | None


def _secants(
    objective: Objective, where: Coordinates, x: Vector, w: Vector, spec: EffectSpec
) -> NDArray[np.float64]:
    """dw per medium-sized torque at each node, shape (n, 9)."""
    theta, effects = where.unpack(x)
    size = spec.scale(objective.problem)[1]
    tables = nodes(spec, objective.problem)

    def column(task: tuple[int, int]) -> Vector:
        node, run = task
        return objective.run_residual(run, theta, (*effects, tables[node]))

    tasks = [(node, run) for node in range(len(tables)) for run in range(len(objective.runs))]
    parts = objective.map(column, tasks)
    stacked = [
        np.concatenate(parts[k * len(objective.runs) : (k + 1) * len(objective.runs)]) for k in range(len(tables))
    ]
    return (np.stack(stacked, axis=1) - w[:, None]) / size


def tabled(judgement: Judgement, parent: Judged, spec: EffectSpec, held_jacobian: NDArray[np.float64]) -> Table:
    """One table fitted to first order on top of ``parent``."""
    where, x, w = parent.fit.coordinates, parent.fit.x, parent.fit.w
    s = _secants(judgement.objective, where, x, w, spec)
    columns = np.concatenate([parent.fit.jacobian, s], axis=1)
    size = np.linalg.norm(columns, axis=0)
    size[size == 0.0] = 1.0
    normal = (columns / size).T @ (columns / size)
    ridge = np.full(columns.shape[1], 1e-9)
    ridge[where.n :] = RIDGE * (np.max(size[where.n :]) / size[where.n :]) ** 2
    step = -np.linalg.solve(normal + np.diag(ridge), (columns / size).T @ w) / size
    left = w + columns @ step
    samples = max(len(w), 2)
    gain = 0.5 * float(w @ w - left @ left) - 0.5 * len(spec.parameters) * math.log(samples)
    held_gain = math.nan
    if judgement.held.runs:
        held_w = judgement.held.residual(x, where)
        held_s = _secants(judgement.held, where, x, held_w, spec)
        held_left = held_w + np.concatenate([held_jacobian, held_s], axis=1) @ step
        held_gain = 0.5 * float(held_w @ held_w - held_left @ held_left)
    low, high = node_range(judgement.objective.problem, spec.location, spec.variant)
    active = ActiveEffect(spec, tuple(float(v) for v in step[where.n :]))
    moved = np.clip(x + step[: where.n], where.lower, where.upper)
    theta, _ = where.unpack(moved)
    return Table(active, theta, np.linspace(low, high, len(spec.parameters)), gain, held_gain)


def places(judgement: Judgement, parent: Judged, specs: Sequence[EffectSpec] = LATENT) -> Places:
    """Tables at every place and variable on top of ``parent``."""
    problem = judgement.objective.problem
    held = judgement.held
    where, x = parent.fit.coordinates, parent.fit.x
    jacobian = np.zeros((0, where.n))
    if held.runs:
        jacobian = held.columns(x, where, held.residual(x, where), range(where.n))
    tables = [tabled(judgement, parent, spec, jacobian) for spec in specs if spec.possible(problem) is None]
    tables = sorted((t for t in tables if math.isfinite(t.score)), key=lambda t: -t.score)
    best: dict[str, float] = {}
    for table in tables:
        best[table.location] = max(best.get(table.location, -math.inf), table.score)
    if not best:
        return Places((), {}, None)
    top = max(best.values())
    weights = {place: math.exp((value - top) / MARGIN) for place, value in best.items()}
    total = sum(weights.values())
    probabilities = {place: value / total for place, value in weights.items()}
    leader = max(probabilities, key=lambda place: probabilities[place])
    return Places(tuple(tables), probabilities, leader if probabilities[leader] > 0.5 and top > 0.0 else None)


def resized_table(active: ActiveEffect, factor: float) -> ActiveEffect:
    """All node torques multiplied."""
    return ActiveEffect(active.spec, tuple(factor * v for v in active.values))


def judged_table(judgement: Judgement, table: Table) -> Judged:
    """The table fitted by simulation error, base free: the usable model of an unknown force, and the black box."""
    base = judgement.base
    where = coordinates(judgement.objective.problem, (table.active.spec,))
    alone, _ = base.fit.coordinates.unpack(base.fit.x)
    starts = [where.pack(table.base, (table.active,)), where.pack(alone, (resized_table(table.active, 0.3),))]
    x = min(starts, key=lambda start: float(np.sum(np.square(judgement.objective.residual(start, where)))))
    fit = least_squares(judgement.objective, where, x, iterations=8, tolerance=1e-3, simulations=70)
    return evidence(Hypothesis((table.active.spec,), fit, 0.5 * fit.chi2), judgement.objective, judgement.held)
