"""The further modes of a structure that is hit, found in what the base leaves of the hits: starts for ``effects.bends``.

One after the other: where the remainder follows the hammer most clearly a mode is tried at several dampings, then the
frequencies and dampings of all are refined with every share at its linear best (variable projection), until the next one
explains too little.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from jointscope.diagnosis.acquisition import load_input
from jointscope.diagnosis.assembly import assemble
from jointscope.diagnosis.channels import recorded
from jointscope.diagnosis.effects import bends
from jointscope.diagnosis.effects.lines import Residuals, response_peaks, spectral_peaks
from jointscope.diagnosis.superposition import accelerometers, modal_acceleration

if TYPE_CHECKING:
    from jointscope.diagnosis.base import Stage
    from jointscope.diagnosis.effects import EffectSpec
    from jointscope.diagnosis.problem import Output, PreparedRun

Vector = NDArray[np.float64]

FEWEST = 2  # modes; one bend has laws of its own
TELLING = 0.05  # of the energy that is left, below which a further mode is not worth its numbers
DAMPINGS = (0.001, 0.003, 0.01, 0.03)  # tried
WORTH = 0.003  # of the energy that the base leaves, alike
PATIENCE = 2  # modes in a row that are not worth it, after which no more are looked for
WIDTHS = 4.0  # half widths of a peak within which there is no other
TRIED = 3  # frequencies for each mode
HITS = 4  # that modes are looked for in
REACH = 0.49  # of the sampling rate


@dataclass(frozen=True, eq=False)
class _Hits:
    """What modes are looked for in.

    Attributes:
        forces: Torque on the arm over J_L per run, on the run's grid.
        runs: Of the problem, by position.
        left: What the base leaves, per run and place, over the place's root energy.
        base: What the base says, alike.
        scales: Those roots, per place.
    """

    stage: Stage
    runs: tuple[int, ...]
    forces: tuple[Vector, ...]
    left: tuple[tuple[Vector, ...], ...]
    base: tuple[tuple[Vector, ...], ...]
    scales: tuple[float, ...]

    def run(self, i: int) -> PreparedRun:
        """One of them."""
        return self.stage.objective.problem.runs[self.runs[i]]

    @property
    def own(self) -> tuple[float, float]:
        """Frequency [Hz] and damping ratio of the joint's own mode."""
        theta, _ = self.stage.fit.coordinates.unpack(self.stage.fit.x)
        assembly = assemble(self.run(0), theta, self.stage.objective.problem)
        w = assembly.resonance
        return w / (2.0 * np.pi), assembly.base("damping") / (2.0 * assembly.base("load_inertia") * w)

    @property
    def longest(self) -> float:
        """Record of a hit [s]."""
        return max(float(o.times[-1] - o.times[0]) for o in accelerometers(self.run(0).outputs))

    @property
    def places(self) -> int:
        """Accelerometers on the arm."""
        return len(self.scales)

    def mode(self, frequency: float, damping: float) -> list[list[Vector]]:
        """What a mode of unit shares adds, per run and place."""
        found = []
        for i, force in enumerate(self.forces):
            run = self.run(i)
            moved = modal_acceleration(force, frequency, damping, run.grid_rate)
            outputs = accelerometers(run.outputs)
            found.append(
                [
                    _unit(o) / scale * recorded(moved, run.grid_rate, run.t0, o.times, o.rate) * o.mask
                    for o, scale in zip(outputs, self.scales, strict=True)
                ]
            )
        return found


def _unit(output: Output) -> float:
    return (output.radius or 1.0) if output.quantity == "linear-acceleration" else 1.0


def several_bends(stage: Stage, residuals: Residuals) -> tuple[EffectSpec, ...]:
    """The law of as many modes as the hits show clearly, starting where they are; none below ``FEWEST``.

    Args:
        stage: The base as refitted.
        residuals: What it leaves, per run and output of the problem.
    """
    hits = _hits(stage, residuals)
    if hits is None:
        return ()
    trail: list[tuple[float, float]] = []
    whole = _energy(hits.left)
    modes, left, idle = trail, whole, 0
    while len(trail) < bends.MOST_MODES and idle < PATIENCE:
        further = _next(hits, trail)
        trail = trail if further is None else _refined(hits, [*trail, further])
        if further is None or not _apart(hits, trail[:-1], trail[-1]):
            break
        energy = _energy(_solved(hits, trail)[0])
        idle = 0 if left - energy > max(TELLING * left, WORTH * whole) else idle + 1
        modes, left = (trail, energy) if idle == 0 else (modes, left)
    if len(modes) < FEWEST:
        return ()
    _, shares, shapes = _solved(hits, modes)
    order = np.argsort(-np.abs(shares).max(axis=1), kind="stable")
    values = [number for r in order for number in (*modes[r], *shares[r])]
    return (bends.started(len(modes), hits.places, (*values, *shapes[1:])),)


