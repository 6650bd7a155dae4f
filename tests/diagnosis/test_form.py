"""A second effect with little of the evidence: none of the first one's forms, or one of them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.effects import PAYLOADS, ActiveEffect, catalogue, with_run_weights
from jointscope.diagnosis.form import own_share
from jointscope.diagnosis.gates import Comparison
from jointscope.diagnosis.search import Hypothesis, names_of

NOISE = 2e-3  # of each channel's rms


def law(problem, name, location, variant=None):
    return next(
        s
        for s in catalogue(problem)
        if s.name == name and s.location == location and s.variant in (variant or s.variant,)
    )


def at_size(spec, problem, size):
    return ActiveEffect(spec, (spec.scale(problem)[size], *spec.starts(problem)[0]))


@pytest.fixture
def asked(problem, recorded, fitted):
    """own_share of ``second`` beside ``first``, both in the data, the parent at the first one's true size."""

    def ask(first, second):
        data = recorded(problem, NOISE, effects=(first, second))
        objective, at = fitted(data, first, second)

        def judged(*actives):
            fit = replace(
                at(data.base.start, *actives), jacobian=np.zeros((0, 0))
            )  # of other runs: not to be used
            specs = tuple(a.spec for a in actives)
            return SimpleNamespace(fit=fit, names=names_of(specs), hypothesis=Hypothesis(specs, fit, 0.0))

        return own_share(SimpleNamespace(objective=objective), judged(first), judged(first, second))

    return ask


def test_a_mode_beside_a_clipped_record_is_no_form_of_clipping(problem, asked):
    clip = ActiveEffect(
        law(problem, "sensor-saturation", "acquisition", "clip"), (0.4 * problem.scales.acceleration,)
    )
    mode = ActiveEffect(law(problem, "neighbour-flexibility", "neighbour", "absorber"), (61.0, 0.01, 0.01))
    assert asked(clip, mode) > 0.6


def test_a_late_log_beside_a_sensor_that_bends_is_no_form_of_bending(problem, asked):
    """A curve of each sample by itself has no form that lags, though a sensor's other laws do."""
    bends = law(problem, "sensor-saturation", "acquisition", "compressing")
    late = law(problem, "delay", "acquisition", "constant")
    assert asked(ActiveEffect(bends, (2.0 * problem.scales.acceleration, 2.0)), ActiveEffect(late, (3e-4,))) > 0.6


def test_a_late_log_beside_a_ringing_sensor_may_be_its_own_form(problem, asked):
    rings = law(problem, "sensor-resonance", "acquisition", "bandwidth")
    late = law(problem, "delay", "acquisition", "constant")
    assert asked(ActiveEffect(rings, (300.0,)), ActiveEffect(late, (3e-4,))) < 0.6


def test_rounded_friction_where_friction_is_even_is_a_form_of_it(problem, asked):
    """What another law of the first one's own name does from its own numbers is nobody else's doing."""
    friction = at_size(law(problem, "coulomb-friction", "load", "plain"), problem, 1)
    loop = at_size(law(problem, "hysteresis", "transmission", "dahl"), problem, 0)
    assert asked(friction, loop) < 0.6


def test_drag_beside_friction_at_the_same_place_may_be_the_frictions_own_form(problem, asked):
    friction = at_size(law(problem, "coulomb-friction", "load", "plain"), problem, 1)
    assert asked(friction, at_size(law(problem, "quadratic-damping", "load"), problem, 0)) < 0.2


def test_drag_beside_a_payload_is_no_form_of_the_payload(problem, asked):
    """A mass is a mass: nature knows it in one form only, so what it leaves is something else."""
    half = tuple(float(i % 2) for i in range(len(problem.runs)))
    payload = at_size(with_run_weights(PAYLOADS[0], half, problem), problem, 1)
    assert asked(payload, at_size(law(problem, "quadratic-damping", "load"), problem, 0)) > 0.6


def test_a_hardening_beside_play_may_be_the_plays_own_form(problem, asked):
    play = at_size(law(problem, "backlash", "transmission", "free-flight"), problem, 0)
    assert asked(play, at_size(law(problem, "stiffness-nonlinearity", "transmission", "cubic"), problem, 0)) < 0.4


SECOND = Comparison(
    gain=260.0, held_gain=200.0, expected_held=90.0, foretold_held=203.0, share_of_runs=1.0, lost=0.0, material=0.01,
    share=0.03, parents=1, parent_gain=460_000.0,
)  # fmt: skip


def test_a_second_effect_with_little_of_the_evidence_is_asked():
    assert SECOND.beside and not SECOND.stands


@pytest.mark.parametrize(
    "changed",
    [
        {"gain": 50.0},
        {"held_gain": 100.0},
        {"held_gain": 400.0},
        {"share_of_runs": 0.5},
        {"material": 0.003},
        {"parents": 2},
        {"parents": 0},
        {"lost": 90.0},
        {"held_gain": float("nan")},
    ],
)
def test_but_not_where_anything_is_missing(changed):
    assert not replace(SECOND, **changed).beside
