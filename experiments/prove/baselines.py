"""What simpler ways would have said, in the same table.

All of them see the same regression: angles and speeds by integrating the accelerometer (or from the encoders), the
equation of motion with everything linear in it, and a dictionary of residual torques. They differ in how they choose:

- lowest training error: the one term that leaves least; it always names something;
- AIC, BIC: forward selection while the criterion falls;
- sparse regression: by BIC, and only terms that take away a material share of the residual (the usual discovery of
  equations, with its usual weaknesses: it needs the states, and sees no clock);
- latent force: a free function of the motion at each place instead of the dictionary; it finds a place, never a name.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from jointscope.recordings.bandlimited import bandlimited
from jointscope.recordings.campaign import Campaign, Nameplate, Run

Real = NDArray[np.float64]
LOW: Final = 3.0  # Hz below which an integrated acceleration is noise
HIGH: Final = 150.0  # Hz above which a derivative is
INDEPENDENT: Final = 8.0  # neighbouring samples of band-limited data count as one
SPARSE: Final = "sparse regression on the residual"
WAYS: Final = (
    "lowest training error",
    "AIC only",
    "BIC only",
    SPARSE,
    "latent force only",
)
SHARE: Final = 0.05  # of the residual's energy that a term has to take away to be named


@dataclass(frozen=True)
class Terms:
    """One run's equation of motion: what is known, what is linear in the base, what may be missing; shapes (n,)."""

    known: Real
    base: Mapping[str, Real]
    candidates: Mapping[str, Real]
    latent: Mapping[str, Real]  # by location, columns of a free function there, shape (n, k)


def answers(campaign: Campaign) -> dict[str, dict[str, Any]]:
    """What every simpler way says of a campaign, with the keys of a diagnosis that scoring reads."""
    terms = [found for i, run in enumerate(campaign.runs) if (found := _terms(campaign.rig, run, i)) is not None]
    if not terms:
        return {way: _said(()) for way in WAYS}
    size = sum(t.known.size for t in terms) / INDEPENDENT
    return {
        "lowest training error": _said(forward_selection(terms, most=1, price=-np.inf, share=-np.inf)),
        "AIC only": _said(forward_selection(terms, most=3, price=2.0, share=0.0)),
        "BIC only": _said(forward_selection(terms, most=3, price=float(np.log(size)), share=0.0)),
        SPARSE: _said(forward_selection(terms)),
        "latent force only": _latent_answer(terms),
    }


def sparse_regression(campaign: Campaign) -> dict[str, Any]:
    """The answer of sparse regression alone."""
    return answers(campaign)[SPARSE]


def _said(names: Sequence[str]) -> dict[str, Any]:
    effects: list[dict[str, Any]] = [
        {"effect": name.split("@")[0], "location": name.split("@")[1], "probability": None, "parameters": {}}
        for name in names
    ]
    return {"verdict": "effects" if effects else "none", "effects": effects, "verdict_probability": None}


def _stacked(terms: Sequence[Terms]) -> tuple[Real, Real]:
    """The base's columns over all runs, shape (n, k), and what is known, shape (n,)."""
    bases = [name for name in {n: None for t in terms for n in t.base}]
    columns = [np.concatenate([t.base.get(name, np.zeros_like(t.known)) for t in terms]) for name in bases]
    return np.column_stack(columns), np.concatenate([t.known for t in terms])


def forward_selection(
    terms: Sequence[Terms], most: int = 2, price: float | None = None, share: float = SHARE
) -> list[str]:
    """Candidates in the order in which they lower the misfit, while each pays its price.

    Args:
        terms: Of every run.
        most: Of them.
        price: That a term has to gain in n ln(energy), n the number of independent samples; by default BIC's, ln n.
        share: Of the residual's energy that a term has to take away.
    """
    matrix, known = _stacked(terms)
    pool = {
        name: np.concatenate([t.candidates.get(name, np.zeros_like(t.known)) for t in terms])
        for name in {n: None for t in terms for n in t.candidates}
    }
    chosen: list[str] = []
    size = known.size / INDEPENDENT
    residual = _left(matrix, known)
    while len(chosen) < most:
        scores = {
            name: float(np.sum(_left(np.column_stack([matrix, y]), known) ** 2))
            for name, y in pool.items() if name not in chosen and np.any(y)
        }  # fmt: skip
        if not scores:
            break
        name = min(scores, key=lambda key: scores[key])
        energy = float(residual @ residual)
        gain = size * np.log(energy / max(scores[name], 1e-300))
        if gain < (np.log(size) if price is None else price) or scores[name] > (1.0 - share) * energy:
            break
        chosen.append(name)
        matrix = np.column_stack([matrix, pool[name]])
        residual = _left(matrix, known)
    return chosen


