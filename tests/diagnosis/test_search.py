"""Searches that start where an effect is: springs that slip by turns, clipped records, orders held while a line is found."""

import json
import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis import rounds, search
from jointscope.diagnosis.acquisition import relogged
from jointscope.diagnosis.answer import diagnosis_json
from jointscope.diagnosis.base import representative
from jointscope.diagnosis.candidates import candidates_for
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.pipeline import diagnose
from jointscope.diagnosis.predict import free_prediction, predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.resolution import PLATEAU, clips
from jointscope.diagnosis.screen import score, tangent
from jointscope.diagnosis.search import with_orders_held
from jointscope.recordings.bandlimited import bandlimited

RATE = -0.09  # 1/s
NOISE = 0.05  # m/s^2


@pytest.fixture(scope="module")
def hits(builders):
    """The maker of eight noisy hits of a lightly damped joint whose stiffness drifts within every ring-down."""

    def made(rate: float, sampling: float):
        K = 2.07e4
        joint = builders.Plant(
            K=K, c=4.9, J_L=1.26, weight=0.0, b_l=0.15,
            extra=lambda t, x: (0.0, K * rate * t * (x[0] - x[2])),
        )  # fmt: skip
        rng = np.random.default_rng(5)
        runs = []
        for k, peak in enumerate((40.0, 80.0, 160.0, 320.0) * 2):
            run = builders.hammer_run(joint, peak, f"h{k}", duration=1.8, rate=sampling)
            force, y = run.streams[0].channels
            noisy = replace(y, samples=y.samples + NOISE * rng.standard_normal(len(y.samples)))
            runs.append(replace(run, streams=(replace(run.streams[0], channels=(force, noisy)),)))
        plate = replace(
            builders.NAMEPLATE, plane="horizontal", stiffness_reference=1.7e4, inertia_reference=1.1, arm_mass=None,
            arm_com_radius=None,
        )  # fmt: skip
        return builders.campaign_of(runs, plate)

    return made


def answered(campaign, effort):
    problem = prepare(campaign)
    with ThreadPoolExecutor(2) as pool:
        found = diagnose(problem, predict_outputs, catalogue(problem), pool, effort=effort)
        return found, diagnosis_json(found, free_prediction)


def test_a_spring_that_slips_by_turns_is_found_from_the_prepared_start(hits, one_effect):
    """By the end the phase is a turn off any fixed stiffness; the base wanders off, the law is named all the same."""
    found, answer = answered(hits(RATE, 1024.0), one_effect)
    assert found.decision.chosen.names == ("stiffness-drift@transmission",)
    assert answer["effects"][0]["parameters"]["rate"]["value"] == pytest.approx(RATE, rel=0.02)
    foretold = {tuple(row["effects"]): row.get("held_out_error") for row in answer["ranking"]}
    assert foretold[found.decision.chosen.names] == pytest.approx(answer["held_out"]["augmented_error"])
    assert foretold[()] == pytest.approx(answer["held_out"]["base_error"])


def test_a_thinned_record_has_its_floor_and_a_null_stays_one(hits):
    """Recorded at 8 kHz and compared at 2: the floor of a perfect model is the noise of the whole record."""
    found, answer = answered(hits(0.0, 8192.0), search.Effort())
    assert found.problem.runs[0].outputs[0].recorded_rate == 8192.0
    assert found.decision.verdict == "none"
    held = json.loads(json.dumps(answer["held_out"]))
    assert held["noise_floor"] == pytest.approx(held["base_error"], rel=0.25)


def test_small_loops_are_tried_too(problem):
    """A ring-down shows a loop of a ten-thousandth of its torque, and at larger ones its phase slips."""
    laws = [s for s in catalogue(problem) if s.name == "hysteresis"]
    smallest = {
        spec.variant: min(a.values[0] for a in candidates_for(problem, [spec])) / problem.scales.torque
        for spec in laws
    }
    assert smallest["dahl"] < 1e-4 and smallest["bouc-wen"] < 1e-4


