"""What is tried next to a leading set: slower lines, the same mode under another name, runs sorted in two."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis import rivals
from jointscope.diagnosis.candidates import candidates_for
from jointscope.diagnosis.coordinates import coordinates
from jointscope.diagnosis.effects import ActiveEffect, at_rig, catalogue
from jointscope.diagnosis.effects.friction import falling_about
from jointscope.diagnosis.effects.modes import INBOARD
from jointscope.diagnosis.effects.periodic import harmonics, slower_lines
from jointscope.diagnosis.lent import same_numbers
from jointscope.diagnosis.noise import white
from jointscope.diagnosis.objective import Objective, whitened
from jointscope.diagnosis.per_run import loaded, two_groups
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.refit import Fit
from jointscope.diagnosis.rivals import _elsewhere, _freer, contained, grown
from jointscope.diagnosis.search import Effort, Hypothesis, profile_loss
from jointscope.diagnosis.twins import (
    BETWEEN,
    MOST,
    SLOWEST,
    foreknown,
    on_the_other_side,
    told_by_frequency,
    twins,
)


def law(problem, name, variant, location=None):
    return next(
        s for s in catalogue(problem)
        if s.name == name and s.variant == variant and location in (None, s.location)
    )  # fmt: skip


@pytest.mark.parametrize(("k", "order"), [(2, 2.0), (3, 3.03), (3, 6.0)])
def test_a_line_is_a_harmonic_of_a_slower_one(k, order):
    """Of each slower line the k-th harmonic is the line itself, at every angle."""
    angle = np.linspace(0.0, 12.0, 301)
    found = slower_lines((1e-5, order, 0.7, 0.0, 0.0, 0.0, 0.0), k)
    assert found
    for slower in found:
        first, *further = harmonics(slower)
        assert first[:2] == pytest.approx((1e-5, order / k))
        total = sum(a * np.sin(n * angle + p) for a, n, p in further)
        np.testing.assert_allclose(total, 1e-5 * np.sin(order * angle + 0.7), atol=1e-12)


@pytest.mark.parametrize(("k", "order"), [(2, 3.0), (3, 2.0), (2, 1.0)])
def test_no_line_makes_part_of_a_period_in_a_turn(k, order):
    assert slower_lines((1e-5, order, 0.7, 0.0, 0.0, 0.0, 0.0), k) == ()


def test_a_mode_beyond_the_sensors_moves_alike_under_both_names(problem, truth):
    neighbour = ActiveEffect(law(problem, "neighbour-flexibility", "absorber"), (90.0, 0.1, 0.02))
    inertia = 0.1 * truth[problem.base.names.index("load_inertia")]
    arm = ActiveEffect(at_rig(INBOARD, problem), (90.0, inertia, 0.02))
    for run in problem.runs:
        for a, b in zip(
            predict_outputs(run, truth, (neighbour,), problem), predict_outputs(run, truth, (arm,), problem),
            strict=True,
        ):  # fmt: skip
            np.testing.assert_allclose(a, b, rtol=1e-6, atol=1e-9 * np.abs(a).max())


def test_its_frequency_says_whose_it_is(problem):
    """Even at 60 Hz; more than e^4 to one is never known beforehand; what is no mode is left alone."""
    arm, neighbour = at_rig(INBOARD, problem), law(problem, "neighbour-flexibility", "absorber")

    def lead(frequency):
        return foreknown((ActiveEffect(arm, (frequency, 0.1, 0.02)),)) - foreknown(
            (ActiveEffect(neighbour, (frequency, 0.1, 0.02)),)
        )

    assert lead(BETWEEN) == pytest.approx(0.0, abs=1e-12)
    assert lead(30.0) == pytest.approx(-lead(120.0)) and lead(120.0) == MOST
    assert foreknown((ActiveEffect(law(problem, "backlash", "free-flight"), (1e-4,)),)) == 0.0


@pytest.fixture
def fitted(problem, truth):
    """The maker of a hypothesis at the truth, with the Jacobian of whitened residuals over two runs."""

    def made(*effects):
        where = coordinates(problem, tuple(e.spec for e in effects))
        x = where.pack(truth, effects)
        runs = (0, len(problem.runs) - 1)
        with ThreadPoolExecutor(1) as pool:
            objective = Objective(problem, predict_outputs, runs, pool)
            objective = whitened(objective, white(problem.runs), objective.predictions(truth, effects))
            w = objective.residual(x, where)
            jacobian = objective.columns(x, where, w, range(where.n))
        return Hypothesis(where.effects, Fit(where, x, w, jacobian, 0.0, True, True, 1), 0.0)

    return made


def test_only_modes_that_neither_hammer_nor_sensor_rides_on_have_twins(problem, fitted):
    alone = fitted(ActiveEffect(law(problem, "base-compliance", "turning-mount"), (40.0, 0.1, 0.02)))
    assert twins(problem, [alone]) == []


def test_a_twin_is_the_same_fit_in_the_parameters_of_its_name(problem, fitted):
    """Residual, base and frequency stay; the Jacobian is that of the arm's own parameters, by the chain rule."""
    neighbour = ActiveEffect(law(problem, "neighbour-flexibility", "absorber"), (60.0, 0.1, 0.02))
    drag = ActiveEffect(law(problem, "quadratic-damping", "drag"), (0.05,))
    one = fitted(drag, neighbour)
    (twin,) = twins(problem, [one])
    assert twin.names == ("link-flexibility@load", "quadratic-damping@load")
    theta, effects = twin.fit.coordinates.unpack(twin.fit.x)
    assert effects[1].values[1] == pytest.approx(0.1 * theta[problem.base.names.index("load_inertia")])
    np.testing.assert_array_equal(twin.fit.w, one.fit.w)
    direct = fitted(*effects).fit.jacobian
    size = np.linalg.norm(direct, axis=0)
    np.testing.assert_allclose(np.linalg.norm(twin.fit.jacobian - direct, axis=0), 0.0, atol=0.02 * size.max())
    assert np.all(np.linalg.norm(twin.fit.jacobian - direct, axis=0) < 0.02 * size + 1e-9)