def _latent_answer(terms: Sequence[Terms]) -> dict[str, Any]:
    """Unknown, at the place whose free function leaves least, if that pays by BIC and is material; else none."""
    matrix, known = _stacked(terms)
    before = float(np.sum(_left(matrix, known) ** 2))
    left: dict[str, float] = {}
    freedom: dict[str, int] = {}
    for place in {n: None for t in terms for n in t.latent}:
        width = max(t.latent[place].shape[1] for t in terms if place in t.latent)
        free = np.concatenate([_widened(t.latent.get(place), t.known.size, width) for t in terms])
        left[place] = float(np.sum(_left(np.column_stack([matrix, free]), known) ** 2))
        freedom[place] = width
    if not left:
        return _said(())
    place = min(left, key=lambda key: left[key])
    size = known.size / INDEPENDENT
    gain = size * np.log(before / max(left[place], 1e-300))
    if gain < freedom[place] * np.log(size) or left[place] > (1.0 - SHARE) * before:
        return _said(())
    return {"verdict": "unknown", "effects": [], "where": {"location": place}, "verdict_probability": None}


def _widened(columns: Real | None, rows: int, width: int) -> Real:
    """Columns filled up with zeros to a common width."""
    out = np.zeros((rows, width))
    if columns is not None:
        out[:, : columns.shape[1]] = columns
    return out


def _free(motions: Sequence[Real], nodes: int = 7) -> Real:
    """Columns of a free function of each motion, shape (n, k): hats on nodes spread over its range."""
    columns = []
    for y in motions:
        at = np.linspace(float(np.min(y)), float(np.max(y)), nodes)
        width = max(at[1] - at[0], 1e-300)
        columns.append(np.maximum(1.0 - np.abs(y[:, None] - at) / width, 0.0))
    return np.column_stack(columns)


def _left(matrix: Real, y: Real) -> Real:
    scaled = matrix / np.maximum(np.linalg.norm(matrix, axis=0), 1e-300)
    return np.asarray(y - scaled @ np.linalg.lstsq(scaled, y, rcond=1e-10)[0])


def _terms(rig: Nameplate, run: Run, place: int) -> Terms | None:
    return _hit_terms(run, place) if run.experiment == "hammer" else _driven_terms(rig, run, place)


def _integrated(y: Real, rate: float, times: int, low: float = LOW) -> Real:
    """``y`` integrated over time ``times`` times, in the band from ``low`` [Hz] to ``HIGH``."""
    f = np.fft.rfftfreq(y.size, 1.0 / rate)
    keep = (f > low) & (f < min(HIGH, 0.4 * rate))
    spectrum = np.zeros(f.size, dtype=np.complex128)
    spectrum[keep] = np.fft.rfft(y - y[0])[keep] / (2j * np.pi * f[keep]) ** times
    return np.fft.irfft(spectrum, y.size)


def _banded(y: Real, rate: float, low: float = LOW) -> Real:
    return _integrated(y, rate, 0, low)


