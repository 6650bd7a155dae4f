r"""Maximum likelihood with noise in both channels, hit by hit, the force known to be zero outside its contact.

For hit h the spectra obey

    Y_h = S (1 + g_h) e^{-s t_h} G(theta) (U_h + B_h z_h) + T_h + E_h,      z_h ~ N(0, I)

U_h is the measured force spectrum over the contact window only, B_h the spectra of one standard deviation of noise on
each sample of that window (so that the force's noise is known to be smooth in frequency), g_h and t_h the hit's gain
and timing scatter, T_h the transient of a record that is cut off before the decay has ended, S what the sensor does to
the acceleration. Every nuisance but theta is linear with a Gaussian prior, so it is profiled out in closed form: with
M_h the matrix of all nuisance columns scaled by their prior standard deviations, r = Y - S G U and noise variance 1,

    cost = sum_h r' (I + M M')^{-1} r,      d cost/d theta = -2 sum_h (S dG (U + B z))' (I + M M')^{-1} r

where z is the nuisance's conditional mean. The second line holds exactly (envelope theorem) and is what removes the
bias that least squares on H1 has. The windowed force keeps the bound low; see
``docs/decisions/2026-11-21-direct-parametric-weighting.md``. After Pintelon and Schoukens, System Identification,
2nd ed., chapter 9 (errors in variables with known noise covariance), here with the noise's structure added.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import RefusedError
from jointscope.identification.modal_model import ModalModel

Real = NDArray[np.float64]
Complex = NDArray[np.complexfloating[Any, Any]]

_SHORT = 64  # samples of contact up to which compacting is cheaper than carrying them along
_FLAT = 1e3  # prior standard deviation of a transient, in units of its own size at which it equals the noise


@dataclass(frozen=True, kw_only=True, eq=False)
class HitSpectrum:
    """One hit in the frequency domain, all on the clock of its output's first sample.

    Attributes:
        run: The run's id.
        frequency: [Hz], shape (n,).
        output: Spectra of the outputs as measured, SI times s, shape (n_outputs, n).
        input: Spectrum of the torque (or force) inside its contact window, shape (n,).
        input_basis: Spectra of one standard deviation of noise on each sample in the window, shape (n, m).
        sensor: S, from angular acceleration to each measured output, shape (n_outputs, n).
        duration: Length of the output record [s].
        level: Peak of the input [N m].
        impulse: Integral of the input [N m s].
        input_noise: Standard deviation of the input's samples [N m].
        clock: Standard deviation of the input's clock against the output's [s]; 0 on one device.
        truncated: Whether the record ends before the decay does.
        rate: Sampling rate of the outputs [Hz]; 0 for a measured FRF.
    """

    run: str
    frequency: Real
    output: Complex
    input: Complex
    input_basis: Complex
    sensor: Complex
    duration: float
    level: float
    impulse: float
    input_noise: float
    clock: float = 0.0
    truncated: bool = False
    rate: float = 0.0

    def in_band(self, band: tuple[float, float]) -> HitSpectrum:
        """The lines inside ``band`` [Hz]; a short contact's noise in as few columns as they can tell apart."""
        keep = (self.frequency >= band[0] - 1e-9) & (self.frequency <= band[1] + 1e-9)
        part = replace(
            self,
            frequency=self.frequency[keep],
            output=self.output[:, keep],
            input=self.input[keep],
            input_basis=self.input_basis[keep],
            sensor=self.sensor[:, keep],
        )
        return compact(part) if self.input_basis.shape[1] <= _SHORT else part


def compact(hit: HitSpectrum) -> HitSpectrum:
    """The same force noise in as few columns as the band can tell apart."""
    basis = hit.input_basis
    if basis.size == 0 or not np.any(basis):
        return replace(hit, input_basis=basis[:, :0])
    left, size, _ = np.linalg.svd(np.concatenate([basis.real, basis.imag]), full_matrices=False)
    kept = size > 1e-3 * size[0]
    columns = left[:, kept] * size[kept]
    return replace(hit, input_basis=np.asarray(columns[: basis.shape[0]] + 1j * columns[basis.shape[0] :]))


@dataclass(frozen=True, kw_only=True)
class Scatter:
    """Hit-to-hit scatter: standard deviations of gain [-] and timing [s]."""

    gain: float = 0.0
    timing: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Whitened:
    """One hit's residual and sensitivities in units of its noise, complex lines stacked as real then imaginary.

    Attributes:
        residual: r, shape (N,).
        nuisance: M, shape (N, k): force noise (m), gain, timing, transients.
        sensitivity: dY/d theta, shape (N, p).
        gain: dY/dg, shape (N,).
        timing: dY/dt, shape (N,).
    """

    residual: Real
    nuisance: Real
    sensitivity: Real
    gain: Real
    timing: Real

    def solver(self, without_scatter: bool = False) -> InverseCovariance:
        """(I + M M')^{-1}, with or without the gain and timing columns."""
        columns = self.nuisance
        if without_scatter:
            columns = np.delete(columns, self.scatter_columns, axis=1)
        return InverseCovariance(columns)

    @property
    def scatter_columns(self) -> tuple[int, int]:
        """Where gain and timing stand in ``nuisance``."""
        return 0, 1


