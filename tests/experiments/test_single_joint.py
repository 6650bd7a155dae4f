"""The reproduction's quick form holds its bounds, and a wrong model or a distorted log does not."""

import json
from dataclasses import replace

import numpy as np
import pytest

from jointscope.experiments.single_joint import reproduce_single_joint
from jointscope.experiments.single_joint.accuracy import accuracies, log_costs
from jointscope.experiments.single_joint.bench import bench
from jointscope.identification.identify import identify


@pytest.fixture(scope="module")
def made():
    return bench(0, quick=True)


@pytest.fixture(scope="module")
def model(made):
    return identify(made.recorded).base


def test_recorded_and_true_takes_are_the_same_motion(made):
    """One seed, two chains: they differ by the sensors' noise alone."""
    for recorded, truth in zip(made.recorded.runs, made.truth.runs, strict=True):
        seen, real = (run.select("linear-acceleration")[0].samples for run in (recorded, truth))
        assert np.sqrt(np.mean((seen - real) ** 2)) < 0.03  # m/s^2, the accelerometer's noise


def test_vibration_is_predicted_from_torque_within_the_bounds(made, model):
    """Median 0.2 dB, FRAC 0.995 over the bins clear of carried noise, on sweep and motion."""
    assert [entry.holds for entry in accuracies(model, made)] == [True, True]


@pytest.mark.parametrize(("name", "factor"), [("stiffness", 1.05), ("efficiency", 0.95), ("load_inertia", 0.95)])
def test_a_broken_model_breaks_the_bounds(made, model, name, factor):
    """Five per cent of stiffness, efficiency or inertia turns the figure red."""
    wrong = replace(model, joint={**model.joint, name: model.joint[name] * factor})
    sweep = accuracies(wrong, made)[0]
    assert not sweep.holds


def test_a_log_of_known_kind_is_undone(made, model):
    """Averaging or holding costs a quarter of a dB at the top; undone, nothing is left of it."""
    costs = {(cost.kind, cost.read_as == "samples"): cost.error_at_top for cost in log_costs(model, made)}
    for kind in ("hold", "average"):
        assert costs[kind, True] < -0.15
        assert abs(costs[kind, False]) < 0.05


def test_the_quick_form_writes_page_figures_and_results(tmp_path, capsys):
    """Exit code 0, a page, every figure with its data."""
    assert reproduce_single_joint(tmp_path / "out", quick=True, seed=0) == 0
    results = json.loads((tmp_path / "out" / "results.json").read_text())
    assert results["printed_agreement_percent"] <= 0.7
    for number in range(8, 16):
        assert list((tmp_path / "out").glob(f"figure-{number:02d}*.png"))
        assert list((tmp_path / "out").glob(f"figure-{number:02d}*.csv"))
    assert "Table 2" in capsys.readouterr().out
