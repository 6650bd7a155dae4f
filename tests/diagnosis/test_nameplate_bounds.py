"""What a nameplate starts, compares and bounds: nothing that a hit tells, and an arm's inertia where nothing was hit."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.parameters import beyond_nameplate, bounded, near_nameplate


def test_a_start_that_motions_gave_an_order_of_magnitude_off_the_nameplate_is_not_believed(problem):
    rig = replace(problem.rig, stiffness_reference=2e5, inertia_reference=3.0)
    moved = tuple(run for run in problem.runs if run.mode != "braked")
    assert moved and len(moved) < len(problem.runs)
    names = problem.base.names
    far, near = problem.base.start.copy(), problem.base.start.copy()
    far[[names.index("stiffness"), names.index("load_inertia")]] = 2e4, 0.3
    near[[names.index("stiffness"), names.index("load_inertia")]] = 1.5e5, 2.5
    changed = near_nameplate(replace(problem.base, start=far), moved, rig).start
    assert changed[names.index("stiffness")] == 2e5 and changed[names.index("load_inertia")] == 3.0
    kept = near_nameplate(replace(problem.base, start=near), moved, rig).start
    np.testing.assert_array_equal(kept, near)
    stiff = near_nameplate(replace(problem.base, start=far), moved, replace(rig, inertia_reference=None)).start
    assert stiff[names.index("stiffness")] == 2e5 and stiff[names.index("load_inertia")] == pytest.approx(3.0)
    hit = near_nameplate(replace(problem.base, start=far), problem.runs, rig).start
    np.testing.assert_array_equal(hit, far)
    assert beyond_nameplate(far, moved, rig) and not beyond_nameplate(near, moved, rig)
    assert not beyond_nameplate(far, problem.runs, rig)


@pytest.mark.parametrize("wrong", [0.1, 10.0])
def test_a_nameplate_off_by_ten_bounds_nothing(problem, wrong):
    """The maker's figures are starts and comparisons: what the recordings hold stays inside the bounds."""
    start = dict(zip(problem.base.names, problem.base.start, strict=True))
    rig = replace(
        problem.rig,
        stiffness_reference=wrong * start["stiffness"],
        inertia_reference=wrong * start["load_inertia"],
    )
    base = bounded(problem.base, problem.runs, rig)
    for name in ("stiffness", "load_inertia"):
        i = base.names.index(name)
        assert base.lower[i] < 0.5 * start[name] and base.upper[i] > 2.0 * start[name]


def test_in_motions_alone_friction_makes_no_arm_25_times_as_heavy(problem):
    """A hit tells the inertia whatever the nameplate says, and motions do not; without a figure nothing is known."""
    rig = replace(problem.rig, inertia_reference=3.0)
    moved = tuple(run for run in problem.runs if run.mode != "braked")
    i = problem.base.names.index("load_inertia")
    told, hit, silent = (
        bounded(problem.base, runs, own)
        for runs, own in ((moved, rig), (problem.runs, rig), (moved, replace(rig, inertia_reference=None)))
    )
    assert (told.lower[i], told.upper[i]) == (0.75, 12.0)
    assert hit.upper[i] == silent.upper[i] > 25.0 * 3.0
