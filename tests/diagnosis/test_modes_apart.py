"""A bend far from the joint's own resonance is fitted from where most is left; nothing is tried where the base is near."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.modes_apart import modes_apart
from jointscope.diagnosis.noise import white
from jointscope.diagnosis.objective import whitened
from jointscope.diagnosis.opening import up_to
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.refit import least_squares
from jointscope.diagnosis.search import Effort

NAME = "link-flexibility"


def bend(problem, share, shape):
    """An arm in two bodies at 1.6 times the joint's frequency, hit and sensed at one place of it."""
    spec = next(s for s in catalogue(problem) if s.name == NAME and s.variant == "one-shape")
    inertia = problem.base.start[problem.base.names.index("load_inertia")]
    return ActiveEffect(spec, (1.6 * problem.scales.frequency, share * inertia, 0.02, shape))


@pytest.fixture
def tried(base_and_trials):
    def made(problem, effects):
        objective, base, left, candidates = base_and_trials(problem, effects)
        return base, modes_apart(objective, base, candidates, objective.problem, left, Effort())

    return made


@pytest.mark.parametrize("shape", [1.0, 1.5])
def test_the_bend_is_found(problem, recorded, tried, shape):
    effect = bend(problem, 0.14, shape)
    base, found = tried(recorded(problem, 2e-3, effects=(effect,)), (effect,))
    best = min((h for h in found if h.specs[0].name == NAME), key=lambda h: h.loss)
    assert best.fit.chi2 < 0.01 * base.chi2
    (law,) = best.fit.coordinates.unpack(best.fit.x)[1]
    assert law.values[0] == pytest.approx(effect.values[0], rel=0.01)
    assert len({id(h.specs[0]) for h in found}) == len(found)


def test_a_bend_is_sought_in_whole_runs_where_the_search_has_a_part_of_them(problem, recorded, base_and_trials):
    """The last run is a sweep: its first two thirds are searched, and what the base leaves is known of all of it."""
    effect = bend(problem, 0.14, 1.0)
    objective, base, left, candidates = base_and_trials(recorded(problem, 2e-3, effects=(effect,)), (effect,))
    whole, last = objective.problem, objective.problem.runs[-1]
    part = replace(whole, runs=(*whole.runs[:-1], up_to(last, last.t0 + 2.0 * last.steps / last.grid_rate / 3.0)))
    cut = whitened(replace(objective, problem=part), white(part.runs), None)
    fit = least_squares(cut, base.coordinates, base.x, iterations=3)
    found = modes_apart(cut, fit, candidates, whole, left, Effort())
    assert any(h.specs[0].name == NAME and h.fit.chi2 < 0.1 * fit.chi2 for h in found)


def test_what_is_near_the_data_has_no_mode_tried(problem, recorded, tried):
    base, found = tried(recorded(problem, 2e-3), ())
    assert found == []
    assert np.isfinite(base.chi2)


def test_a_mount_that_slides_one_way_is_found_from_the_one_that_slides_along_every_tangent(
    builders, plant, recorded, tried
):
    level = replace(plant, weight=1e-9)
    runs = [builders.hammer_run(level, 100.0, f"a{i}", duration=0.7) for i in range(4)]
    angles = (0.0, 0.0, 0.9, 0.9)
    problem = prepare(builders.campaign_of([replace(r, arm_angle=q) for r, q in zip(runs, angles, strict=True)]))
    spec = next(s for s in catalogue(problem) if s.variant == "sliding-mount-turned")
    effect = ActiveEffect(spec, (1.5 * problem.scales.frequency, 0.03, 0.024, 1.1, 0.0))
    base, found = tried(recorded(problem, 2e-3, effects=(effect,)), (effect,))
    best = min(found, key=lambda h: h.loss)
    assert best.specs[0].variant == spec.variant
    assert best.fit.chi2 < 0.01 * base.chi2
    (law,) = best.fit.coordinates.unpack(best.fit.x)[1]
    assert law.values[0] == pytest.approx(effect.values[0], rel=0.02)
    assert abs(np.sin(law.values[4])) < 0.3