def _hits(stage: Stage, residuals: Residuals) -> _Hits | None:
    problem = stage.objective.problem
    counts = {len(accelerometers(run.outputs)) for run in problem.runs}
    if bends.possible(problem) is not None or len(counts) != 1 or not 1 <= max(counts) <= bends.MOST_SENSORS:
        return None
    theta, _ = stage.fit.coordinates.unpack(stage.fit.x)
    fitted = stage.objective.runs[:HITS]
    forces, left, base = [], [], []
    for i, predicted in zip(fitted, stage.predictions, strict=False):
        run = problem.runs[i]
        assembly = assemble(run, theta, problem)
        forces.append(load_input(assembly)[::2] / assembly.base("load_inertia"))
        rows = {o.channel: (r, y) for o, r, y in zip(run.outputs, residuals.rows[i], predicted, strict=True)}
        pairs = [(o, *rows[o.channel]) for o in accelerometers(run.outputs)]
        left.append([r * o.mask for o, r, _ in pairs])
        base.append([y * o.mask for o, _, y in pairs])
    both = zip(zip(*left, strict=True), zip(*base, strict=True), strict=True)
    scales = tuple(
        float(np.sqrt(sum(np.sum(np.square(r + y)) for r, y in zip(a, b, strict=True)))) or 1.0 for a, b in both
    )

    def scaled(rows: list[list[Vector]]) -> tuple[tuple[Vector, ...], ...]:
        return tuple(tuple(x / s for x, s in zip(row, scales, strict=True)) for row in rows)

    return _Hits(stage, tuple(fitted), tuple(forces), scaled(left), scaled(base), scales)


def _energy(rows: Sequence[Sequence[Vector]]) -> float:
    return float(sum(np.sum(np.square(x)) for row in rows for x in row))


def _solved(hits: _Hits, modes: Sequence[tuple[float, float]]) -> tuple[list[list[Vector]], Vector, list[float]]:
    """What the modes leave with shares and shapes at their best: remainder, shares, shape (modes, places), shapes."""
    columns = [hits.mode(f, zeta) for f, zeta in modes]
    shares, shapes = np.zeros((len(modes), hits.places)), []
    left: list[list[Vector]] = [[] for _ in hits.runs]
    for k in range(hits.places):
        parts = [np.concatenate([c[i][k] for i in range(len(hits.runs))]) for c in columns]
        if k > 0:
            parts.append(np.concatenate([row[k] for row in hits.base]))
        data = np.concatenate([row[k] for row in hits.left])
        if parts:
            matrix = np.stack(parts, axis=1)
            size = np.linalg.norm(matrix, axis=0) + 1e-300
            x = np.linalg.lstsq(matrix / size, data, rcond=1e-10)[0] / size
            shares[:, k] = x[: len(modes)]
            shapes.append(1.0 + (float(x[-1]) if k > 0 else 0.0))
            data = data - matrix @ x
        start = 0
        for i in range(len(hits.runs)):
            n = hits.left[i][k].size
            left[i].append(data[start : start + n])
            start += n
    return left, shares, shapes


def _next(hits: _Hits, modes: Sequence[tuple[float, float]]) -> tuple[float, float] | None:
    """Where the remainder follows the hammer most clearly, at the damping that explains most of it."""
    problem = hits.stage.objective.problem
    left = _solved(hits, modes)[0] if modes else hits.left
    rows: list[list[Vector]] = [[np.zeros(o.data.size) for o in run.outputs] for run in problem.runs]
    for i, run in enumerate(hits.runs):
        for o, x in zip(accelerometers(problem.runs[run].outputs), left[i], strict=True):
            rows[run][[p is o for p in problem.runs[run].outputs].index(True)] = np.asarray(x)
    rate = min(o.rate for o in accelerometers(hits.run(0).outputs))
    band, count, kept = (4.0 / hits.longest, REACH * rate), TRIED + len(modes), Residuals(rows)
    peaks = (
        *response_peaks(problem, kept, *band, count),
        *spectral_peaks(problem, kept, *band, count, narrow=False),
    )
    tried = [
        (f + part / hits.longest, zeta)
        for f in peaks
        if _apart(hits, modes, (f, 0.0))
        for part in (-0.25, 0.0, 0.25)
        for zeta in DAMPINGS
    ]
    return min(tried, key=lambda mode: _energy(_left_of(hits, left, mode)), default=None)


def _apart(hits: _Hits, modes: Sequence[tuple[float, float]], mode: tuple[float, float]) -> bool:
    """Whether a mode is another one than the joint's own and those found: what bends a peak is no second peak."""
    return all(abs(mode[0] - f) > max(WIDTHS * zeta * f, 2.0 / hits.longest) for f, zeta in (hits.own, *modes))


def _left_of(hits: _Hits, left: Sequence[Sequence[Vector]], mode: tuple[float, float]) -> list[list[Vector]]:
    """``left`` less what one more mode explains of it."""
    column = hits.mode(*mode)
    rows: list[list[Vector]] = [[] for _ in hits.runs]
    for k in range(hits.places):
        inner = sum(float(c[k] @ x[k]) for c, x in zip(column, left, strict=True))
        size = sum(float(c[k] @ c[k]) for c in column) + 1e-300
        for i in range(len(hits.runs)):
            rows[i].append(left[i][k] - inner / size * column[i][k])
    return rows


def _refined(hits: _Hits, modes: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Frequencies and dampings at their best, shares eliminated."""

    def residual(x: Vector) -> Vector:
        rows = _solved(hits, [(float(f), float(z)) for f, z in np.exp(x).reshape(-1, 2)])[0]
        return np.concatenate([part for row in rows for part in row])

    start = np.log(np.array(modes)).ravel()
    width = np.tile([2e-3, 0.3], len(modes))
    fit = least_squares(
        residual, start, x_scale=width, diff_step=1e-5, max_nfev=8,
        bounds=(start - 30.0 * width, start + 30.0 * width),
    )  # fmt: skip
    return [(float(f), float(z)) for f, z in np.exp(fit.x).reshape(-1, 2)]
