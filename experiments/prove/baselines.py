"""What simpler ways would have said, in the same table: chance, the commonest answer, sparse regression on the residual.

Sparse regression: angles and speeds by integrating the accelerometer (or from the encoders), the equation of motion
with everything linear in it, and a dictionary of residual torques from which forward selection by BIC takes one after
the other (the usual discovery of equations, with its usual weaknesses: it needs the states, and sees no clock).
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
SHARE: Final = 0.05  # of the residual's energy that a term has to take away to be named


@dataclass(frozen=True)
class Terms:
    """One run's equation of motion: what is known, what is linear in the base, what may be missing; shapes (n,)."""

    known: Real
    base: Mapping[str, Real]
    candidates: Mapping[str, Real]


def sparse_regression(campaign: Campaign) -> dict[str, Any]:
    """The answer of sparse regression, with the keys of a diagnosis that scoring reads."""
    terms = [found for i, run in enumerate(campaign.runs) if (found := _terms(campaign.rig, run, i)) is not None]
    if not terms:
        return {"verdict": "none", "effects": [], "verdict_probability": None}
    names = forward_selection(terms)
    effects: list[dict[str, Any]] = [
        {"effect": name.split("@")[0], "location": name.split("@")[1], "probability": None, "parameters": {}}
        for name in names
    ]
    return {"verdict": "effects" if effects else "none", "effects": effects, "verdict_probability": None}


def forward_selection(terms: Sequence[Terms], most: int = 2) -> list[str]:
    """Candidates in the order in which they lower BIC, while each takes away a share of the residual's energy."""
    names = [name for name in {n: None for t in terms for n in t.candidates}]
    bases = [name for name in {n: None for t in terms for n in t.base}]
    known = np.concatenate([t.known for t in terms])

    def column(name: str, kind: str) -> Real:
        return np.concatenate([getattr(t, kind).get(name, np.zeros_like(t.known)) for t in terms])

    matrix = np.column_stack([column(name, "base") for name in bases])
    pool = {name: column(name, "candidates") for name in names}
    chosen: list[str] = []
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
        # neighbouring samples of band-limited data are not independent: an eighth of them counts
        gain = known.size / 8.0 * np.log(energy / max(scores[name], 1e-300))
        if gain < np.log(known.size) or scores[name] > (1.0 - SHARE) * energy:
            break
        chosen.append(name)
        matrix = np.column_stack([matrix, pool[name]])
        residual = _left(matrix, known)
    return chosen


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
    return _weighed(_banded(push, rate), base, {name: _banded(y, rate) for name, y in candidates.items()})


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
    return _weighed(tau, base, candidates)


def _smoothed(y: Real, rate: float) -> Real:
    width = max(3, round(0.01 * rate)) | 1
    window = np.hanning(width + 2)[1:-1]
    padded = np.concatenate([np.full(width, y[0]), y, np.full(width, y[-1])])
    return np.convolve(padded, window / window.sum(), mode="same")[width:-width]


def _weighed(known: Real, base: Mapping[str, Real], candidates: Mapping[str, Real]) -> Terms:
    """Every run weighs the same."""
    size = max(float(np.sqrt(np.mean(known**2))), 1e-300)
    return Terms(
        known / size, {k: v / size for k, v in base.items()}, {k: v / size for k, v in candidates.items()}
    )


def chance(labels: int) -> float:
    """Share of single effects named by guessing among ``labels`` names and places."""
    return 1.0 / labels
