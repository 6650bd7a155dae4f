"""What could not have been seen: monotone in size and noise, silent on what the channels forbid, in lab units."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.adjudicate import judge
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.energies import kind_of
from jointscope.diagnosis.power import Unseen, unseen, unseen_json, values_at
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.split import split_runs
from jointscope.diagnosis.visibility import Seen, clearance, seen, yard_of


@pytest.fixture(scope="module")
def judged(problem, recorded):
    found = {}
    with ThreadPoolExecutor(1) as pool:
        for share in (0.01, 0.5):
            own = recorded(problem, share)
            stage = refit_base(own, predict_outputs, tuple(range(len(own.runs))), pool)
            found[share] = (own, judge(stage, (), split_runs(own).held_out))
        yield found


def spec_of(problem, name, location):
    return next(s for s in catalogue(problem) if (s.name, s.location) == (name, location))


def test_visibility_grows_with_size_and_vanishes_with_it(judged):
    problem, judgement = judged[0.01]
    yard = yard_of(judgement, judgement.base)
    spec = spec_of(problem, "backlash", "transmission")
    small, medium, large = (seen(yard, ActiveEffect(spec, (v,))) for v in spec.scale(problem))
    for attribute in ("z", "z_held", "shown"):
        assert getattr(small, attribute) < getattr(medium, attribute) < getattr(large, attribute)
    nothing = seen(yard, ActiveEffect(spec, (0.0,)))
    assert nothing.z < 0.4 and nothing.z_held < 0.4 and nothing.shown < 0.05


def test_more_noise_hides_more(problem, recorded):
    """Hits without an angle, whose own noise is another: the same size stands out less, and a larger one is needed."""
    hits = replace(problem, runs=tuple(run for run in problem.runs if run.mode == "braked"))
    specs = [spec_of(problem, "coulomb-friction", "load"), spec_of(problem, "backlash", "transmission")]
    found = {}
    with ThreadPoolExecutor(1) as pool:
        for share in (0.01, 0.1):
            own = recorded(hits, share)
            stage = refit_base(own, predict_outputs, tuple(range(len(own.runs))), pool)
            judgement = judge(stage, (), split_runs(own).held_out)
            yard = yard_of(judgement, judgement.base)
            shown = [seen(yard, ActiveEffect(spec, (spec.scale(own)[1],))).z for spec in specs]
            found[share] = list(zip(shown, unseen(own, judgement, judgement.base, specs, pool), strict=True))
    for (clear, quiet), (hidden, loud) in zip(found[0.01], found[0.1], strict=True):
        assert hidden < 0.5 * clear
        assert quiet.size is not None and loud.size is not None
        assert loud.size > (1.1 if quiet.limited_by == loud.limited_by == "noise" else 0.5) * quiet.size


def test_the_stated_size_stands_at_the_gate(judged):
    problem, judgement = judged[0.5]
    spec = spec_of(
        problem, "quadratic-damping", "load"
    )  # smooth: friction of nothing is integrated in other steps
    with ThreadPoolExecutor(1) as pool:
        (found,) = unseen(problem, judgement, judgement.base, [spec], pool)
    yard = yard_of(judgement, judgement.base)
    clear, limit = clearance(yard, spec, seen(yard, ActiveEffect(spec, (found.size,))))
    assert clear == pytest.approx(1.0, rel=0.3) and limit == found.limited_by


def test_every_gate_counts(judged):
    """Held-out runs that show nothing, an order picked out of many, an echo that is louder: each takes more to be seen."""
    problem, judgement = judged[0.01]
    yard = yard_of(judgement, judgement.base)
    friction, ripple = spec_of(problem, "coulomb-friction", "load"), spec_of(problem, "torque-ripple", "motor")
    clear = Seen(z=15.0, z_held=8.0, shown=5.0)
    assert clearance(yard, friction, clear)[0] > 1.0
    assert clearance(yard, friction, replace(clear, z_held=0.1)) == (pytest.approx(0.6, abs=0.2), "noise")
    assert clearance(yard, friction, replace(clear, shown=0.1, z=12.0))[1] == "materiality"
    assert clearance(yard, ripple, clear)[0] < clearance(yard, friction, clear)[0]
    active = ActiveEffect(friction, (friction.scale(problem)[1],))
    loud = {kind_of(run, output): 1e9 for run in problem.runs for output in run.outputs}
    drowned = replace(yard, echo=loud, echo_nats={kind[0]: 1e12 for kind in loud})
    assert seen(drowned, active).z < 0.1 * seen(yard, active).z


def test_what_the_channels_forbid_has_a_reason_and_no_size(problem, judged):
    own, judgement = judged[0.5]
    hits = tuple(run for run in own.runs if run.mode == "braked")
    hammer_only = replace(own, runs=hits)
    spec = spec_of(hammer_only, "coulomb-friction", "motor")
    with ThreadPoolExecutor(1) as pool:
        (found,) = unseen(hammer_only, judgement, judgement.base, [spec], pool)
    assert found.size is None and found.reason is not None
    (as_json,) = unseen_json((found,))
    assert "cannot be seen here" in as_json["sentence"]


def test_a_breakaway_torque_goes_with_its_friction(problem):
    spec = spec_of(problem, "stribeck-friction", "load")
    shape = spec.starts(problem)[1]
    one, two = (values_at(spec, shape, k * spec.scale(problem)[1], problem) for k in (1.0, 2.0))
    assert two[1] == pytest.approx(2.0 * one[1]) and two[2] == pytest.approx(one[2])


@pytest.mark.parametrize(
    ("effect", "location", "parameter", "unit", "size", "told"),
    [
        ("backlash", "transmission", "gap", "rad", 0.2 / 60 * np.pi / 180, "gap below 0.2 arcmin"),
        ("delay", "acquisition", "delay", "s", 3e-4, "delay below 0.3 ms"),
        ("sensor-gain", "acquisition", "gain", "1", 1.02, "less than 2 % off"),
        ("sensor-saturation", "acquisition", "level", "m/s^2", 40.0, "level above 40 m/s^2"),
    ],
)
def test_sentences_are_in_the_labs_units(effect, location, parameter, unit, size, told):
    found = Unseen(effect, location, "law", parameter, unit, size, {}, "noise", None)
    assert told in found.sentence and found.sentence.endswith("can't be seen here")
