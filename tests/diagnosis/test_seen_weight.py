"""An AC-coupled accelerometer whose weight turns with the arm keeps it; one whose record refutes that loses it, and says so."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.seen_weight import as_seen

G = 9.80665


def coupled(problem, gravity):
    def ac(output):
        acceleration = output.quantity == "linear-acceleration"
        return replace(output, low_cutoff=0.5, gravity=gravity) if acceleration else output

    return replace(problem, runs=tuple(replace(run, outputs=tuple(map(ac, run.outputs))) for run in problem.runs))


def recorded_with(problem, gravity):
    """The problem that believes in weight, its records made with ``gravity`` [m/s^2] and noise of 1e-4."""
    rng = np.random.default_rng(5)
    true, own = coupled(problem, gravity), coupled(problem, G)
    runs = []
    for made, run in zip(true.runs, own.runs, strict=True):
        data = predict_outputs(made, true.base.start, (), true)
        noisy = [y + 1e-4 * np.std(y) * rng.standard_normal(y.size) for y in data]
        runs.append(
            replace(run, outputs=tuple(replace(o, data=y) for o, y in zip(run.outputs, noisy, strict=True)))
        )
    return replace(own, runs=tuple(runs))


@pytest.mark.parametrize(("gravity", "kept"), [(G, True), (0.0, False)])
def test_the_reading_that_the_records_refute_is_dropped(builders, gravity, kept):
    plant = builders.Plant()
    problem = prepare(
        builders.campaign_of([builders.sweep_run(plant, 60.0, "s0"), builders.sweep_run(plant, 80.0, "s1")])
    )
    own = recorded_with(problem, gravity)
    found = as_seen(own, own.base.start, predict_outputs)
    assert (found is own) is kept
    weights = {o.gravity for run in found.runs for o in run.outputs if o.quantity == "linear-acceleration"}
    assert weights == ({G} if kept else {0.0})
    assert kept or "weight" in found.findings[-1]


def test_hits_alone_do_not_tell(builders):
    problem = prepare(builders.campaign_of([builders.hammer_run(builders.Plant(), 150.0, "h0")]))
    own = recorded_with(problem, 0.0)
    assert as_seen(own, own.base.start, predict_outputs) is own