class InverseCovariance:
    """(I + M M')^{-1} by Woodbury's identity, M of shape (N, k) with k << N."""

    def __init__(self, columns: Real) -> None:
        self.columns = columns
        self.inner = np.linalg.inv(np.eye(columns.shape[1]) + columns.T @ columns)

    def __call__(self, right: Real) -> Real:
        """Apply to ``right``, shape (N,) or (N, p)."""
        return right - self.columns @ (self.inner @ (self.columns.T @ right))

    def nuisance(self, residual: Real) -> Real:
        """Conditional mean of the nuisances, in units of their priors, shape (k,)."""
        return self.inner @ (self.columns.T @ residual)

    @property
    def freedom_used(self) -> float:
        """How many degrees of freedom the nuisances take from the residual."""
        return float(self.columns.shape[1] - np.trace(self.inner))


def _stack(lines: Complex, noise: Real) -> Real:
    """(n_outputs, n, ...) complex over noise (n_outputs, n) -> (2 n_outputs n, ...) real."""
    scaled = lines / noise.reshape(noise.shape + (1,) * (lines.ndim - 2))
    flat = scaled.reshape((noise.size, *lines.shape[2:]))
    return np.concatenate([flat.real, flat.imag])


def _transients(model: ModalModel, hit: HitSpectrum, noise: Real) -> tuple[Complex, Complex]:
    """Transient columns and their derivatives by a1 and a2, shapes (n_outputs, n, k) and (2, n_outputs, n, k).

    What a decay cut off (or already under way) leaves in the spectrum of one output's samples is exactly
    (t0 + t1/z)/(1 - 2 Re(p)/z + |p|^2/z^2) per mode, p = e^{pole/rate}; of a measured FRF (no rate) the same in s.
    Columns are scaled so that the prior is flat against the noise.
    """
    s = 2j * np.pi * hit.frequency
    outputs, modes = model.outputs, model.modes
    columns = np.zeros((outputs, s.size, 2 * outputs * modes), dtype=np.complex128)
    slopes = np.zeros((2, *columns.shape), dtype=np.complex128)
    delay, inverse, by_a1, by_a2 = _decay(model, s, hit.rate)
    for o in range(outputs):
        for m in range(modes):
            for power in (0, 1):
                k = 2 * (o * modes + m) + power
                column = delay**power * inverse[m]
                scale = _FLAT / np.linalg.norm(column / noise[o])
                columns[o, :, k] = column * scale
                slopes[0, o, :, k] = delay**power * by_a1[m] * scale
                slopes[1, o, :, k] = delay**power * by_a2[m] * scale
    return columns, slopes


def _decay(model: ModalModel, s: Complex, rate: float) -> tuple[Complex, Complex, Complex, Complex]:
    """One step of delay, shape (n,); every mode's own decay and its derivatives by a1 and a2, shape (n_modes, n)."""
    if rate <= 0.0:
        inverse = 1.0 / model.denominators(s)
        return s, inverse, -s * inverse**2, -(inverse**2)
    delay = np.exp(-s / rate)
    a1 = model.a1[:, None]
    ring = np.sqrt(np.maximum(model.a2[:, None] - a1**2 / 4.0, 1e-6 * model.a2[:, None]))
    p = np.exp((-a1 / 2.0 + 1j * ring) / rate)
    shrunk = np.exp(-a1 / rate)
    inverse = 1.0 / (1.0 - 2.0 * p.real * delay + shrunk * delay**2)
    turn_a1 = 2.0 * (p / rate * (-0.5 - 0.25j * a1 / ring)).real
    turn_a2 = 2.0 * (p / rate * (0.5j / ring)).real
    return (
        delay,
        inverse,
        inverse**2 * (turn_a1 * delay + shrunk / rate * delay**2),
        inverse**2 * (turn_a2 * delay),
    )


