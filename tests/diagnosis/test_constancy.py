"""An effect whose size moves within a run is another law than the one that was named; one that keeps it is not."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.adjudicate import judge
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.constancy import STEADY, Change, changes, changes_json
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.search import Hypothesis
from jointscope.diagnosis.split import split_runs
from jointscope.diagnosis.verdict import with_changes


def friction(problem):
    spec = next(s for s in catalogue(problem) if (s.name, s.location) == ("coulomb-friction", "motor"))
    values = (spec.scale(problem)[1], *spec.starts(problem)[0])
    return ActiveEffect(spec, values)


def changing(own, active, by):
    """The recordings with friction whose size goes from 1 - ``by`` to 1 + ``by`` times its mean within every sweep.

    The angle that the observer follows is not scored: it would have to move otherwise too.
    """
    runs = []
    for run in own.runs:
        steady = run.run.experiment in STEADY
        plain = predict_outputs(run, own.base.start, (), own)
        rubbed = predict_outputs(run, own.base.start, (active,), own)
        outputs = []
        for o, y, z in zip(run.outputs, plain, rubbed, strict=True):
            size = 1.0 + (by if steady else 0.0) * np.linspace(-1.0, 1.0, y.size)
            if not o.observed:
                outputs.append(replace(o, data=o.data + size * (z - y)))
        runs.append(replace(run, outputs=tuple(outputs)))
    return replace(own, runs=tuple(runs))


@pytest.fixture(scope="module")
def found(builders, recorded):
    plant = builders.Plant()
    sweeps = [builders.sweep_run(plant, 40.0 + 5.0 * k, f"s{k}") for k in range(4)]
    own = recorded(prepare(builders.campaign_of([builders.hammer_run(plant, 100.0, "h"), *sweeps])), 0.02, seed=3)
    active = friction(own)
    split, where = split_runs(own), coordinates(own, (active.spec,))
    table = {}
    with ThreadPoolExecutor(1) as pool:
        for by in (0.0, 0.5, -0.5):
            stage = refit_base(changing(own, active, by), predict_outputs, split.estimate, pool)
            fit = least_squares(stage.objective, where, where.pack(own.base.start, (active,)))
            table[by] = judge(stage, [Hypothesis((active.spec,), fit, 0.5 * fit.chi2)], split.held_out)
        yield table, active


@pytest.mark.parametrize("by", [0.5, -0.5])
def test_a_size_that_moves_is_measured_and_stands(found, by):
    """Half of the mean at either end, within three standard errors and a tenth; the held-out runs say the same."""
    table, _ = found
    change = changes(table[by], table[by].judged[1])[0]
    assert change.relative == pytest.approx(by, abs=3.0 * change.error + 0.1)
    assert change.stands
    assert change.held_gain == pytest.approx(change.foretold, rel=0.5)
    assert ("grows" if by > 0 else "falls") in changes_json((change,))[0]["sentence"]


def test_a_size_that_stays_does_not(found):
    table, _ = found
    change = changes(table[0.0], table[0.0].judged[1])[0]
    assert abs(change.relative) < 5.0 * change.error
    assert not change.stands
    assert changes_json((change,)) == []


@pytest.mark.parametrize(
    ("relative", "error", "held_gain", "verdict"),
    [
        (0.5, 0.05, 40.0, "unknown"),
        (0.2, 0.01, 40.0, "effects"),
        (0.5, 0.2, 40.0, "effects"),
        (0.5, 0.05, 1.0, "effects"),
        (1.2, 0.05, 40.0, "effects"),  # from -0.2 to 2.2 of its size: no friction does that
    ],
)
def test_what_changes_is_not_named(found, deciding, relative, error, held_gain, verdict):
    """Too small, too uncertain, not carried over or with a change of sign, a change changes nothing."""
    table, active = found
    decision = deciding(table[0.0], active)
    change = Change("coulomb-friction@motor", relative, error, 50.0, held_gain, 30.0)
    assert with_changes(decision, (change,)).verdict == verdict


def test_a_drift_is_a_law_of_its_own_and_not_asked(found):
    """A spring that drifts changes within a run by its very law."""
    table, _ = found
    specs = (SimpleNamespace(family="stiffness", name="stiffness-drift", profiled=0, run_weights=None),)
    assert changes(table[0.0], SimpleNamespace(hypothesis=SimpleNamespace(specs=specs))) == ()
