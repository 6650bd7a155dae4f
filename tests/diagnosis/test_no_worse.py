"""What foretells held-out runs worse than the base is not named, by whichever way a joint is diagnosed."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis import no_worse as last_word
from jointscope.diagnosis import pipeline
from jointscope.diagnosis.adjudicate import judge
from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.effects.periodic import SPECS as PERIODIC
from jointscope.diagnosis.errors import ChannelError, held_out_lines, without_drift, without_own_scatter
from jointscope.diagnosis.locate import Places
from jointscope.diagnosis.no_worse import (
    SECOND_CHOICE,
    better_somewhere,
    borne,
    clearly_better,
    explains_little,
    may_follow,
    noise_alone,
    out_of_phase,
    unwound,
)
from jointscope.diagnosis.predict import predict_outputs


@pytest.fixture
def asked(problem, deciding, monkeypatch):
    """The diagnosis of a joint that is the base, where the evidence had named the effects given."""
    silenced = {
        "explore": (None, []), "second_look": [], "remainders": (), "places": Places((), {}, None), "suggest": None, "unseen": (),
    }  # fmt: skip
    for name, result in silenced.items():
        monkeypatch.setattr(pipeline, name, lambda *_, result=result: result)

    def diagnosed(*actives):
        monkeypatch.setattr(pipeline, "answered", lambda judgement: deciding(judgement, *actives))
        with ThreadPoolExecutor(1) as pool:
            return pipeline.diagnose(problem, predict_outputs, (), pool).decision

    return diagnosed


def sized(problem, name, location, factor):
    spec = next(s for s in catalogue(problem) if (s.name, s.location) == (name, location))
    values = list(spec.starts(problem)[0])
    null = spec.parameters[spec.amplitude].null
    values.insert(spec.amplitude, null + factor * spec.scale(problem)[2])
    return ActiveEffect(spec, tuple(values))


@pytest.fixture
def answered(asked, monkeypatch):
    """The same where whatever is named betters something somewhere and is far from nothing."""
    monkeypatch.setattr(last_word, "better_somewhere", lambda *_: True)
    monkeypatch.setattr(last_word, "like_nothing", lambda *_: ())
    return asked


def test_an_effect_that_foretells_worse_is_not_named(problem, answered):
    decision = answered(sized(problem, "coulomb-friction", "load", 2.0))
    assert decision.verdict == "unknown" and decision.unknown_reason == "outside-catalogue"
    assert decision.chosen.names == ()


def test_an_effect_that_is_better_nowhere_is_not_named(problem, asked, monkeypatch):
    """Of no size it foretells no worse, and nothing better: the likelihood alone had named it."""
    nothing = sized(problem, "backlash", "transmission", 0.0)
    monkeypatch.setattr(last_word, "like_nothing", lambda *_: ())
    decision = asked(nothing)
    assert decision.verdict == "none" and decision.chosen.names == ()


def test_one_that_is_not_far_from_nothing_and_all_in_all_no_better_is_not_named(problem, asked, monkeypatch):
    nothing = sized(problem, "backlash", "transmission", 0.0)
    monkeypatch.setattr(last_word, "better_somewhere", lambda *_: True)
    monkeypatch.setattr(last_word, "like_nothing", lambda *_: ())
    assert asked(nothing).verdict == "effects"
    monkeypatch.setattr(last_word, "like_nothing", lambda *_: ("backlash",))
    assert asked(nothing).verdict == "none"


@pytest.mark.parametrize(
    ("told", "apart", "base", "better"),
    [
        ((0.20, 0.099), (math.nan, math.nan), (0.20, 0.10), True),  # one channel of two
        ((0.20, 0.10), (math.nan, math.nan), (0.20, 0.10), False),
        ((0.25, 0.11), (math.nan, math.nan), (0.20, 0.10), False),
        ((0.21, 0.11), (0.05, math.nan), (0.20, 0.10), True),  # once the hit's own gain is taken off
        (
            (2.5, 1.8),
            (math.nan, math.nan),
            (2.1, 1.6),
            True,
        ),  # nothing can be told by runs that the base is lost in
    ],
)
def test_better_in_one_channel_of_one_experiment_is_shown(told, apart, base, better):
    def errors(values, own):
        channels = ("linear-acceleration@arm", "angle@arm")
        return [
            ChannelError("r", "hammer", channel, value, 0.01, x)
            for channel, value, x in zip(channels, values, own, strict=True)
        ]

    own = tuple(b if math.isfinite(a) else math.nan for a, b in zip(apart, base, strict=True))
    assert better_somewhere(errors(told, apart), errors(base, own)) is better


def test_one_that_foretells_no_worse_stays_and_follows_one_that_does(problem, answered):
    worse = sized(problem, "coulomb-friction", "load", 2.0)
    no_worse = sized(problem, "backlash", "transmission", 0.0)
    assert answered(no_worse).chosen.names == ("backlash@transmission",)
    second = answered(worse, no_worse)
    assert second.verdict == "effects" and second.chosen.names == ("backlash@transmission",)
    assert second.probability == pytest.approx(SECOND_CHOICE)


def test_where_three_lead_no_other_two_are_a_second_choice(problem, deciding, answered, monkeypatch):
    """Which two of three foretell a run better is chance; the three are in the ranking with no belief."""
    worse, no_worse = (
        sized(problem, *effect)
        for effect in (("coulomb-friction", "load", 2.0), ("backlash", "transmission", 0.0))
    )
    assert answered(worse, no_worse).verdict == "effects"

    def of_three(judgement):
        decision = deciding(judgement, worse, no_worse)
        top = decision.ranking[0]
        three = replace(top, names=(*top.names, "b@load", "c@load"), probability=0.0, score=2.0 * top.score + 1.0)
        return replace(decision, ranking=(*decision.ranking, three))

    monkeypatch.setattr(pipeline, "answered", of_three)
    with ThreadPoolExecutor(1) as pool:
        assert pipeline.diagnose(problem, predict_outputs, (), pool).decision.verdict == "unknown"


def test_physics_outside_the_table_is_no_second_choice(problem, answered, monkeypatch):
    monkeypatch.setattr(
        "jointscope.diagnosis.no_worse.resembled",
        lambda judged: object() if judged.names == ("backlash@transmission",) else None,
    )
    worse, stranger = (
        sized(problem, *effect)
        for effect in (("coulomb-friction", "load", 2.0), ("backlash", "transmission", 0.0))
    )
    assert answered(worse, stranger).verdict == "unknown"


def test_another_fit_of_the_same_effect_that_foretells_no_worse_is_handed_on(
    problem, deciding, answered, monkeypatch
):
    """Open loop a run may end in another place by nearly nothing; the name is not to blame."""
    worse, mild = (sized(problem, "coulomb-friction", "load", factor) for factor in (2.0, 0.0))

    def both(*given):
        judgement = judge(*given)
        return replace(judgement, judged=(*judgement.judged, deciding(judgement, mild).chosen))

    monkeypatch.setattr(pipeline, "judge", both)
    monkeypatch.setattr("jointscope.diagnosis.no_worse.score", lambda judgement, judged: 100.0)
    decision = answered(worse)
    assert decision.verdict == "effects" and decision.chosen.names == ("coulomb-friction@load",)
    assert decision.chosen.fit.coordinates.unpack(decision.chosen.fit.x)[1][0].values[0] == mild.values[0]
    scores = iter([100.0, 90.0])
    monkeypatch.setattr("jointscope.diagnosis.no_worse.score", lambda judgement, judged: next(scores, 0.0))
    assert answered(worse).verdict == "unknown"  # where it explains much less it is no fit of the same


def test_a_second_choice_is_given_where_no_probability_is_left_for_any(problem, deciding, answered, monkeypatch):
    """Millions of nats behind, all that follow have the probability 0."""
    worse = sized(problem, "coulomb-friction", "load", 2.0)
    no_worse = sized(problem, "backlash", "transmission", 0.0)
    answered(worse, no_worse)

    def certain(judgement):
        decision = deciding(judgement, worse, no_worse)
        first, second = decision.ranking
        return replace(decision, ranking=(replace(first, probability=1.0), replace(second, probability=0.0)))

    monkeypatch.setattr(pipeline, "answered", certain)
    with ThreadPoolExecutor(1) as pool:
        second = pipeline.diagnose(problem, predict_outputs, (), pool).decision
    assert second.chosen.names == ("backlash@transmission",)
    assert second.probability == pytest.approx(SECOND_CHOICE)


@pytest.mark.parametrize(
    ("error", "floor", "better"),
    [
        (0.080, 0.0, True),
        (0.095, 0.0, False),  # five per cent less
        (0.095, 0.09, False),  # noise leaves 0.09 whatever the model: 0.030 of 0.044 are left beyond it
        (0.092, 0.09, True),  # nearly all that could be gained
        (0.080, math.nan, True),
        (0.095, math.nan, False),
    ],
)
def test_what_is_clearly_better(error, floor, better):
    """Against a base of 0.1: a tenth less, or two fifths less of what is left beyond the noise."""
    named, base = ([ChannelError("r", "torque-sweep", "linear-acceleration@arm", e, floor)] for e in (error, 0.1))
    assert clearly_better(named, base) is better


@pytest.mark.parametrize(
    ("whole", "error", "sure", "stays"),
    [
        (1.04, 0.101, True, True), (1.04, 0.101, False, False), (1.04, 0.099, False, True), (1.4, 0.101, True, False),
        (1.4, 0.099, True, True), (1.4, 0.099, False, False), (1.4, 0.05, False, True),
    ],
)  # fmt: skip
def test_a_confirmed_effect_bears_what_angles_do_that_drift_off(whole, error, sure, stays):
    """Evidence on held-out runs and errors no worse where the model decides; either alone bears 5 % in all."""
    told, base = ([ChannelError("a", "torque-sweep", "acceleration@arm", e, 0.0)] for e in (error, 0.1))
    assert borne(whole, told, base, sure) is stays


@pytest.mark.parametrize(("error", "named"), [(0.1005, True), (0.0950, True), (0.1025, False)])
def test_a_second_choice_bears_nothing(error, named):
    """2.5 % worse is borne where held-out runs confirm the likeliest effect, not where that was refuted."""
    told, base = ([ChannelError("a", "speed-motion", "acceleration@arm", e, 0.0)] for e in (error, 0.1))
    assert borne(error / 0.1, told, base, sure=True)
    assert may_follow(told, base) is named


@pytest.mark.parametrize(("gain", "left"), [(0.02, 0.0), (-0.02, 0.0), (0.2, 0.17)])
def test_a_hit_is_told_apart_from_its_own_gain_and_time(gain, left):
    """A gain of 2 % and 20 us are scatter and taken off; of a gain of 20 % three standard deviations are."""
    rate, t = 2000.0, np.arange(1500) / 2000.0
    ringing = lambda time: np.exp(-9.0 * time) * np.sin(190.0 * time)  # noqa: E731
    recorded = (1.0 + gain) * ringing(t + (2e-5 if left == 0.0 else 0.0))
    noise = SimpleNamespace(gain=0.01, timing=2e-5)
    own = without_own_scatter(recorded, ringing(t), t > 0.01, rate, noise)
    error = np.sqrt(np.mean((recorded - own)[t > 0.01] ** 2) / np.mean(ringing(t)[t > 0.01] ** 2))
    assert error == pytest.approx(left, abs=1e-3)


def test_angles_that_drift_off_open_loop_are_left_out(problem):
    """Of a sweep the angle, and nothing of a hit or of an accelerometer."""
    sweep = next(run.run for run in problem.runs if run.motor_moves and run.speed_command is None)
    hit = next(run.run for run in problem.runs if not run.motor_moves)
    drifting = ChannelError(sweep.id, sweep.experiment, "angle@motor", 40.0, 0.01)
    told = [
        ChannelError(sweep.id, sweep.experiment, "linear-acceleration@arm", 0.1, 0.01),
        ChannelError(hit.id, hit.experiment, "angle@arm", 0.2, 0.01),
    ]
    assert without_drift(problem, [drifting, *told]) == told
    figures = {"base": 40.1, "augmented": 40.1, "noise_floor": 0.01}
    held = {"runs": ["a"], **{f"{k}_error" if k != "noise_floor" else k: v for k, v in figures.items()}}
    assert len(held_out_lines(held)) == 1
    both = {**held, "without_drift": {**figures, "base": 0.15}, "wind_up_error": {"base": 0.3, "augmented": None}}
    lines = held_out_lines(both)
    assert "0.1500 and 40.1000" in lines[1] and "0.3000 and not known" in lines[2]


@pytest.mark.parametrize(
    ("explained", "told", "base", "little"),
    [
        (0.84, 0.167, 0.214, True),  # a mass that rattles, as play: most of it stays
        (0.99, 0.167, 0.214, False),  # the fitted runs say that it is what was left out
        (0.84, 0.10, 0.214, False),  # most of it is gone
        (0.84, 0.07, 0.075, False),  # next to nothing is left beyond the noise
        (math.nan, 0.167, 0.214, False),  # no share is known
    ],
)
def test_what_explains_little_is_no_answer(explained, told, base, little):
    def errors(value):
        return [ChannelError("r", "hammer", "linear-acceleration@arm", value, 0.06)]

    assert explains_little(explained, errors(told), errors(base)) is little


@pytest.mark.parametrize(
    ("errors", "alone"), [((0.011, 0.013), True), ((0.011, 0.02), False), ((0.011, math.nan), True)]
)
def test_what_is_foretold_to_within_its_noise_leaves_nothing_to_explain(errors, alone):
    """A channel that is silent says nothing of it, nor does one whose noise is not known."""
    told = [ChannelError("a", "speed-motion", f"acceleration@{k}", e, 0.0123) for k, e in enumerate(errors)]
    assert noise_alone(told) is alone
    assert noise_alone([*told, ChannelError("a", "speed-motion", "angle@motor", 0.5, math.nan)]) is alone
    assert not noise_alone([ChannelError("a", "speed-motion", "angle@motor", 0.001, math.nan)])


@pytest.mark.parametrize(
    ("order", "unit", "off", "lost"),
    [
        (6.0, "per motor turn", 0.3, True),  # 1.8 rad of the line's own
        (6.0, "per motor turn", 0.05, False),
        (1.0, "per motor turn", 0.3, False),
        (120.0, "per output turn", 0.3, False),  # of a reducer of 60 that is twice a motor turn
        (600.0, "per output turn", 0.3, True),
    ],
)
def test_a_line_is_out_of_phase_where_the_motor_is_elsewhere_by_much_of_its_period(order, unit, off, lost):
    spec = next(s for s in PERIODIC if s.parameters[1].unit == unit)
    effect = ActiveEffect(spec, (1e-4, order, 0.3))
    angle, times, fine = (np.linspace(0.0, top, n) for top, n in ((40.0, 200), (2.0, 200), (2.0, 500)))
    ones = np.ones(200, dtype=bool)
    output = SimpleNamespace(quantity="angle", location="motor", data=angle, mask=ones, times=times)
    arm, motor = (SimpleNamespace(quantity="angle", location=place, times=fine) for place in ("arm", "motor"))
    problem = SimpleNamespace(runs=(SimpleNamespace(outputs=(output,), declared=(arm, motor), ratio=60.0),))

    def judged(*effects):
        where = SimpleNamespace(unpack=lambda x: (None, effects))
        return SimpleNamespace(fit=SimpleNamespace(coordinates=where, x=None))

    def free(run, theta, effects, problem):
        """The arm's angle, of which no line is told, and the motor's, ahead by ``off`` rms, at their streams' own rate."""
        return np.zeros(500), np.interp(fine, times, angle) + math.sqrt(1.5) * off * np.minimum(fine, 1.0)

    assert out_of_phase(problem, free, (0,), judged(effect)) is lost
    assert not out_of_phase(problem, free, (0,), judged())
    resting = replace_angle(problem, np.zeros(200))
    assert not out_of_phase(resting, free, (0,), judged(effect))


