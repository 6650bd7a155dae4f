"""Narrow modes are sought in every channel and every kind of experiment."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.candidates import residuals_of
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.effects.lines import Residuals
from jointscope.diagnosis.effects.narrow import narrow_modes
from jointscope.diagnosis.objective import Objective
from jointscope.diagnosis.predict import predict_outputs

NOISE = 2e-3  # of each channel's rms
BAND = (5.0, 300.0)


def left_of(data, theta):
    with ThreadPoolExecutor(1) as pool:
        objective = Objective(data, predict_outputs, tuple(range(len(data.runs))), pool)
        return residuals_of(objective, objective.predictions(theta, ()))


@pytest.fixture
def hits(problem):
    """The two hits alone: an encoder without noise shows whatever numbers leave."""
    return replace(problem, runs=tuple(run for run in problem.runs if run.run.experiment == "hammer"))


def absorber(problem, frequency, share, damping):
    spec = next(s for s in catalogue(problem) if s.name == "neighbour-flexibility" and s.variant == "absorber")
    return ActiveEffect(spec, (frequency, share, damping))


@pytest.mark.parametrize(("frequency", "damping"), [(61.0, 0.008), (61.0, 0.02), (140.0, 0.02)])
def test_a_weak_mode_is_found_to_within_its_width(hits, recorded, frequency, damping):
    data = recorded(hits, NOISE, effects=(absorber(hits, frequency, 1e-3, damping),))
    found = narrow_modes(data, left_of(data, data.base.start), *BAND)
    assert min(abs(f / frequency - 1.0) for f, _ in found) < 2.0 * damping


def test_noise_alone_shows_hardly_any(hits, recorded):
    counts = []
    for seed in range(5):
        data = recorded(hits, NOISE, seed=10 + seed)
        counts.append(len(narrow_modes(data, left_of(data, data.base.start), *BAND)))
    assert np.mean(counts) < 1.5


@dataclass(frozen=True, eq=False)
class Heard:
    """As much of a problem as narrow modes are sought in, and what a model leaves of it."""

    runs: list
    rows: list


def heard_by(channels, hits=4, rate=1000.0, seconds=2.0, seed=1, mode=(33.0, 0.01), experiment="hammer"):
    """Records in which each channel has (size of a mode at 33 Hz in it, size of its noise)."""
    rng = np.random.default_rng(seed)
    t = np.arange(int(seconds * rate)) / rate
    runs, rows = [], []
    for _ in range(hits):
        outputs, left = [], []
        for quantity, (size, noise) in channels.items():
            said = np.exp(-0.03 * 2 * np.pi * 40.0 * t) * np.sin(2 * np.pi * 40.0 * t)
            w, zeta = 2 * np.pi * mode[0], mode[1]
            rings = np.exp(-zeta * w * t) * np.sin(w * t)
            r = size * np.convolve(said, rings)[: t.size] / rate + noise * rng.standard_normal(t.size)
            outputs.append(
                SimpleNamespace(
                    quantity=quantity, location="arm", direction="tangential", rate=rate, data=said + r,
                    mask=np.ones(t.size, dtype=bool),
                )
            )  # fmt: skip
            left.append(r)
        of = SimpleNamespace(experiment=experiment, brake=experiment == "hammer")
        runs.append(SimpleNamespace(run=of, outputs=outputs))
        rows.append(left)
    return Heard(runs, rows)


@pytest.mark.parametrize("shown_by", ["angle", "linear-acceleration"])
def test_one_channel_is_enough(shown_by):
    """A mode that an encoder alone shows: the acceleration there is mostly noise."""
    quiet = 1e-5 if shown_by == "angle" else 1e-3
    sizes = {"angle": (0.0, 1e-3), "linear-acceleration": (0.0, 1.0)} | {shown_by: (1.0, quiet)}
    heard = heard_by(sizes)
    found = narrow_modes(heard, Residuals(heard.rows), 4.0, 300.0)
    assert found and abs(found[0][0] / 33.0 - 1.0) < 0.01
    nothing = heard_by({quantity: (0.0, noise) for quantity, (_, noise) in sizes.items()})
    assert len(narrow_modes(nothing, Residuals(nothing.rows), 4.0, 300.0)) <= 1


def test_what_one_kind_of_experiment_leaves_broadly_does_not_hide_what_another_shows_sharply():
    hits = heard_by({"linear-acceleration": (1.0, 1e-3)})
    sweeps = heard_by({"linear-acceleration": (9.0, 1e-3)}, mode=(40.0, 0.06), experiment="torque-sweep")
    both = Heard([*hits.runs, *sweeps.runs], [*hits.rows, *sweeps.rows])
    found = narrow_modes(both, Residuals(both.rows), 4.0, 300.0)
    assert min(abs(f / 33.0 - 1.0) for f, _ in found) < 0.01
