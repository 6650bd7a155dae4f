"""The baseline that others would use finds what it can find, and nothing in a linear record."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jointscope.experiments.prove.baselines import sparse_regression
from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream

RATE = 1024.0


def hits(extra, noise: float = 0.0, seed: int = 0) -> Campaign:
    rng = np.random.default_rng(seed)
    runs = []
    for i, peak in enumerate((50.0, 120.0, 300.0)):
        t = np.arange(1024) / RATE

        def push(s, peak=peak):
            return peak * np.sin(np.pi * np.clip((s - 0.05) / 0.008, 0.0, 1.0))

        def slope(s, x, push=push):
            return [x[1], (0.8 * push(s) - 60.0 * x[1] - 1.9e5 * x[0] - extra(x[0], x[1])) / 3.0]

        x = solve_ivp(slope, (0.0, t[-1]), [0.0, 0.0], t_eval=t, max_step=2e-4, rtol=1e-8, atol=1e-10).y
        a = 0.95 * np.array([slope(s, y)[1] for s, y in zip(t, x.T, strict=True)])
        channels = (
            Channel(column="f", quantity="force", unit="N", location="arm", role="input", radius=0.8,
                    samples=push(t)),
            Channel(column="a", quantity="linear-acceleration", unit="m/s^2", location="arm", role="output", radius=0.95,
                    samples=a + noise * rng.standard_normal(t.size)),
        )  # fmt: skip
        stream = Stream(file=f"{i}.npz", sampling_rate=RATE, length=t.size, channels=channels)
        runs.append(Run(id=str(i), experiment="hammer", streams=(stream,), brake=True))
    plate = Nameplate(topology="single-dof", motion="rotational", plane="horizontal")
    return Campaign(path=Path(), rig=plate, runs=tuple(runs))


@pytest.mark.parametrize(
    ("extra", "name"),
    [
        (lambda q, v: 40.0 * v * abs(v), "quadratic-damping"),
        (lambda q, v: 3e11 * q**3, "stiffness-nonlinearity"),
        (lambda q, v: 1.5 * np.tanh(v / 1e-3), "coulomb-friction"),
    ],
)
def test_it_names_a_law_of_its_dictionary(extra, name):
    """Noise-free and in its dictionary, it names the law first."""
    said = sparse_regression(hits(extra))
    assert said["effects"][0]["effect"] == name


def test_a_linear_record_gives_nothing():
    """Negative control."""
    assert sparse_regression(hits(lambda q, v: 0.0, noise=0.01))["verdict"] == "none"