def test_a_clipped_run_is_always_among_the_few(problem):
    """Saturation shows in one loud run; without it there is nothing to screen."""
    where = next(i for i, run in enumerate(problem.runs) if run.run.experiment == "hammer")
    run = problem.runs[where]
    level = 0.5 * float(np.max(np.abs(run.outputs[0].data)))
    flat = replace(run.outputs[0], data=np.clip(run.outputs[0].data, -level, level))
    assert np.count_nonzero(flat.data == level) + np.count_nonzero(flat.data == -level) >= PLATEAU
    runs = list(problem.runs)
    runs[where] = replace(run, outputs=(flat, *run.outputs[1:]))
    clipped = replace(problem, runs=tuple(runs))
    assert clips(flat) and not clips(run.outputs[0])
    positions = tuple(range(len(runs)))
    assert where in representative(clipped, positions, 1, 1)
    saturation = next(s for s in catalogue(clipped) if s.name == "sensor-saturation")
    assert saturation.scale(clipped)[0] == level


def test_the_few_hold_runs_on_either_side_of_a_payload(problem):
    """Among runs that all carry it, or none, it can't be seen; a weighting that is spread already adds nothing."""
    hit = next(run for run in problem.runs if run.run.experiment == "hammer")
    takes = [replace(hit.outputs[0], data=size * hit.outputs[0].data) for size in np.linspace(1.0, 2.0, 12)]
    many = replace(problem, runs=tuple(replace(hit, outputs=(take, *hit.outputs[1:])) for take in takes))
    positions = tuple(range(12))
    few = representative(many, positions, 2, 1)
    carries = [i for i in positions if i not in few][:4]
    weights = [float(i in carries) for i in positions]
    chosen = representative(many, positions, 2, 1, [weights])
    assert set(few) < set(chosen) and len(set(chosen) & set(carries)) == 2
    assert representative(many, chosen, 12, 1, [weights]) == chosen  # spread already
    assert set(representative(many, few, 2, 1, [weights])) == set(few)  # of the fitted runs only


def test_orders_are_held_only_of_what_is_new(problem):
    line = next(s for s in catalogue(problem) if s.variant == "cogging")
    dry = next(s for s in catalogue(problem) if (s.name, s.location) == ("coulomb-friction", "motor"))
    where = coordinates(problem, (dry, line))
    x = where.pack(where.start, (ActiveEffect(dry, (1.0,)), ActiveEffect(line, (0.5, 6.0, 0.3))))
    held = with_orders_held(where, x, where.n_base + len(dry.parameters))
    fixed = np.flatnonzero(held.lower == held.upper)
    assert [int(i) for i in fixed] == [where.n_base + len(dry.parameters) + 1]
    assert with_orders_held(where, x, where.n) is where


@pytest.mark.parametrize(("kind", "log_rate"), [("averaged", 500.0), ("held", 250.0), ("averaged-held", 250.0)])
def test_a_log_is_undone_alike_before_and_after_it_is_interpolated(kind, log_rate):
    """A filter that does not change in time commutes with band-limited interpolation."""
    rate, fine = 500.0, 3000.0
    t = np.arange(1000) / rate
    u = np.sin(2 * np.pi * (4 * t + 9 * t * t)) * np.hanning(t.size)
    half = np.arange(6 * (t.size - 1) + 1) / fine
    first = bandlimited(relogged(u, rate, rate, log_rate, kind), rate)(half)
    after = relogged(bandlimited(u, rate)(half), fine, rate, log_rate, kind)
    assert np.max(np.abs(first - after)[600:-600]) < 2e-3


@pytest.mark.parametrize(("kind", "age"), [("seen-held", 0.0), ("seen-held", 1.5e-3), ("averaged-held", 0.0)])
def test_a_log_that_repeats_itself_is_put_back_where_it_belongs(kind, age):
    """Of 12 Hz, updates at 125 Hz in a file of 500 Hz: late by a mean of 1.5 samples, by their age, and by half a mean."""
    rate, update, f = 500.0, 125.0, 12.0
    t = np.arange(2000) / rate
    last = np.floor(t * update + 1e-9) / update - age
    logged = np.sin(2 * np.pi * f * last)
    if kind == "averaged-held":  # the mean over 1/update before
        logged = np.sinc(f / update) * np.sin(2 * np.pi * f * (last - 0.5 / update))
    left = (relogged(logged, rate, rate, update, kind, age) - np.sin(2 * np.pi * f * t))[300:-300]
    assert np.sqrt(np.mean(np.square(left))) < 0.03
    assert np.sqrt(np.mean(np.square(logged - np.sin(2 * np.pi * f * t)))) > 0.15


