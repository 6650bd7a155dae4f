"""A weak line of the mains is the recording's; as weak a line of any other frequency, or a strong one, is not."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from jointscope.diagnosis.adjudicate import compare, judge
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.mains import of_mains
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.search import Hypothesis
from jointscope.diagnosis.split import split_runs


@pytest.mark.parametrize(
    ("frequency", "expected"),
    [
        (50.02, True),
        (99.95, True),
        (60.0, True),
        (150.1, True),
        (49.5, False),
        (27.0, False),
        (55.0, False),
        (700.0, False),
    ],
)
def test_the_grid_keeps_its_frequency(frequency, expected):
    assert of_mains(frequency) is expected


@pytest.mark.parametrize(
    ("frequency", "size", "stands"), [(50.02, 0.1, False), (53.7, 0.1, True), (50.02, 1.0, True)]
)
def test_a_weak_hum_does_not_stand(builders, recorded, frequency, size, stands):
    plant = builders.Plant()
    own = prepare(builders.campaign_of([builders.hammer_run(plant, 100.0 + 40.0 * k, f"h{k}") for k in range(6)]))
    spec = next(s for s in catalogue(own) if (s.name, s.variant) == ("external-vibration", "torque"))
    active = ActiveEffect(spec, (frequency, size * spec.scale(own)[1]))
    own = recorded(own, 0.01, seed=3, effects=(active,))
    split, where = split_runs(own), coordinates(own, (spec,))
    with ThreadPoolExecutor(1) as pool:
        stage = refit_base(own, predict_outputs, split.estimate, pool)
        fit = least_squares(stage.objective, where, where.pack(own.base.start, (active,)))
        judgement = judge(stage, [Hypothesis((spec,), fit, 0.5 * fit.chi2)], split.held_out)
    child = next(j for j in judgement.judged if j.names)
    against = compare(judgement, judgement.base, child)
    assert against.real
    assert against.stands is stands
