"""A child against a parent: what it must gain, in which runs, and how much of the whole it must be."""

import math
from dataclasses import replace

import pytest

from jointscope.diagnosis.gates import REAL, UNASKED, Comparison

FOUND = Comparison(
    gain=200.0, held_gain=80.0, expected_held=90.0, foretold_held=85.0, share_of_runs=1.0, lost=0.0, material=0.02,
    share=1.0, parents=0, parent_gain=0.0,
)  # fmt: skip
FURTHER = replace(FOUND, parents=1, parent_gain=2000.0, share=0.25)


def test_what_gains_carries_over_and_matters_stands():
    assert FOUND.stands


@pytest.mark.parametrize(
    ("figures", "stands"),
    [
        ({"held_gain": 400.0}, False),  # 4.7 times what was foretold: another size in those runs
        ({"share_of_runs": 0.25, "lost": 20.0}, False),  # one run gains, three lose
        ({"share_of_runs": 0.25, "lost": 5.0}, True),
        ({"share_of_runs": 0.75, "lost": 20.0}, True),
        ({"gain": 250.0, "material": 0.0005}, True),  # small, and beyond doubt
        ({"gain": 150.0, "material": 0.0005}, False),
        ({"gain": 250.0, "material": 0.0005, "held_gain": 30.0}, False),
    ],
)
def test_held_out_runs_gain_what_was_foretold_and_not_far_more(figures, stands):
    assert replace(FOUND, **figures).stands is stands


@pytest.mark.parametrize(
    "changed",
    [
        {"gain": 0.9 * UNASKED * REAL},
        {"gain": 0.9 * REAL, "held_gain": 0.9 * REAL, "foretold_held": 10.0, "expected_held": 10.0},
        {"held_gain": 1.0},
        {"held_gain": 20.0},  # a true child would have gained 85
        {
            "expected_held": 2000.0,
            "foretold_held": 120.0,
        },  # the fitted runs gained twenty-five times as much, sample for sample
        {"lost": 60.0},
        {"material": 1e-4},
    ],
)
def test_each_gate_alone_keeps_it_out(changed):
    assert not replace(FOUND, **changed).stands


def test_what_the_held_out_runs_show_by_themselves_needs_less_in_the_fit():
    assert replace(FOUND, gain=0.9 * REAL).stands


def test_what_is_gained_as_foretold_need_not_be_in_proportion():
    """A moment of weight that the quiet sweeps show and the loud one hardly: 5430 nats in the fit, 49 of 54 held out."""
    assert replace(FOUND, gain=5430.0, held_gain=49.0, foretold_held=54.0, expected_held=1561.0, lost=1.0).stands


def test_what_comes_from_outside_may_be_stronger_in_one_run_than_in_another():
    """A line of 31.8 Hz gains 542 nats in three motions and 50 in a fourth, of 173 foretold: there it is two thirds as large."""
    weaker = replace(FOUND, gain=542.0, held_gain=50.0, foretold_held=173.0)
    assert not weaker.stands
    assert replace(weaker, from_outside=True).stands
    assert not replace(weaker, from_outside=True, held_gain=25.0).stands


def test_a_run_that_loses_by_chance_does_not_outweigh_what_was_foretold():
    assert replace(FOUND, held_gain=30.0, lost=15.0, expected_held=60.0).stands


@pytest.mark.parametrize(
    ("rest", "exact", "stands"), [(0.6, True, True), (0.6, False, False), (0.95, False, True), (0.4, True, False)]
)
def test_a_small_further_effect_stands_where_it_explains_what_its_parent_leaves(rest, exact, stands):
    """Drag beside a weight fifty times stronger: 17 % of what is explained, but nearly all that the weight leaves."""
    weak = replace(
        FURTHER,
        share=0.17,
        gain=450.0,
        held_gain=150.0,
        foretold_held=150.0,
        expected_held=200.0,
        parent_gain=9000.0,
    )
    assert replace(weak, rest=rest, exact=exact).stands is stands


@pytest.mark.parametrize(
    ("share", "exact", "stands"), [(0.36, True, True), (0.36, False, False), (0.2, True, False)]
)
def test_a_law_of_one_form_leaves_nothing_that_a_smaller_share_could_stand_for(share, exact, stands):
    assert replace(FURTHER, share=share, exact=exact, parent_gain=4000.0).stands is stands


@pytest.mark.parametrize(
    ("changed", "stands"),
    [
        ({}, True),
        ({"exact": False}, False),
        ({"share": 0.08}, False),
        ({"votes": 2}, False),
        ({"held_gain": 300.0}, False),
        ({"material": 0.003}, False),
    ],
)
def test_beside_a_law_of_one_form_a_small_effect_stands_where_several_runs_gain_as_foretold(changed, stands):
    beside = replace(FURTHER, exact=True, share=0.12, votes=5, parent_gain=4000.0)
    assert replace(beside, **changed).stands is stands


def test_without_held_out_runs_nothing_is_asked_of_them():
    assert replace(FOUND, held_gain=math.nan, expected_held=math.nan, foretold_held=math.nan, lost=math.nan).stands


def test_a_stop_that_no_held_out_run_reaches_needs_more_in_the_fit_and_must_not_disturb_the_rest():
    away = {"held_gain": -12.0, "lost": 12.0, "foretold_held": 2.0, "expected_held": 1310.0}
    assert not replace(FOUND, gain=5227.0, **away).stands
    assert replace(FOUND, gain=5227.0, unreached=True, **away).stands
    assert not replace(FOUND, gain=150.0, unreached=True, **away).stands
    assert not replace(FOUND, gain=5227.0, unreached=True, **{**away, "lost": 60.0}).stands


def test_a_further_effect_needs_a_share_or_evidence_or_some_of_both():
    some = replace(FURTHER, gain=200.0, held_gain=90.0)  # 15 % of the parent's gain
    assert some.stands
    assert not replace(some, gain=100.0, held_gain=40.0).stands  # 7 %
    assert not replace(some, share=0.1).stands
    assert replace(some, gain=100.0, held_gain=40.0, share=0.5).stands
    assert replace(some, share=0.05, gain=700.0).stands
