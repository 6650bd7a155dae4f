"""The gates between a gain and a name: what noise gives, what a fit alone gives, what a further effect must add."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.adjudicate import REAL, Comparison
from jointscope.diagnosis.parameters import bounded, near_nameplate
from jointscope.diagnosis.verdict import TEMPERATURE, temperature

FOUND = Comparison(
    gain=200.0, held_gain=80.0, expected_held=90.0, foretold_held=85.0, share_of_runs=1.0, lost=0.0, material=0.02,
    share=1.0, parents=0, parent_gain=0.0,
)  # fmt: skip
FURTHER = replace(FOUND, parents=1, parent_gain=2000.0, share=0.25)


def test_what_gains_carries_over_and_matters_stands():
    assert FOUND.stands


@pytest.mark.parametrize(
    "changed",
    [
        {"gain": 0.9 * REAL},
        {"held_gain": 1.0},
        {"held_gain": 20.0},  # a true child would have gained 85
        {"expected_held": 2000.0},  # the fitted runs gained twenty-five times as much, sample for sample
        {"lost": 60.0},
        {"material": 1e-4},
    ],
)
def test_each_gate_alone_keeps_it_out(changed):
    assert not replace(FOUND, **changed).stands


def test_a_run_that_loses_by_chance_does_not_outweigh_what_was_foretold():
    assert replace(FOUND, held_gain=30.0, lost=15.0, expected_held=60.0).stands


def test_without_held_out_runs_nothing_is_asked_of_them():
    assert replace(FOUND, held_gain=math.nan, expected_held=math.nan, foretold_held=math.nan, lost=math.nan).stands


def test_a_further_effect_needs_a_share_or_evidence_or_some_of_both():
    some = replace(FURTHER, gain=200.0, held_gain=90.0)  # 15 % of the parent's gain
    assert some.stands
    assert not replace(some, gain=100.0, held_gain=40.0).stands  # 7 %
    assert not replace(some, share=0.1).stands
    assert replace(some, gain=100.0, held_gain=40.0, share=0.5).stands
    assert replace(some, share=0.05, gain=700.0).stands


def test_belief_is_tempered_by_what_is_explained():
    """One per cent of a large gain is what a law of the wrong form costs."""
    assert temperature(-1.0) == temperature(100.0) == TEMPERATURE
    assert temperature(1e5) == pytest.approx(1e3)


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
    hit = near_nameplate(replace(problem.base, start=far), problem.runs, rig).start
    np.testing.assert_array_equal(hit, far)


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
