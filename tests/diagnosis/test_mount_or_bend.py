"""A mount that turns and an outer part that neither hammer nor sensor follows are one motion, and each is fitted as the other."""

from __future__ import annotations

import math
from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.containment import contains
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect, at_rig
from jointscope.diagnosis.effects.coupled import PLAIN
from jointscope.diagnosis.noise import white
from jointscope.diagnosis.objective import Objective, whitened
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.refit import Fit
from jointscope.diagnosis.search import Hypothesis, profile_loss
from jointscope.diagnosis.uncoupling import MOUNT, _as_mount, as_mounts

MOVED = (60.0, 0.6, 0.03)  # Hz, share of J_L over the mount's inertia, damping


def bend(problem, truth, aside=1.0):
    frequency, share, damping = MOVED
    root, part = math.sqrt(1.0 + share), share / (1.0 + share)
    inertia = part * float(truth[problem.base.names.index("load_inertia")])
    shape = aside * math.sqrt(part)
    return ActiveEffect(at_rig(PLAIN, problem), (frequency / root, inertia, damping / root, shape, shape))


@pytest.mark.parametrize(("rubbing", "apart"), [(0.0, 1e-3), (1.0, 0.01)])
def test_both_move_alike_but_for_what_rubs_on_the_moving_mount(problem, truth, rubbing, apart):
    truth = truth.copy()
    truth[problem.base.names.index("load_damping")] *= rubbing
    mount = ActiveEffect(at_rig(MOUNT, problem), MOVED)
    for run in problem.runs:
        pairs = zip(
            predict_outputs(run, truth, (mount,), problem),
            predict_outputs(run, truth, (bend(problem, truth),), problem),
            strict=True,
        )
        for a, b in pairs:
            assert float(np.std(a - b)) < apart * float(np.std(a))


def test_the_mount_that_a_bend_stands_for(problem, truth):
    inertia = float(truth[problem.base.names.index("load_inertia")])
    assert _as_mount(bend(problem, truth), inertia) == pytest.approx(MOVED)
    assert _as_mount(bend(problem, truth, aside=2.5), inertia) is None  # hammer and sensor ride on it
    assert _as_mount(ActiveEffect(at_rig(MOUNT, problem), MOVED), inertia) is None


def test_what_was_found_as_a_bend_is_fitted_as_a_mount_once(problem, truth):
    with ThreadPoolExecutor(1) as pool:
        bare = Objective(problem, predict_outputs, tuple(range(len(problem.runs)))[:2], pool)
        objective = whitened(bare, white(bare.prepared), None)
        found = bend(problem, truth)
        where = coordinates(problem, (found.spec,))
        x = where.pack(truth, (found,))
        w = objective.residual(x, where)
        fit = Fit(where, x, w, np.zeros((len(w), where.n)), 0.0, False, False, 1)
        leader = Hypothesis((found.spec,), fit, profile_loss(objective, w))
        mounts = as_mounts(objective, [leader])
        assert [h.names for h in mounts] == [("base-compliance@base",)]
        assert mounts[0].loss < leader.loss + 1.0
        assert as_mounts(objective, [*mounts, leader]) == []


@pytest.mark.parametrize(("aside", "holds_it"), [(1.0, True), (0.99, True), (1.1, False)])
def test_a_bend_that_is_followed_as_a_mount_is_holds_the_mount(problem, truth, aside, holds_it):
    """Its two further numbers are then worth what the mount's law is off by, and no more."""
    found = bend(problem, truth, aside)
    where = coordinates(problem, (found.spec,))
    fit = SimpleNamespace(x=where.pack(truth, (found,)), coordinates=where)
    outer = SimpleNamespace(
        names=("link-flexibility@load",), hypothesis=SimpleNamespace(fit=fit, specs=(found.spec,))
    )
    inner = SimpleNamespace(names=("base-compliance@base",))
    assert contains(outer, inner) is holds_it