@pytest.mark.parametrize(
    ("with_effect", "held_gain", "kept"),
    [
        ((0.05, 20.0), 0.0, True),
        ((0.4, 9.0), 0.0, False),
        ((0.29, 9.0), 0.0, False),
        ((0.29, 6.0), 0.0, True),
        ((0.31, 7.2), 0.0, False),
        ((0.31, 7.2), 500.0, True),
        ((0.31, 7.2), 200.0, False),
        ((0.4, 9.0), 500.0, False),
    ],
)
def test_an_angle_that_is_lost_with_and_without_is_no_reason(monkeypatch, with_effect, held_gain, kept):
    """Open loop an angle drifts off whatever the model; what counts is what can be foretold, and what runs confirm."""
    assert handed_on(monkeypatch, (0.3, 7.0), with_effect, held_gain) is kept


@pytest.mark.parametrize(
    ("held_gain", "lost", "kept"),
    [
        (500.0, True, True),
        (500.0, False, False),
        (0.0, True, False),
    ],  # seen step by step, and at a phase of its own
)
def test_a_line_at_another_phase_than_foretold_is_refuted_by_runs_that_do_not_show_it_alone(
    monkeypatch, held_gain, lost, kept
):
    assert handed_on(monkeypatch, (0.17, 0.17), (0.25, 0.25), held_gain, lost=lost) is kept


@pytest.mark.parametrize(
    ("unreached", "error", "kept"), [(False, 0.014, False), (True, 0.014, True), (True, 0.03, False)]
)
def test_runs_that_never_reach_an_effect_refute_nothing(monkeypatch, unreached, error, kept):
    assert handed_on(monkeypatch, (0.012, 0.012), (error, error), 0.0, unreached=unreached) is kept


@pytest.mark.parametrize(("twist", "kept"), [((0.1, 0.15), True), ((0.1, 1.01), False), ((0.9, 1.01), True)])
def test_an_effect_that_loses_the_wind_up_is_refuted_whatever_it_does_for_the_rest(monkeypatch, twist, kept):
    """Whatever the runs confirm step by step of the other channels."""
    assert handed_on(monkeypatch, (0.3, 0.7), (0.1, 0.3), 500.0, twist=twist) is kept


def handed_on(
    monkeypatch, of_base, with_effect, held_gain, *, unreached=False, lost=False, twist=(math.nan, math.nan)
):
    """Whether an effect stays: errors of an acceleration and of an angle that drifts off, without and with it."""
    from jointscope.diagnosis import no_worse
    from jointscope.diagnosis.errors import ChannelError

    def errors(problem, free, held, theta, effects, noise):
        acceleration, angle = with_effect if effects else of_base
        return (
            ChannelError("r", "torque-sweep", "linear-acceleration@arm", acceleration, math.nan),
            ChannelError("r", "torque-sweep", "angle@motor", angle, math.nan),
        )

    def judged(names, effects):
        return SimpleNamespace(
            names=names,
            fit=SimpleNamespace(x=None, coordinates=SimpleNamespace(unpack=lambda x: (None, effects))),
            hypothesis=SimpleNamespace(specs=()),
        )

    against = SimpleNamespace(held_gain=held_gain, foretold_held=1000.0, unreached=unreached)
    monkeypatch.setattr(no_worse, "compare", lambda *_: against)
    monkeypatch.setattr(no_worse, "channel_errors", errors)
    monkeypatch.setattr(no_worse, "wind_up_error", lambda problem, held, model: twist[bool(model[1])])
    monkeypatch.setattr(no_worse, "adequacy_of", lambda *_: None)
    monkeypatch.setattr(no_worse, "out_of_phase", lambda *_: lost)
    monkeypatch.setattr(no_worse, "better_somewhere", lambda *_: True)
    monkeypatch.setattr(no_worse, "like_nothing", lambda *_: ())
    monkeypatch.setattr(no_worse, "replace", lambda thing, **new: SimpleNamespace(**{**vars(thing), **new}))
    base, chosen = judged((), ()), judged(("backlash@transmission",), ("gap",))
    decision = SimpleNamespace(
        verdict="effects",
        chosen=chosen,
        ranking=(SimpleNamespace(score=1.0, names=chosen.names),),
        adequacy=SimpleNamespace(explained=math.nan),
    )
    run = SimpleNamespace(motor_moves=True, speed_command=1.0, run=SimpleNamespace(id="r"), outputs=())
    diagnosis = SimpleNamespace(
        decision=decision, split=SimpleNamespace(held_out=(0,)),
        problem=SimpleNamespace(runs=(run,), rig=SimpleNamespace(topology="two-inertia"), base=SimpleNamespace(start=None)),
        judgement=SimpleNamespace(base=base, judged=(base,), noise=None, objective=None),
    )  # fmt: skip
    return no_worse.handed_on(diagnosis, None).decision.verdict == "effects"