def replace_angle(problem, angle):
    run = problem.runs[0]
    output = SimpleNamespace(**{**vars(run.outputs[0]), "data": angle})
    return SimpleNamespace(runs=(SimpleNamespace(outputs=(output,), declared=run.declared, ratio=60.0),))


@pytest.mark.parametrize(("topology", "spring", "commanded", "law", "drifts"), [
    ("single-dof", False, True, 0.0, True),  # a drive of which the law is not known
    ("single-dof", False, True, 30.0, False),
    ("single-dof", False, False, 30.0, True),
    ("single-dof", True, True, 0.0, False),
    ("two-inertia", True, True, 0.0, False),
    ("two-inertia", True, False, 0.0, True),
])  # fmt: skip
def test_an_angle_drifts_off_where_no_loop_of_a_drive_holds_it(topology, spring, commanded, law, drifts):
    run = SimpleNamespace(
        run=SimpleNamespace(id="r"), spring=spring, motor_moves=topology == "two-inertia",
        speed_command=object() if commanded else None, motor=object(), mode="observer",
    )  # fmt: skip
    start = np.zeros(len(BASE_INDEX))
    start[BASE_INDEX["drive_gain"]] = law
    base = SimpleNamespace(start=start)
    problem = SimpleNamespace(rig=SimpleNamespace(topology=topology), runs=(run,), base=base)
    told = [ChannelError("r", "speed-motion", "linear-acceleration@arm", 0.1, 0.01)]
    angle = ChannelError("r", "speed-motion", "angle@arm", 2.0, 0.01)
    assert without_drift(problem, [angle, *told]) == (told if drifts else [angle, *told])


@pytest.mark.parametrize(
    ("own", "of_base", "lost"),
    [
        (1.01, 0.10, True),  # a robot's axis: friction and a lag bettered its angle and lost its wind-up
        (0.25, 0.72, False),  # play found
        (0.28, 0.02, False),  # off, and small
        (0.90, 0.60, False),  # the base foretells no more of it
        (float("nan"), float("nan"), False),  # one encoder
    ],
)
def test_a_model_that_loses_the_wind_up_that_the_base_foretells_is_none(own, of_base, lost):
    assert unwound(own, of_base) is lost