def test_the_reader_is_told_what_alone_tells_two_owners_apart():
    assert "frequency alone" in told_by_frequency("inboard") == told_by_frequency("absorber")
    assert told_by_frequency("one-shape") == told_by_frequency("turning-mount") == ""


def test_runs_that_tell_little_do_not_hide_two_groups():
    """Six hits of one inertia, four of another; motions whose own inertia is known to a tenth at best."""
    rng = np.random.default_rng(1)
    errors = np.array([1e-3] * 10 + [0.1] * 5)
    values = np.array([0.0] * 6 + [-0.02] * 4 + [0.0] * 5) + errors * rng.standard_normal(15)
    members = two_groups(values, errors)
    assert members is not None
    assert members[:6].all() and not members[6:].any()


def test_groups_of_one_experiment_sort_the_others():
    """A motion whose own weight is wrong, and sweeps in between, hide what the hits show: two groups."""
    light = [-20.5, -18.7, -14.6, -14.4, -11.7]
    heavy = [0.5, 2.5, 3.2, 5.1, 5.2, 6.1, 6.3, 7.0, 7.0, 7.9, 8.2]
    inertia = 1e-3 * np.array([*light, *heavy, -6.75, -6.65, -6.04, -4.31, -50.8])
    errors = 1e-3 * np.array(
        [3.8, 1.5, 0.8, 1.4, 1.8, 3.4, 3.0, 2.1, 0.7, 1.6, 0.6, 0.9, 1.1, 1.4, 2.5, 0.9, 0.9, 0.4, 0.6, 1.3, 3.5]
    )
    kinds = ["hammer"] * 16 + ["torque-sweep"] * 4 + ["speed-motion"]
    runs = tuple(SimpleNamespace(run=SimpleNamespace(experiment=kind)) for kind in kinds)
    assert two_groups(inertia, errors) is None
    found = loaded(SimpleNamespace(runs=runs), inertia, errors)
    assert found is not None
    assert found.step == pytest.approx(0.021, abs=0.002)
    np.testing.assert_array_equal(found.members[:16], [False] * 5 + [True] * 11)
    assert not found.members[-1]