def screened(*columns, w):
    """Trials of one law each, as a screening has them, over orthonormal parents."""
    trials = []
    for k, s in enumerate(columns):
        parameter = SimpleNamespace(name="amplitude", null=0.0, lower=-1.0, upper=1.0, log=False)
        spec = SimpleNamespace(
            name=f"law-{k}", location="load", parameters=(parameter,), amplitude=0, proportional=()
        )
        active = SimpleNamespace(spec=spec, values=(0.1,))
        trials.append(score(active, s, tangent(w, np.zeros((len(w), 1)))))
    return trials


def test_what_is_near_the_first_grows_too_but_not_again():
    """Of each name the best law, within 3 % of what the leader gained; what has grown already is left out."""
    laws = {name: SimpleNamespace() for name in ("a", "a2", "a3", "b", "b2", "c")}

    def fitted(name, loss):
        return SimpleNamespace(names=(name[0],), specs=(laws[name],), loss=loss)

    pair = SimpleNamespace(names=("a", "b"), specs=(laws["a"], laws["b"]), loss=-5.0)
    singles = [fitted("a", 0.0), fitted("a2", 1.0), fitted("b", 2.0), fitted("b2", 2.5), fitted("c", 4.0)]
    arena = SimpleNamespace(hypotheses=(pair, *singles), base=SimpleNamespace(loss=100.0))
    assert rounds._to_grow(arena, 2) == [*singles[:2], singles[2]]
    assert rounds._to_grow(arena, 1, [singles[0]]) == [singles[2]]
    assert rounds._to_grow(SimpleNamespace(hypotheses=(), base=arena.base), 3) == []


def test_parents_find_partners_of_their_own():
    """Coulomb's law is a part of Stribeck's: what one of them would be extended by, the other is too."""

    def fitted(loss, *names):
        return SimpleNamespace(names=names, loss=loss)

    stribeck, coulomb = "stribeck-friction@motor", "coulomb-friction@motor"
    first, again = fitted(0.0, stribeck), fitted(1.0, stribeck)
    delay, elsewhere = fitted(9.0, "delay@acquisition"), fitted(10.0, "coulomb-friction@load")
    arena = SimpleNamespace(hypotheses=(first, again, fitted(2.0, coulomb), delay, elsewhere))
    assert rounds._parents(arena, 2) == [first, delay]
    assert rounds._parents(arena, 9) == [first, delay, elsewhere]
    with_both = fitted(3.0, coulomb, "delay@acquisition")
    arena = SimpleNamespace(
        hypotheses=(fitted(2.0, coulomb), with_both, fitted(4.0, "delay@acquisition", stribeck))
    )
    assert rounds._parents(arena, 9) == [arena.hypotheses[0], with_both]


@pytest.mark.parametrize(("apart", "fitted"), [(0.3, [("law-0", "law-1")]), (3.0, [])])
def test_pairs_that_undo_each_other_are_fitted_though_neither_leads(monkeypatch, apart, fitted):
    """A pair that explains a fifth more than its members do alone; not one whose members are found one by one."""
    rng = np.random.default_rng(9)
    common, own, other = rng.standard_normal((3, 400))
    w = 30.0 * own + 20.0 * other / np.linalg.norm(other)
    trials = screened(common + apart * own, common - apart * own, other, w=w)
    asked = []
    monkeypatch.setattr(
        search,
        "fit_child",
        lambda objective, base, actives, effort: asked.append(tuple(a.spec.name for a in actives)),
    )
    monkeypatch.setattr(search, "at_own_size", lambda trial: trial.active)
    screening = search.Screening((trials[2],), tuple(trials), (), None, w, w)
    assert search.fit_pairs(None, None, screening, [], search.Effort(pairs=1)) == []
    assert asked == fitted
