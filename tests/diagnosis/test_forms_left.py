"""A further effect is no form of the first where it explains many times what the first one's best forms differ by."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.forms_left import beyond_forms, spread_of_forms
from jointscope.diagnosis.gates import Comparison

SECOND = Comparison(
    gain=90.0, held_gain=45.0, expected_held=45.0, foretold_held=45.0, share_of_runs=1.0, lost=0.0, material=0.01,
    share=0.1, parents=1, parent_gain=5000.0, votes=5,
)  # fmt: skip
PARENT = SimpleNamespace(names=("backlash@transmission",))


def fitted(behind, *variants, name="backlash", place="transmission"):
    """A hypothesis of ``name`` that is ``behind`` the best one [nats], half of it in the held-out runs."""
    specs = tuple(SimpleNamespace(name=name, location=place, variant=v) for v in variants)
    return SimpleNamespace(
        names=(f"{name}@{place}",), hypothesis=SimpleNamespace(specs=specs), chi2=1000.0 + behind,
        held_out=np.array([200.0, 300.0 + behind]), occam=5.0, occam_held=0.0,
    )  # fmt: skip


def of_laws(*behind):
    return [fitted(b, f"law {k}") for k, b in enumerate(behind)]


@pytest.mark.parametrize(
    ("behind", "spread"),
    [((0.0,), None), ((0.0, 7.0), None), ((0.0, 7.0, 30.0, 900.0), 30.0)],
)
def test_the_spread_is_that_of_the_best_three(behind, spread):
    assert spread_of_forms(of_laws(*behind), PARENT.names) == spread


def test_the_same_law_from_another_start_is_no_other_form():
    again = [fitted(0.0, "damped"), fitted(2.0, "damped"), fitted(3.0, "sheds")]
    assert spread_of_forms(again, PARENT.names) is None


def test_laws_of_another_name_are_no_forms_of_it():
    judged = [*of_laws(0.0, 7.0, 9.0), fitted(0.5, "smooth", name="stiffness-nonlinearity")]
    assert spread_of_forms(judged, PARENT.names) == 9.0


@pytest.mark.parametrize(
    ("behind", "believed"),
    [
        ((0.0, 2.0, 20.0), True),  # 135 nats beside forms that differ by 20
        ((0.0, 2.0, 60.0), False),  # by 60: another form might do as much
        ((0.0, 0.0), False),  # of two laws one may hold the other
    ],
)
def test_what_is_added_must_be_many_times_that(behind, believed):
    assert beyond_forms(of_laws(*behind), PARENT, SECOND) is believed


@pytest.mark.parametrize(
    "changed", [{"votes": 2}, {"share_of_runs": 0.6}, {"held_gain": 25.0}, {"held_gain": 90.0}, {"gain": -20.0}]
)
def test_several_held_out_runs_must_gain_what_was_foretold(changed):
    assert not beyond_forms(of_laws(0.0, 2.0, 20.0), PARENT, replace(SECOND, **changed))