def test_hits_that_part_where_motions_tell_more():
    """No hit is among the runs that tell about as much as the others; the step is theirs all the same."""
    runs = tuple(SimpleNamespace(run=SimpleNamespace(experiment=k)) for k in ["speed-motion"] * 3 + ["hammer"] * 8)
    inertia = np.array([0.01, -0.012, 0.001, *np.repeat([0.0, 0.4], 4)])
    errors = np.array([1e-3] * 3 + [2e-2] * 8)
    found = loaded(SimpleNamespace(runs=runs), inertia, errors)
    assert found is not None and found.step == pytest.approx(0.4)
    np.testing.assert_array_equal(found.members[3:], [False] * 4 + [True] * 4)


def test_one_group_is_not_parted():
    rng = np.random.default_rng(2)
    parted = [two_groups(1e-3 * rng.standard_normal(12), np.full(12, 1e-3)) is not None for _ in range(200)]
    assert sum(parted) <= 10


@pytest.mark.parametrize(("breakaway", "is_one"), [(1.0, False), (1.05, False), (1.2, True), (0.5, False)])
def test_a_breakaway_hardly_above_the_sliding_friction_is_coulombs(problem, breakaway, is_one):
    assert law(problem, "stribeck-friction", "gaussian", "load").sensible((1.0, breakaway, 0.02)) is is_one


def test_friction_unlike_in_the_two_directions_is_even_without_asymmetry(problem, truth):
    even = ActiveEffect(law(problem, "stribeck-friction", "rounded", "load"), (2.0, 3.0, 0.02, 0.004))
    sided = law(problem, "stribeck-friction", "rounded-asymmetric", "load")
    run = next(r for r in problem.runs if r.mode != "braked")
    same = predict_outputs(run, truth, (ActiveEffect(sided, (2.0, 3.0, 0.02, 0.004, 0.0)),), problem)
    other = predict_outputs(run, truth, (ActiveEffect(sided, (2.0, 3.0, 0.02, 0.004, 0.3)),), problem)
    for a, b, c in zip(predict_outputs(run, truth, (even,), problem), same, other, strict=True):
        np.testing.assert_array_equal(a, b)
        assert not np.array_equal(a, c)


def test_a_mode_is_not_damped_like_a_loss(problem):
    """What takes a fifth of critical damping and more is no mode: it stands in for a loss factor."""
    for spec in catalogue(problem):
        for parameter in spec.parameters:
            if spec.family == "mode" and parameter.name == "damping" and spec.name != "sensor-resonance":
                assert parameter.upper <= 0.2 + math.ulp(0.2)


def test_a_stop_is_also_sought_to_either_side_of_where_it_was_found(problem):
    stop = law(problem, "end-stop", "upper")
    trials = [ActiveEffect(stop, (angle, 1e3, 1.0)) for angle in (-2e-3, 0.0, 1e-3)]
    below, above = _elsewhere(trials, ActiveEffect(stop, (5e-4, 1e4, 2.0)))
    assert [t.values[0] for t in below] == [-2e-3, 0.0]
    assert [t.values[0] for t in above] == [1e-3]
    drag = law(problem, "quadratic-damping", "drag")
    assert _elsewhere([ActiveEffect(drag, (1.0,))], ActiveEffect(drag, (2.0,))) == []


def test_a_law_bent_by_what_it_lacks_lends_its_force_only(problem):
    """A Stribeck friction that rises with speed is the damping of the bristles: the whole law starts from a sensible one."""
    bristles, damped = (
        law(problem, "stribeck-friction", variant, "load") for variant in ("bristles", "bristles-damped")
    )
    trial = ActiveEffect(damped, (1.0, 1.4, 0.01, 1e-5, 2e-3))
    bent = ActiveEffect(bristles, (0.3, 0.1, 0.003, 3e-6))
    (group,) = _freer([trial], bent, 100.0)
    assert [t.values[:2] for t in group] == [(0.3, 0.1), (0.3, pytest.approx(0.42))]
    (group,) = _freer([trial], ActiveEffect(bristles, (0.3, 0.4, 0.003, 3e-6)), 100.0)
    assert [t.values[:4] for t in group] == [(0.3, 0.4, 0.003, 3e-6)]


