"""Sets of one effect more: what shows only beside the first effect is started, and scored, there."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis import extensions as extending
from jointscope.diagnosis.candidates import candidates_for, residuals_of, where_shown
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.extensions import extensions
from jointscope.diagnosis.objective import Objective
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.screen import Trial
from jointscope.diagnosis.search import Effort, Hypothesis, at_own_size, profile_loss, screen_on

NOISE = 2e-3  # of each channel's rms


def law(problem, name, variant):
    return next(s for s in catalogue(problem) if s.name == name and s.variant == variant)


def test_a_light_mount_starts_where_the_residual_rings(problem, recorded):
    """A few per cent off, an oscillation that lasts is another one: the start comes from what follows the input."""
    spec = law(problem, "sensor-resonance", "mount")
    ringing = ActiveEffect(spec, (287.0, 0.02))
    data = recorded(problem, NOISE, effects=(ringing,))
    with ThreadPoolExecutor(1) as pool:
        objective = Objective(data, predict_outputs, tuple(range(len(data.runs))), pool)
        left = residuals_of(objective, objective.predictions(data.base.start, ()))
    starts = where_shown(data, (spec,), left)
    assert min(abs(a.values[0] / 287.0 - 1.0) for a in starts) < 0.02
    assert {a.values[1] for a in starts} == {0.02, 0.1}
    grid = candidates_for(data, (spec,))
    assert min(abs(a.values[0] / 287.0 - 1.0) for a in grid) > 0.02  # which no grid of sizes has


@pytest.mark.parametrize(("factor", "kept"), [(0.7, True), (1.6, True), (0.2, False), (3.0, False)])
def test_a_frequency_that_is_about_right_stays_where_it_was_tried(problem, factor, kept):
    active = ActiveEffect(law(problem, "sensor-resonance", "mount"), (287.0, 0.02))
    trial = Trial(active, np.zeros(1, dtype=np.float32), 1.0, 100.0, factor, 0.0)
    assert (at_own_size(trial).values[0] == 287.0) is kept


def test_a_mode_behind_a_clipped_record_is_found_in_what_the_clipping_leaves(problem, recorded, fitted):
    """On top of the base the residual is the clipping's; on top of the clipping it is the mode's."""
    peak = problem.scales.acceleration
    clip = ActiveEffect(law(problem, "sensor-saturation", "clip"), (0.4 * peak,))
    absorber = law(problem, "neighbour-flexibility", "absorber")
    mode = ActiveEffect(absorber, (61.0, 0.01, 0.01))
    data = recorded(problem, NOISE, effects=(clip, mode))
    theta = data.base.start
    objective, at = fitted(data, clip, mode)
    base, wide = at(theta), at(theta, clip)
    elsewhere = [ActiveEffect(absorber, (f, 0.03, 0.02)) for f in (9.0, 150.0)]
    candidates = [clip, *elsewhere]
    before = screen_on(objective, base, candidates, Effort())
    parent = Hypothesis((clip.spec,), wide, profile_loss(objective, wide.w))
    (found,) = extensions(objective, base, parent, (absorber,), before, Effort())
    assert found.names == ("neighbour-flexibility@neighbour", "sensor-saturation@acquisition")
    _, (_, fit) = found.fit.coordinates.unpack(found.fit.x)
    assert fit.values[0] == pytest.approx(61.0, rel=0.01)
    assert fit.values[2] == pytest.approx(0.01, rel=0.2)


def test_directions_of_a_base_that_is_far_away_are_taken_anew(problem, recorded, fitted, monkeypatch):
    """A base in a valley of its own scores every law wrongly; so, far from it, each is tried again at the parent."""
    cubic = law(problem, "stiffness-nonlinearity", "cubic")
    size = 3.0 * cubic.scale(problem)[1]
    bent = ActiveEffect(cubic, (size,))
    slip = law(problem, "hysteresis", "dahl")
    loop = candidates_for(problem, (slip,))[-1]
    data = recorded(problem, NOISE, effects=(loop, bent))
    objective, at = fitted(data, loop, bent)
    wide = at(data.base.start, loop)
    base = at(data.base.start)
    names = ("coulomb-friction", "quadratic-damping", "sensor-tilt", "delay", "sensor-saturation")
    others = list({(s.name, s.location): s for s in catalogue(problem) if s.name in names}.values())
    before = screen_on(objective, base, candidates_for(problem, (*others, cubic)), Effort())
    blind = np.zeros_like(before.trials[0].direction)
    trials = tuple(replace(t, direction=blind) if t.spec is cubic else t for t in before.trials)
    before = replace(before, trials=trials)
    parent = Hypothesis((slip,), wide, profile_loss(objective, wide.w))
    effort = Effort(refine=4, children=2)

    def named():
        return [h.names for h in extensions(objective, base, parent, (), before, effort)]

    assert ("hysteresis@transmission", "stiffness-nonlinearity@transmission") in named()
    monkeypatch.setattr(extending, "AFAR", math.inf)
    assert ("hysteresis@transmission", "stiffness-nonlinearity@transmission") not in named()
