"""An AC-coupled accelerometer whose weight turns with the arm keeps it; one whose record refutes that loses it, and says so."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.model_file import model_json
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.predict_file import predict_campaign
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.seen_weight import as_seen, weightless

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


def test_a_model_takes_what_was_read_to_other_recordings(builders):
    """Predictions by the file differ by what g cos q turns, and where nothing was refuted the file says nothing of it."""
    plant = builders.Plant()
    campaign = builders.campaign_of([builders.sweep_run(plant, 80.0, "s0")])
    own = prepare(campaign)
    channels = {o.channel for run in own.runs for o in run.outputs if o.quantity == "linear-acceleration"}
    bare = replace(own, runs=tuple(weightless(run, channels) for run in own.runs))
    models = [model_json(problem, own.base.start, ()) for problem in (own, bare)]
    assert all(sensor["weighs"] for sensor in models[0]["sensors"])
    assert [
        sensor["weighs"] for sensor in models[1]["sensors"] if sensor["quantity"] == "linear-acceleration"
    ] == [False]
    told = [{s.channel.quantity: y for s, y in predict_campaign(model, campaign)["s0"]} for model in models]
    apart = told[0]["linear-acceleration"] - told[1]["linear-acceleration"]
    assert np.std(apart) > 1e-3
    assert told[0]["angle"] == pytest.approx(told[1]["angle"])