def test_a_stop_is_sought_where_hits_reach_to_and_not_where_a_model_drifts_to(problem):
    """Scales of a sweep that wandered by a quarter radian in the model, beside hits of a milliradian."""
    stop = law(problem, "end-stop", "upper")
    sizes = replace(problem.scales, angle_low=-1.0, angle_high=1.0, travel=2.0, held_low=-1e-3, held_high=2e-3)
    places = {values[0] for values in stop.starts(replace(problem, scales=sizes))}
    assert sum(-1e-3 < place < 2e-3 for place in places) == 4 + 1  # and the middle of the travel
    sizes = replace(sizes, held_low=0.0, held_high=0.0)
    assert len({values[0] for values in stop.starts(replace(problem, scales=sizes))}) == 7


def test_the_simpler_friction_is_fitted_from_where_the_wider_one_is(problem, recorded):
    """A Coulomb friction stuck far behind the Stribeck friction that contains it; one that is near is let be."""
    spec = law(problem, "stribeck-friction", "rounded", "motor")
    effects = (candidates_for(problem, (spec,))[0],)
    candidates = candidates_for(problem, (law(problem, "coulomb-friction", "rounded", "motor"),))
    problem, truth = recorded(problem, 1e-3, effects=effects), problem.base.start
    name = ("coulomb-friction@motor",)
    runs = tuple(range(len(problem.runs)))
    with ThreadPoolExecutor(1) as pool:
        objective = Objective(problem, predict_outputs, runs, pool)
        objective = whitened(objective, white(problem.runs), objective.predictions(truth, effects))

        def at(*active):
            where = coordinates(problem, tuple(e.spec for e in active))
            x = where.pack(truth, active)
            w = objective.residual(x, where)
            return Fit(where, x, w, objective.columns(x, where, w, range(where.n)), math.nan, False, True, 1)

        base, wide = at(), at(*effects)
        leader = Hypothesis((spec,), wide, profile_loss(objective, wide.w))
        stuck = contained(objective, base, leader, candidates, {name: math.inf}, Effort())
        near = contained(objective, base, leader, candidates, {name: -math.inf}, Effort())
    assert [h.names for h in stuck] == [name]
    assert near == []


def test_about_a_friction_of_nothing_none_is_sought(problem, monkeypatch):
    """Fitted to no torque at all, a Coulomb friction bounds a Stribeck friction to nothing: its logarithm was a traceback."""
    nothing = ActiveEffect(law(problem, "coulomb-friction", "plain", "load"), (0.0,))
    wider = candidates_for(problem, (law(problem, "stribeck-friction", "gaussian", "load"),))
    where = coordinates(problem, (nothing.spec,))
    x = where.pack(problem.base.start, (nothing,))
    leader = SimpleNamespace(specs=(nothing.spec,), fit=SimpleNamespace(coordinates=where, x=x))
    monkeypatch.setattr(rivals, "within_reach", lambda objective, base, leader: math.inf)
    assert grown(SimpleNamespace(problem=problem), None, leader, wider, Effort()) == []


def test_a_soft_middle_lends_the_play_that_leaves_the_same_spring_outside(problem):
    """Far outside both are K (Delta - gap/2): a middle that lacks 0.7 of K over +-1e-4 rad is a gap of 1.4e-4 rad there."""
    soft = ActiveEffect(law(problem, "stiffness-nonlinearity", "piecewise"), (0.7, 1e-4))
    plays = [s for s in catalogue(problem) if s.name == "backlash"]
    trials = same_numbers(candidates_for(problem, plays), soft)
    assert {t.spec.variant for t in trials} == {s.variant for s in plays}
    for trial in trials:
        assert missing(trial) == pytest.approx(1.4e-4)


def missing(play):
    """What the gap takes off the wind-up, far outside."""
    values = dict(zip([p.name for p in play.spec.parameters], play.values, strict=True))
    return values["gap"] * (1.0 - values.get("inside", 0.0))


def test_a_loop_lends_presliding_friction_the_angle_over_which_it_yields(problem):
    """T and T/y are the height and the slope of both; the friction lends the loop its stiffness in turn."""
    loop = ActiveEffect(law(problem, "hysteresis", "dahl"), (0.4, 8e3))
    bent = law(problem, "coulomb-friction", "presliding", "load")
    lent = [t.values for t in same_numbers(candidates_for(problem, (bent,)), loop)]
    assert lent and all(values == pytest.approx((0.4, 5e-5)) for values in lent)
    back = same_numbers(candidates_for(problem, (loop.spec,)), ActiveEffect(bent, (0.4, 5e-5)))
    assert back and all(t.values == pytest.approx((0.4, 8e3)) for t in back)


