"""A force that is missing along a recorded path is told from what the instruments' noise makes, whatever its colour."""

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.adjudicate import judge
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.force_left import ASTRAY, ForceLeft, force_left
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.split import split_runs
from jointscope.diagnosis.verdict import Decision, with_force_left
from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream

RATE, M, B = 500.0, 60.0, 200.0


def carriage(name, pace, *, thins, role, encoder=1e-6):
    """A carriage that is driven to and fro, its force in closed form; ``thins``: by how much its grease is thicker when cold."""
    t = np.arange(round(12.0 * RATE)) / RATE
    w = 2.0 * np.pi * pace
    up = np.clip(t / 0.5, 0.0, 1.0) ** 2 * (3.0 - 2.0 * np.clip(t / 0.5, 0.0, 1.0))
    q = 0.2 * up * np.sin(w * t)
    v = np.gradient(q, t)
    rng = np.random.default_rng([7, round(1000 * pace)])
    force = M * np.gradient(v, t) + B * (1.0 + thins * np.exp(-t / 4.0)) * v
    channels = (
        Channel(column="f", quantity="force", unit="N", location="load", role="input",
                samples=force + 0.05 * rng.standard_normal(t.size)),
        Channel(column="x", quantity="position", unit="m", location="load", role="output",
                samples=q + encoder * rng.standard_normal(t.size)),
    )  # fmt: skip
    stream = Stream(file=f"{name}.csv", sampling_rate=RATE, length=t.size, channels=channels)
    return Run(id=name, experiment="speed-motion", streams=(stream,), initial="estimate", role=role)


def left_of(**more):
    rig = Nameplate(topology="single-dof", motion="translational", plane="horizontal", ground_spring=False)
    roles = ("estimate", "estimate", "validate")
    runs = tuple(carriage(f"r{k}", 0.2 + 0.07 * k, role=role, **more) for k, role in enumerate(roles))
    problem = prepare(Campaign(path=Path("carriage"), rig=rig, runs=runs))
    split = split_runs(problem)
    with ThreadPoolExecutor(1) as pool:
        return force_left(judge(refit_base(problem, predict_outputs, split.estimate, pool), (), split.held_out))


@pytest.mark.parametrize("encoder", [1e-6, 2e-5])
def test_what_noise_makes_is_not_missed(encoder):
    found = left_of(thins=0.0, encoder=encoder)
    assert found.lack < 0.5
    assert found.share < max(3.0 * found.noise, 0.01)


def test_a_grease_that_thins_leaves_a_force():
    found = left_of(thins=1.0)
    assert found.share > 2.0 * ASTRAY and found.lack > 1.0
    assert found.noise < 0.01


def test_a_joint_of_two_inertias_is_not_asked(problem):
    split = split_runs(problem)
    with ThreadPoolExecutor(1) as pool:
        judgement = judge(refit_base(problem, predict_outputs, split.estimate, pool), (), split.held_out)
    assert force_left(judgement) is None


@pytest.mark.parametrize(
    ("share", "noise", "lacks"), [(0.15, 0.001, True), (0.15, 0.05, False), (0.04, 0.0, False)]
)
def test_it_must_matter_and_be_beyond_noise(share, noise, lacks):
    assert (ForceLeft(share, noise).lack > 1.0) is lacks


@pytest.mark.parametrize(
    ("verdict", "lack", "said"), [("none", 2.0, "unknown"), ("none", 0.9, "none"), ("effects", 2.0, "effects")]
)
def test_only_none_gives_way(verdict, lack, said):

    decision = Decision(verdict, SimpleNamespace(), 0.9, (), None, (), SimpleNamespace())
    assert with_force_left(decision, lack).verdict == said
