r"""The stiffness and damping of single joints from hits on a braked arm, not only equivalent ones.

With every rotor braked, small motion about rest obeys M(q) x'' + C x' + (K_J + K_g(q)) x = J_hit^T F, C = diag(c),
K_J = diag(K). Geometry and inertias come from the arm's own model by Pinocchio, so M, K_g and the rows of hit points and
accelerometers are known in every posture; what is left are K and c of each joint, common to all hits:

    G(s) = (s^2 J_acc + tilt) Z(s)^{-1} J_hit^T,   Z = s^2 M + s C + K_J + K_g
    dG/dK_k = -x_acc,k x_hit,k,   dG/dc_k = -s x_acc,k x_hit,k,   x = Z^{-1}(row)

The likelihood is that of the single joint (``errors_in_variables``: noise in both channels, hit-to-hit scatter). Joints
that the hits hardly move keep their nameplate values within a stated width, and are reported as not identifiable.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, stats

from jointscope.errors import RefusedError
from jointscope.identification.arm_spots import Spot
from jointscope.identification.direct_parametric import noise_levels, noise_shape
from jointscope.identification.errors_in_variables import HitSpectrum, Scatter, whiten
from jointscope.identification.hit_scatter import deviations, estimate_scatter
from jointscope.identification.modal_model import ModalModel

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

_ROUNDS = 5
_KNOWN = 0.5  # a posterior wider than this share of the prior says that the hits taught nothing


@dataclass(frozen=True, kw_only=True)
class JointEstimate:
    """One figure of one joint.

    Attributes:
        joint: Its name.
        value: In ``unit``.
        unit: N m/rad or N m s/rad.
        low, high: 95 % interval: the wider of the noise model's and the one from the spread between hits.
        identifiable: Whether the hits narrowed it to less than half of what was believed before.
    """

    joint: str
    value: float
    unit: str
    low: float
    high: float
    identifiable: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class JointFit:
    """Every joint's reducer.

    Attributes:
        stiffness: K, one per joint of the arm.
        damping: c, likewise.
        inertia_factor: By which the model's inertias are scaled (1, fixed, unless it was let free), with its interval.
        covariance: Of the logarithms of K, c and the inertia factor, shape (2n + 1, 2n + 1).
        hits: How many.
        misfit: Root mean square of the whitened residual [-]; 1 where the model explains all but noise.
    """

    stiffness: tuple[JointEstimate, ...]
    damping: tuple[JointEstimate, ...]
    inertia_factor: tuple[float, float, float]
    covariance: Real
    hits: int
    misfit: float


@dataclass(frozen=True, eq=False)
class BrakedArm:
    """G of one spot as a function of log K, log c and the log of the inertia factor; the interface of ``ModalModel``."""

    spot: Spot
    logs: Real

    @property
    def outputs(self) -> int:
        """Number of accelerometers."""
        return int(self.spot.motion.shape[0])

    def vector(self) -> Real:
        """log K, log c, log of the inertia factor, shape (2n + 1,)."""
        return self.logs

    def with_vector(self, values: Real) -> BrakedArm:
        """The same spot with other figures."""
        return replace(self, logs=values)

    def admissible(self) -> bool:
        """Whether the figures are finite and of a size that can be."""
        return bool(np.all(np.isfinite(self.logs)) and np.all(np.abs(self.logs) < 40.0))

    def response(self, s: Complex) -> Complex:
        """What the accelerometers read per newton, shape (n_outputs, n_s)."""
        x_hit, _ = self._solve(s)
        return self._read(s, x_hit)

    def jacobian(self, s: Complex) -> Complex:
        """dG/d(vector), shape (n_outputs, n_s, 2n + 1)."""
        spot, n = self.spot, self.spot.mass.shape[0]
        x_hit, Z = self._solve(s)
        rows = s[:, None, None] ** 2 * spot.motion + spot.tilt  # (n_s, n_outputs, n)
        x_acc = np.swapaxes(np.linalg.solve(Z, np.swapaxes(rows, 1, 2)), 1, 2)  # Z is symmetric
        K, c, factor = self._values()
        slope = -x_acc * x_hit[:, None, :]
        inertial = factor * (s[:, None, None] ** 2 * spot.mass + spot.gravity_stiffness)
        whole = -np.einsum("soi,sij,sj->so", x_acc, inertial, x_hit)
        result = np.concatenate([slope * K, slope * c * s[:, None, None], whole[:, :, None]], axis=2)
        assert result.shape[2] == 2 * n + 1
        return np.asarray(np.swapaxes(result, 0, 1))

    def _values(self) -> tuple[Real, Real, float]:
        n = self.spot.mass.shape[0]
        values = np.exp(self.logs)
        return values[:n], values[n : 2 * n], float(values[-1])

    def _solve(self, s: Complex) -> tuple[Complex, Complex]:
        K, c, factor = self._values()
        spot = self.spot
        Z = (
            factor * (s[:, None, None] ** 2 * spot.mass + spot.gravity_stiffness)
            + s[:, None, None] * np.diag(c)
            + np.diag(K)
        )
        right = np.broadcast_to(spot.force, (s.size, spot.force.size))[..., None]
        return np.asarray(np.linalg.solve(Z, right)[..., 0], dtype=np.complex128), Z

    def _read(self, s: Complex, x: Complex) -> Complex:
        return np.asarray(s**2 * (self.spot.motion @ x.T) + self.spot.tilt @ x.T)


@dataclass(frozen=True, kw_only=True)
class Belief:
    """What is believed of each joint before the hits: standard deviations of logarithms.

    Attributes:
        stiffness: Of joints other than those under test.
        damping: Likewise.
        sought: Of K and c of the joints under test; wide.
        inertia: Of one factor on all inertias; 0 takes the model's inertias as exact.
    """

    stiffness: float = 0.3
    damping: float = 1.0
    sought: float = 3.0
    inertia: float = 0.0


STATED = Belief()
"""What is believed where nobody says otherwise."""


def identify_joints(
    spots: Sequence[Spot],
    joints: Sequence[str],
    stiffness: Real,
    damping: Real,
    sought: Sequence[str],
    *,
    belief: Belief = STATED,
    band: tuple[float, float] = (4.0, 50.0),
) -> JointFit:
    """Fit K and c of every joint to all hits of all spots at once.

    Args:
        spots: Hits by point and posture (``arm_spots.read_spots``).
        joints: Names, in the order of the arm's model.
        stiffness: Nameplate K [N m/rad], shape (n,); where the search starts.
        damping: Nameplate c [N m s/rad], shape (n,).
        sought: The joints that are to be identified.
        belief: Widths of what was believed.
        band: Lines to fit [Hz].

    Raises:
        RefusedError: There are no hits, or the search doesn't come to an end.
    """
    if not spots:
        raise RefusedError("no usable hit on the arm: nothing to identify joints from")
    spots = [replace(spot, hits=tuple(hit.in_band(band) for hit in spot.hits)) for spot in spots]
    prior_mean = np.concatenate([np.log(stiffness), np.log(damping), [0.0]])
    known = [name not in sought for name in joints]
    prior_sd = np.concatenate(
        [
            np.where(known, belief.stiffness, belief.sought),
            np.where(known, belief.damping, belief.sought),
            [max(belief.inertia, 1e-9)],
        ]
    )
    logs = _rough_start(spots, prior_mean, np.minimum(prior_sd, 0.5))
    problem = _Problem(spots, prior_mean, prior_sd)
    logs, noise, scatter = problem.settle(logs)
    return problem.report(logs, noise, scatter, joints)


@dataclass(frozen=True, eq=False)
class _Problem:
    spots: Sequence[Spot]
    mean: Real
    sd: Real

    def settle(self, logs: Real) -> tuple[Real, list[list[Real]], list[Scatter]]:
        """Fit, noise and scatter in turns."""
        noise = [
            [np.full(hit.output.shape, _rough_noise(BrakedArm(spot, logs), hit)) for hit in spot.hits]
            for spot in self.spots
        ]
        scatter = [Scatter() for _ in self.spots]
        for turn in range(_ROUNDS):
            logs, _ = self.minimise(logs, noise, scatter, limit=40)
            for index, spot in enumerate(self.spots):
                model = cast(ModalModel, BrakedArm(spot, logs))  # the likelihood asks for nothing that it lacks
                shape = noise_shape(model, spot.hits, noise[index], scatter[index]) if turn else None
                noise[index] = noise_levels(model, spot.hits, noise[index], scatter[index], shape)
                scatter[index] = estimate_scatter(deviations(model, spot.hits, noise[index]))
        logs, settled = self.minimise(logs, noise, scatter, limit=400)
        if not settled:
            raise RefusedError(
                "the joints' stiffnesses did not settle; narrow the band or give better nameplate values"
            )
        return logs, noise, scatter

    def minimise(
        self, logs: Real, noise: list[list[Real]], scatter: list[Scatter], limit: int
    ) -> tuple[Real, bool]:
        """Damped Gauss-Newton on the posterior; and whether it came to rest within ``limit`` evaluations."""
        cost, gradient, information, _ = self.evaluate(logs, noise, scatter)
        damping = 1e-3
        for _ in range(limit):
            scale = np.sqrt(np.diag(information))
            curved = information / np.outer(scale, scale) + damping * np.eye(scale.size)
            step = np.linalg.solve(curved, gradient / scale) / scale
            if step @ gradient < max(1e-4, 1e-9 * cost):
                return logs, True
            step *= min(1.0, 0.5 / np.max(np.abs(step)))
            trial = self.evaluate(logs + step, noise, scatter)
            if trial[0] < cost:
                logs, (cost, gradient, information, _) = logs + step, trial
                damping = max(damping / 5.0, 1e-9)
            else:
                damping *= 8.0
                if damping > 1e8:
                    return logs, True
        return logs, False

    def evaluate(
        self, logs: Real, noise: list[list[Real]], scatter: list[Scatter]
    ) -> tuple[float, Real, Real, list[Real]]:
        """Cost, half its negative gradient, information, and every hit's own score."""
        weight = self.sd**-2.0
        away = self.mean - logs
        cost, gradient, information = float(away @ (weight * away)), weight * away, np.diag(weight)
        scores = []
        for spot, levels, own in zip(self.spots, noise, scatter, strict=True):
            model = cast(ModalModel, BrakedArm(spot, logs))
            for hit, sigma in zip(spot.hits, levels, strict=True):
                white = whiten(model, hit, sigma, own)
                weighted = white.solver()(np.column_stack([white.residual, white.sensitivity]))
                cost += float(white.residual @ weighted[:, 0])
                scores.append(white.sensitivity.T @ weighted[:, 0])
                gradient = gradient + scores[-1]
                information = information + white.sensitivity.T @ weighted[:, 1:]
        return cost, gradient, information, scores

    def report(
        self, logs: Real, noise: list[list[Real]], scatter: list[Scatter], joints: Sequence[str]
    ) -> JointFit:
        cost, _, information, scores = self.evaluate(logs, noise, scatter)
        covariance = np.linalg.inv(information)
        moved = np.array(scores) @ covariance
        count = moved.shape[0]
        freedom = max(1, count - len(self.spots))
        centred = moved - moved.mean(axis=0)
        repeats = centred.T @ centred * count / freedom if count > len(self.spots) else np.zeros_like(covariance)
        normal, student = float(stats.norm.ppf(0.975)), float(stats.t.ppf(0.975, freedom))
        half = np.maximum(normal * np.sqrt(np.diag(covariance)), student * np.sqrt(np.diag(repeats)))
        learnt = np.sqrt(np.diag(covariance)) < _KNOWN * self.sd
        lines = sum(2 * hit.output.size for spot in self.spots for hit in spot.hits)
        n = len(joints)

        def one(k: int, unit: str) -> JointEstimate:
            value, spread = math.exp(logs[k]), math.exp(half[k])
            return JointEstimate(
                joint=joints[k % n], value=value, unit=unit, low=value / spread, high=value * spread,
                identifiable=bool(learnt[k]),
            )  # fmt: skip

        factor = math.exp(logs[-1])
        return JointFit(
            stiffness=tuple(one(k, "N m/rad") for k in range(n)),
            damping=tuple(one(n + k, "N m s/rad") for k in range(n)),
            inertia_factor=(factor, factor / math.exp(half[-1]), factor * math.exp(half[-1])),
            covariance=np.asarray(covariance, dtype=np.float64),
            hits=count,
            misfit=math.sqrt(cost / lines),
        )