def test_nor_where_the_axis_slides(problem):
    """Its transition is a length there."""
    rig = replace(problem.rig, motion="translational")
    slides = replace(problem, rig=rig)
    soft = ActiveEffect(law(slides, "stiffness-nonlinearity", "piecewise"), (0.7, 1e-4))
    assert soft.spec.parameters[1].unit == "m"
    plays = [s for s in catalogue(slides) if s.name == "backlash"]
    for trial in same_numbers(candidates_for(slides, plays), soft):
        assert missing(trial) == pytest.approx(1.4e-4)


def test_a_stribeck_friction_about_coulombs_falls_with_speed_whatever_the_search_does(problem):
    """T is bound below the Coulomb friction and T_b above it; the search would else end with friction that rises."""
    spec = law(problem, "stribeck-friction", "gaussian", "load")
    about = falling_about(ActiveEffect(spec, (1.0, 1.4, 0.02)), 5.0)
    bounds = {p.name: (p.lower, p.upper) for p in about.spec.parameters}
    assert about.values[0] < 5.0 < about.values[1]
    for torque in bounds["torque"]:
        for breakaway in bounds["breakaway"]:
            assert breakaway >= 1.08 * torque
    assert about.spec.sensible(about.values)


def test_a_line_counted_by_the_motor_is_tried_by_the_output_s_count_and_as_a_harmonic_of_a_slower_one(problem):
    """Order 0.7926 of a motor that turns 101 times is 80.05 of the output, and may be the louder harmonic of 40."""
    specs = {(s.name, s.variant): s for s in catalogue(problem)}
    motor = specs["transmission-error", "motor-order"]
    wider = specs["transmission-error", "output-order-harmonic"]
    trial = ActiveEffect(wider, (1e-6, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    groups = _freer([trial], ActiveEffect(motor, (7e-5, 0.7926, 0.4)), 101.0)
    orders = sorted({round(active.values[1], 2) for group in groups for active in group})
    assert orders == [40.03, 80.05]


def test_a_lag_of_another_order_is_tried_where_the_first_one_was_found(problem):
    """A set whose lag has the wrong order is made up for by a third effect that is not there."""
    second, first = (law(problem, "drive-lag", v) for v in ("second-order", "first-order"))
    trial = ActiveEffect(first, (5e-4,))
    ((found,),) = _freer([trial], ActiveEffect(second, (2.3e-3,)), 100.0)
    assert found.spec is first and found.values == (2.3e-3,)


def test_what_turns_below_the_joint_is_to_an_encoder_what_turns_beyond_it(problem):
    """J_L q''/T_S of a mount with share s at w is that of an absorber with s/(1 + s) at w/sqrt(1 + s): by the formulas."""
    mount = ActiveEffect(law(problem, "base-compliance", "turning-mount"), (31.0, 0.4, 0.02))
    beyond = law(problem, "neighbour-flexibility", "absorber")
    values = on_the_other_side(mount, beyond)
    p = 2j * np.pi * np.linspace(1.0, 90.0, 50)

    def below(frequency, share, damping):
        w = 2.0 * np.pi * frequency
        return 1.0 + share * p**2 / (p**2 + 2.0 * damping * w * p + w**2)

    def above(frequency, share, damping):
        w = 2.0 * np.pi * frequency
        own = p**2 + 2.0 * damping * w * p + w**2
        return own / (own - share * p**2)

    np.testing.assert_allclose(below(*mount.values), above(*values), rtol=1e-12)
    back = on_the_other_side(ActiveEffect(beyond, values), mount.spec)
    np.testing.assert_allclose(back, mount.values, rtol=1e-12)
    assert on_the_other_side(mount, law(problem, "link-flexibility", "inboard")) is None
    assert any(a.values == values for a in same_numbers([ActiveEffect(beyond, (20.0, 0.1, 0.02))], mount))


def test_of_modes_slower_than_any_robots_nothing_is_known(problem):
    near = law(problem, "neighbour-flexibility", "absorber")
    assert foreknown((ActiveEffect(near, (0.9 * SLOWEST, 0.1, 0.02)),)) == 0.0
    assert foreknown((ActiveEffect(near, (1.1 * SLOWEST, 0.1, 0.02)),)) > 0.0