def _hit_terms(run: Run, place: int) -> Terms | None:
    force = run.select("force", role="input")
    response = run.select("linear-acceleration") or run.select("acceleration")
    if not force or not response:
        return None
    rate = response[0].sampling_rate
    a = response[0].samples / (response[0].channel.radius or 1.0)
    push = force[0].samples * (force[0].channel.radius or 1.0)
    n = min(a.size, push.size)
    a, push = a[:n], push[:n]
    qdd, qd, q = (_integrated(a, rate, k) for k in range(3))
    amplitude = float(np.max(np.abs(q)))
    candidates = {
        "coulomb-friction@load": np.tanh(qd / (0.02 * np.max(np.abs(qd)))),
        "quadratic-damping@load": qd * np.abs(qd),
        "stiffness-nonlinearity@transmission": q**3,
        "backlash@transmission": np.clip(q, -0.05 * amplitude, 0.05 * amplitude),
        "stiffness-drift@transmission": place * q,
        "delay@acquisition": np.gradient(push) * rate,
    }
    base = {"inertia": qdd, "damping": qd, "stiffness": q}
    free = {"load": _free([qd]), "transmission": _free([q])}
    return _weighed(
        _banded(push, rate),
        base,
        {name: _banded(y, rate) for name, y in candidates.items()},
        {place: np.column_stack([_banded(y, rate) for y in columns.T]) for place, columns in free.items()},
    )


def _driven_terms(rig: Nameplate, run: Run, place: int) -> Terms | None:
    torque, motor = run.select("torque", location="motor"), run.select("angle", location="motor")
    response = run.select("linear-acceleration")
    n, eta = rig.reduction_ratio, rig.efficiency or 1.0
    if not torque or not motor or not response or n is None:
        return None
    rate = motor[0].sampling_rate
    size = min(torque[0].samples.size, motor[0].samples.size)
    times = np.arange(size) / rate
    tau = eta * n * torque[0].samples[:size]
    angle = motor[0].samples[:size] / n
    wave = bandlimited(response[0].samples, response[0].sampling_rate, response[0].stream.start)
    arm = wave(times) / (response[0].channel.radius or 1.0)
    arm = arm - float(np.median(arm))
    smooth = _smoothed(angle, rate)
    speed = np.gradient(smooth) * rate
    motor_acceleration = np.gradient(speed) * rate
    J = ((rig.motor_inertia or 0.0) + (rig.reducer_inertia or 0.0)) * n**2
    q = angle + (run.arm_angle - angle[0])
    candidates = {
        "coulomb-friction@motor": np.sign(speed) * (np.abs(speed) > 0.005 * np.max(np.abs(speed))),
        "stribeck-friction@motor": np.sign(speed) * np.exp(-((speed / (0.05 * np.max(np.abs(speed)))) ** 2)),
        "load-dependent-friction@transmission": np.abs(tau - J * motor_acceleration) * np.sign(speed),
        "quadratic-damping@load": speed * np.abs(speed),
        "torque-gain@motor": tau,
        "drive-lag@motor": np.gradient(tau) * rate,
        "gravity@load": np.cos(q),
        "torque-ripple@motor": np.sin(n * angle),
        "payload@load": (place % 2) * arm,
        "stiffness-drift@transmission": times * arm,
    }
    base = {
        "load": arm,
        "motor": motor_acceleration,
        "viscous": speed,
        "offset": np.ones(size),
        "weight": np.cos(q),
    }
    if rig.arm_mass is not None and rig.plane == "vertical":
        base.pop("weight")
        tau = tau - rig.arm_mass * 9.80665 * (rig.arm_com_radius or 0.0) * np.cos(q)
    else:
        base.pop("weight")
    latent = {
        "motor": _free([speed, tau]),
        "load": _free([_integrated(arm, rate, 1), q]),
        "transmission": _free([arm, np.gradient(arm) * rate]),
    }
    return _weighed(tau, base, candidates, latent)


def _smoothed(y: Real, rate: float) -> Real:
    width = max(3, round(0.01 * rate)) | 1
    window = np.hanning(width + 2)[1:-1]
    padded = np.concatenate([np.full(width, y[0]), y, np.full(width, y[-1])])
    return np.convolve(padded, window / window.sum(), mode="same")[width:-width]


def _weighed(
    known: Real, base: Mapping[str, Real], candidates: Mapping[str, Real], latent: Mapping[str, Real]
) -> Terms:
    """Every run weighs the same."""
    size = max(float(np.sqrt(np.mean(known**2))), 1e-300)
    parts = [{k: v / size for k, v in part.items()} for part in (base, candidates, latent)]
    return Terms(known / size, *parts)


def chance(labels: int) -> float:
    """Share of single effects named by guessing among ``labels`` names and places."""
    return 1.0 / labels