def _rough_start(spots: Sequence[Spot], mean: Real, sd: Real, tries: int = 400) -> Real:
    """Where to begin: the best of many draws, then least squares, on log|G| of the averaged responses.

    Logarithms of magnitudes forgive a resonance that is off by several of its widths, which complex lines don't.
    """
    rng = np.random.default_rng(0)  # of the search only; the optimum that follows doesn't depend on it
    lines = []
    for spot in spots:
        hits = spot.hits
        every = slice(None, None, max(1, hits[0].frequency.size // 120))
        drive = np.sum([np.abs(h.input) ** 2 for h in hits], axis=0)
        G = np.sum([h.output * np.conj(h.input) for h in hits], axis=0) / drive
        level = np.log(np.abs(G / hits[0].sensor)[:, every])
        lines.append((_s(hits[0].frequency[every]), level))

    def misfit(logs: Real) -> Real:
        parts = [
            (np.log(np.abs(BrakedArm(spot, logs).response(s))) - level).ravel()
            for spot, (s, level) in zip(spots, lines, strict=True)
        ]
        return np.concatenate([*parts, 3.0 * (logs - mean) / sd])

    def loss(logs: Real) -> float:
        return float(np.sum(np.log1p(misfit(logs) ** 2)))

    draws = mean + sd * rng.normal(size=(tries, mean.size)) * np.linspace(0.0, 1.0, tries)[:, None]
    best = sorted(draws, key=loss)[:4]
    fits = [optimize.least_squares(misfit, start, loss="soft_l1", max_nfev=60) for start in best]
    return np.asarray(min(fits, key=lambda fit: fit.cost).x)


def _s(frequency: Real) -> Complex:
    """s = j omega [rad/s] for frequencies [Hz]."""
    return np.asarray(2j * np.pi * frequency, dtype=np.complex128)


def _rough_noise(model: BrakedArm, hit: HitSpectrum) -> float:
    error = hit.output - hit.sensor * model.response(_s(hit.frequency)) * hit.input
    return float(np.sqrt(np.mean(np.abs(error) ** 2) / 2.0)) + 1e-12