def whiten(model: ModalModel, hit: HitSpectrum, noise: Real, scatter: Scatter) -> Whitened:
    """Residual, nuisances and sensitivities of one hit at ``model``.

    ``noise``: standard deviation of the real (and of the imaginary) part of each spectral line, shape (n_outputs, n).
    """
    s = 2j * np.pi * hit.frequency
    transfer = hit.sensor * model.response(s)
    predicted = transfer * hit.input
    late = -s * predicted
    timing = float(np.hypot(scatter.timing, hit.clock))
    parts = [
        _stack((scatter.gain * predicted)[..., None], noise),
        _stack((timing * late)[..., None], noise),
        _stack(transfer[..., None] * hit.input_basis[None], noise),
    ]
    slopes = None
    if hit.truncated:
        columns, slopes = _transients(model, hit, noise)
        parts.append(_stack(columns, noise))
    nuisance = np.concatenate(parts, axis=1)
    residual = _stack(hit.output - predicted, noise)
    z = InverseCovariance(nuisance).nuisance(residual)
    m = hit.input_basis.shape[1]
    believed = (
        (hit.input + hit.input_basis @ z[2 : 2 + m]) * (1.0 + scatter.gain * z[0]) * np.exp(-s * timing * z[1])
    )
    sensitivity = model.jacobian(s) * (hit.sensor * believed)[..., None]
    if slopes is not None:
        n = model.modes
        effect = np.einsum("aofk,k->aofk", slopes, z[2 + m :])
        for mode in range(n):
            own = [2 * (o * n + mode) + power for o in range(model.outputs) for power in (0, 1)]
            sensitivity[:, :, mode] += effect[0][:, :, own].sum(axis=2)
            sensitivity[:, :, n + mode] += effect[1][:, :, own].sum(axis=2)
    return Whitened(
        residual=residual,
        nuisance=nuisance,
        sensitivity=_stack(sensitivity, noise),
        gain=_stack(predicted, noise),
        timing=_stack(late, noise),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class Optimum:
    """Where the cost is least.

    Attributes:
        cost: Sum of squared whitened residuals.
        information: Gauss-Newton Fisher matrix of theta, shape (p, p).
        evaluations: Cost evaluations spent.
    """

    model: ModalModel
    cost: float
    information: Real
    evaluations: int


def _cost(
    model: ModalModel, hits: Sequence[HitSpectrum], noise: Sequence[Real], scatter: Scatter
) -> tuple[float, Real, Real]:
    p = model.vector().size
    cost, gradient, information = 0.0, np.zeros(p), np.zeros((p, p))
    for hit, sigma in zip(hits, noise, strict=True):
        white = whiten(model, hit, sigma, scatter)
        solve = white.solver()
        weighted = solve(np.column_stack([white.residual, white.sensitivity]))
        cost += float(white.residual @ weighted[:, 0])
        gradient += white.sensitivity.T @ weighted[:, 0]
        information += white.sensitivity.T @ weighted[:, 1:]
    return cost, gradient, information


def minimise(
    model: ModalModel,
    hits: Sequence[HitSpectrum],
    noise: Sequence[Real],
    scatter: Scatter,
    *,
    tolerance: float = 1e-4,
    limit: int = 80,
) -> Optimum:
    """Levenberg-Marquardt on the profiled likelihood from ``model``.

    Ends when no step is expected to lower the cost by more than ``tolerance`` (the cost is in squared standard
    deviations: a gain of 1e-4 moves no parameter by more than a hundredth of its own), or when three steps in a row
    together gained less than ten times that.

    Raises:
        RefusedError: No convergence within ``limit`` evaluations.
    """
    cost, gradient, information = _cost(model, hits, noise, scatter)
    damping, evaluations, gains = 0.0, 1, [np.inf] * 3
    while evaluations < limit:
        scale = np.sqrt(np.maximum(np.diag(information), 1e-300))
        curved = information / np.outer(scale, scale) + damping * np.eye(scale.size)
        step = np.linalg.lstsq(curved, gradient / scale, rcond=1e-14)[0] / scale
        expected = float(step @ gradient)
        if expected < tolerance or sum(gains[-3:]) < 10.0 * tolerance:
            return Optimum(model=model, cost=cost, information=information, evaluations=evaluations)
        trial = model.with_vector(model.vector() + step)
        evaluations += 1
        if trial.admissible():
            new = _cost(trial, hits, noise, scatter)
            if new[0] <= cost + 1e-10 * abs(cost):
                gains.append(cost - new[0])
                model, (cost, gradient, information) = trial, new
                damping = damping / 3.0 if damping > 1e-6 else 0.0
                continue
        damping = max(4.0 * damping, 1e-3)
        if damping > 1e8:
            return Optimum(model=model, cost=cost, information=information, evaluations=evaluations)
    raise RefusedError(
        f"the fit did not converge in {limit} evaluations; narrow the band or lower the number of modes"
    )


def residual_noise(
    model: ModalModel, hits: Sequence[HitSpectrum], noise: Sequence[Real], scatter: Scatter
) -> list[tuple[Complex, float]]:
    """Per hit: what no nuisance explains, as measured lines, shape (n_outputs, n), and its degrees of freedom."""
    result: list[tuple[Complex, float]] = []
    taken = model.vector().size / len(hits)
    for hit, sigma in zip(hits, noise, strict=True):
        white = whiten(model, hit, sigma, scatter)
        solve = white.solver()
        left = solve(white.residual)
        half = left.size // 2
        lines: Complex = np.asarray((left[:half] + 1j * left[half:]).reshape(sigma.shape) * sigma, dtype=complex)
        result.append((lines, left.size - solve.freedom_used - taken))
    return result
