"""Where a play's flanks are met: each is an event within a step, so that the method keeps its order across it."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jointscope.diagnosis import kernel as k
from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.kernel.events import crossing, flank_of
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.ring_downs import _beside_motions

sys.path.insert(0, str(Path(__file__).parent))
from packed_joint import packed, run  # type: ignore[import-not-found]

SWITCHES = {"held": k.MOTOR_HELD, "free": k.MOTOR_FREE}


def errors(*, motor, **numbers):
    """Of the arm's acceleration over a second of rattling, at three rates, by a very fine one."""
    found = []
    for rate in (65536, 4096, 8192, 16384):
        P, S = packed(C=40.0, GAP_HALF=1e-4, MOTOR=SWITCHES[motor], **numbers)
        _, out = run(P, S, x=(0.0, 0.0, 0.0, 0.05), duration=1.0, rate=float(rate))
        found.append(out[:: rate // 1024, k.X_A])
    return [float(np.std(x - found[0]) / np.std(found[0])) for x in found[1:]]


@pytest.mark.parametrize("motor", ["held", "free"])
@pytest.mark.parametrize("inside", [0.0, 0.3, 1.0])
def test_a_play_is_stepped_to_fourth_order(motor, inside):
    """Steps across a flank were wrong by a tenth of the acceleration, and came no nearer with their number."""
    coarse, middle, fine = errors(motor=motor, GAP_DAMPING=inside)
    assert coarse < 2e-5
    assert fine < middle / 8.0 < coarse / 40.0


def test_a_flank_that_does_not_pull_is_stepped_to_first_order_at_least():
    """Where the torque of a closed contact falls to nought it has a kink that no event marks."""
    coarse, _, fine = errors(motor="held", GAP_SHEDS=1.0)
    assert coarse < 5e-3 and fine < coarse / 4.0


@pytest.mark.parametrize("seed", range(20))
def test_a_crossing_is_the_root_of_hermites_cubic(seed):
    rng = np.random.default_rng(seed)
    d0, d1 = -rng.uniform(0.1, 1.0), rng.uniform(0.1, 1.0)
    r0, r1 = rng.uniform(-0.5, 3.0, 2)
    u = crossing(d0, r0, d1, r1)
    value = d0 + u * (r0 + u * (3 * (d1 - d0) - 2 * r0 - r1 + u * (2 * (d0 - d1) + r0 + r1)))
    assert 0.0 < u < 1.0
    assert abs(value) < 1e-8


def test_what_begins_on_the_other_side_or_at_nought_has_crossed():
    assert crossing(0.0, 1.0, 1.0, 1.0) == 0.0
    assert crossing(1e-15, 1.0, 1.0, 1.0) == 0.0
    assert crossing(-1.0, 2.0, 1.0, 2.0) == pytest.approx(0.5)
    assert [flank_of(d, 1.0) for d in (-2.0, -1.0, 0.0, 1.0, 2.0)] == [-1, 0, 0, 0, 1]


def test_what_hits_do_not_show_is_fitted_first_where_the_motor_moves(problem, recorded):
    """From hits that leave a third of the base's damping at the arm the rest goes to the motor; what they show stays."""
    quiet = recorded(problem, 0.002)
    (law,) = (spec for spec in catalogue(quiet) if (spec.name, spec.variant) == ("backlash", "free-flight"))
    where = coordinates(quiet, (law,))
    with ThreadPoolExecutor(1) as pool:
        stage = refit_base(quiet, predict_outputs, tuple(range(len(quiet.runs))), pool)
        base, _ = stage.fit.coordinates.unpack(stage.fit.x)
        hits = base.copy()
        arm, motor = BASE_INDEX["load_damping"], BASE_INDEX["motor_damping"]
        hits[arm], hits[motor] = base[arm] + base[motor], 0.0
        before = replace(stage.fit, x=stage.fit.coordinates.pack(hits, ()))
        hits = base.copy()
        hits[motor] = 0.0
        fit = replace(stage.fit, coordinates=where, x=where.pack(hits, (ActiveEffect(law, (1e-7,)),)))
        theta, (gap,) = where.unpack(_beside_motions(stage.objective, before, fit, where))
        braked = [i for i, run in enumerate(stage.objective.prepared) if run.mode == "braked"]
        alone = _beside_motions(stage.objective.restricted(braked), before, fit, where)
    assert gap.values == pytest.approx((1e-7,))
    for name in ("stiffness", "damping", "load_inertia", "load_damping"):
        assert theta[BASE_INDEX[name]] == pytest.approx(hits[BASE_INDEX[name]])
    assert theta[motor] == pytest.approx(base[motor], rel=0.2)
    np.testing.assert_array_equal(alone, fit.x)
