"""A joint of another stiffness or another damping in every run is no joint with one of each; one and the same joint is."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis import between_runs
from jointscope.diagnosis.adjudicate import judge
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.between_runs import Varying, varying, varying_json, with_varying
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.split import split_runs

AWAY = np.array([-0.3, 0.25, -0.1, 0.2, -0.25, 0.2])  # of the common value, run by run


def judged(builders, parameter, share):
    """Six sweeps by joints that differ in one of ``K``, ``b_m``, by ``share`` of ``AWAY``, with 2 % of white noise."""
    rng = np.random.default_rng(5)
    runs = []
    for k, away in enumerate(AWAY):
        plant = builders.Plant()
        plant = replace(plant, **{parameter: getattr(plant, parameter) * (1.0 + share * away)})
        runs.append(builders.sweep_run(plant, 50.0, f"s{k}"))
    own = prepare(builders.campaign_of(runs))

    def noisy(o):
        scale = 0.0 if o.observed else 0.02 * np.std(o.data)
        return replace(o, data=o.data + scale * rng.standard_normal(o.data.size))

    own = replace(own, runs=tuple(replace(r, outputs=tuple(map(noisy, r.outputs))) for r in own.runs))
    split = split_runs(own)
    with ThreadPoolExecutor(1) as pool:
        stage = refit_base(own, predict_outputs, split.estimate, pool)
        judgement = judge(stage, [], split.held_out)
        return varying(judgement, judgement.base)


@pytest.mark.parametrize(("parameter", "share", "name"), [("K", 0.3, "stiffness"), ("b_m", 4.0, "motor_damping")])
def test_what_differs_between_runs_is_measured_and_stands(builders, parameter, share, name):
    """In the order in which the runs differ; the parameter is the one that carries over most."""
    found = judged(builders, parameter, share)
    most = found[0]
    assert most.stands
    assert most.name == name
    true = share * AWAY[[int(run[1:]) for run in most.runs]]
    assert np.corrcoef(true, most.departures)[0, 1] > 0.9
    said = varying_json(found)[0]
    assert said["parameter"] == name
    assert set(said["by_run"]) == set(most.runs)
    assert name.replace("_", " ") in said["sentence"]


def test_one_joint_is_the_same_in_every_run(builders):
    assert not any(v.stands for v in judged(builders, "K", 0.0))


@pytest.mark.parametrize(
    ("departures", "errors", "carried", "stands"),
    [
        ((0.3, -0.3, 0.3), (0.02, 0.02, 0.02), 60.0, True),
        ((0.3, -0.3, 0.0), (0.02, 0.02, 0.02), 60.0, False),  # two runs of three
        ((0.3, -0.3, 0.3), (0.1, 0.1, 0.1), 60.0, False),  # within its error
        ((0.3, -0.3, 0.3), (0.02, 0.02, 0.02), 10.0, False),  # not carried over
        ((0.1, -0.1, 0.1), (0.01, 0.01, 0.01), 60.0, False),  # as oil is from day to day
    ],
)
def test_what_stands(departures, errors, carried, stands):
    shown = float(
        np.sqrt(np.mean(np.square([d for d, e in zip(departures, errors, strict=True) if abs(d) > 5 * e] or [0])))
    )
    found = Varying("motor_damping", ("a", "b", "c"), departures, errors, shown, carried, 70.0)
    assert found.stands is stands
    assert bool(varying_json((found,))) is stands


def test_with_nothing_named_it_is_unknown_and_beside_a_name_it_changes_nothing(deciding_nothing):
    found = (Varying("motor_damping", ("a", "b", "c"), (0.3, -0.3, 0.3), (0.02, 0.02, 0.02), 0.3, 60.0, 70.0),)
    none, effects = deciding_nothing
    after = with_varying(none, found)
    assert (after.verdict, after.unknown_reason) == ("unknown", "outside-catalogue")
    assert after.probability == pytest.approx(0.8)
    assert with_varying(none, ()) is none
    assert with_varying(effects, found) is effects


@pytest.fixture
def deciding_nothing():
    from types import SimpleNamespace

    from jointscope.diagnosis.verdict import Decision

    judged, adequacy = SimpleNamespace(), SimpleNamespace()
    none = Decision("none", judged, 0.9, (), None, (), adequacy)
    return none, replace(none, verdict="effects")


def test_a_motion_is_not_asked_for_its_own_damping(builders, monkeypatch):
    """By the noise of its log the model rings where the joint does not, and more damping would be less of that."""
    monkeypatch.setattr(between_runs, "RUNG_BY_NOISE", ("damping", "torque-sweep"))
    names = {v.name for v in judged(builders, "K", 0.0)}
    assert "damping" not in names
    assert {"stiffness", "motor_damping"} <= names
