"""Fitted numbers that are no longer the effect of their name, at any rig or at the one at hand."""

import math
from dataclasses import replace

import pytest

from jointscope.diagnosis.effects import at_rig, bends, catalogue
from jointscope.diagnosis.effects.hysteresis import SPECS as HYSTERESIS
from jointscope.diagnosis.effects.periodic import SPECS as PERIODIC
from jointscope.diagnosis.effects.standstill import COULOMB, STRIBECK, rises_above


@pytest.mark.parametrize("variant", ["piecewise", "piecewise-cubic"])
def test_a_soft_region_that_lacks_all_it_may_is_a_gap(problem, variant):
    spec = next(s for s in catalogue(problem) if s.variant == variant)
    rest = tuple(spec.starts(problem)[0])
    assert spec.sensible((0.5, *rest)) and not spec.sensible((spec.parameters[0].upper, *rest))


def test_a_stop_that_stops_nothing_is_no_stop(problem):
    """Its range goes on to nothing, for the search; what ends below a ten-thousandth of the joint's stiffness is none."""
    for spec in (s for s in catalogue(problem) if s.name == "end-stop"):
        smallest = spec.scale(problem)[0]
        assert spec.parameters[spec.amplitude].lower == 0.0
        assert spec.sensible((0.0, smallest, 0.0))
        assert not spec.sensible((0.0, 1e-3 * smallest, 0.0))


def test_a_ripple_returns_with_every_turn_and_is_seen_to_return(problem):
    """An order of about nothing is a constant torque, and so is a line of which the travel holds no period."""
    spec = next(s for s in PERIODIC if s.variant == "cogging")
    ratio = problem.rig.reduction_ratio or 1.0

    def over(turns: float, order: float) -> bool:
        scales = replace(problem.scales, travel=2.0 * math.pi * turns / ratio)
        return at_rig(spec, replace(problem, scales=scales)).sensible((1.0, order, 0.0))

    assert over(1.5, 1.0) and over(0.5, 4.0) and over(20.0, 6.0)
    assert not over(20.0, 0.05) and not over(20.0, 1.5)
    assert not over(0.5, 1.0)


def test_a_hysteresis_without_width_on_a_held_joint_is_friction(problem):
    """Dry friction at the arm is parallel to the spring of a held joint; where the motor moves it is not."""
    wind_up = problem.scales.wind_up
    held = replace(problem, runs=tuple(replace(run, mode="braked") for run in problem.runs))
    moved = replace(problem, runs=tuple(replace(run, mode="observer") for run in problem.runs))
    for variant in ("dahl", "maxwell-slip"):
        spec = next(s for s in HYSTERESIS if s.variant == variant)
        thin, wide = (1.0, 1.0 / (0.01 * wind_up)), (1.0, 1.0 / (0.06 * wind_up))
        assert at_rig(spec, held).sensible(wide) and not at_rig(spec, held).sensible(thin)
        assert at_rig(spec, moved).sensible(thin)


def test_friction_that_falls_beyond_all_speeds_is_no_stribeck_friction(problem):
    """Viscous damping that is too large, and a friction that falls over twice the top speed, make Coulomb's of a Stribeck law."""
    top = max(problem.scales.speed, problem.scales.motor_speed)
    for spec in (s for s in catalogue(problem) if s.name == "stribeck-friction"):
        speed = next(p for p in spec.parameters if p.name == "stribeck_velocity")
        assert speed.upper < top
        assert speed.lower < 0.01 * top


@pytest.mark.parametrize(
    ("name", "variant", "short", "long"),
    [
        ("delay", "constant", (-5e-5,), (-8e-5,)),
        ("drive-lag", "first-order", (5e-5,), (8e-5,)),
        ("sensor-resonance", "bandwidth", (1.2e4,), (3e3,)),
        ("sensor-resonance", "mount", (2e4, 0.9), (2e4, 0.05)),  # one that rings is seen by what it amplifies
    ],
)
def test_a_time_below_what_drives_and_recorders_leave_open_is_no_effect(problem, name, variant, short, long):
    """A current loop acts once in 62 us, a multiplexer within 20."""
    spec = next(s for s in catalogue(problem) if (s.name, s.variant) == (name, variant))
    assert spec.sensible(long) and not spec.sensible(short)


def test_a_gain_that_no_calibration_holds_is_no_fault(problem):
    """A long record tells a gain to 1e-5; a sensor's factor is known to a quarter of a per cent at the very best."""
    specs = [s for s in catalogue(problem) if s.name in ("sensor-gain", "torque-gain")]
    assert len(specs) >= 2
    for spec in specs:
        assert not spec.sensible((1.00014,)) and not spec.sensible((0.9995,))
        assert spec.sensible((1.003,)) and spec.sensible((0.98,))


@pytest.mark.parametrize("name", ["coulomb-friction", "stribeck-friction"])
@pytest.mark.parametrize("location", ["motor", "load"])
def test_friction_that_builds_up_over_all_of_a_motion_is_a_spring(problem, name, location):
    """A joint that turns slides; one that is held may stick over all of its travel."""
    held = replace(problem, runs=tuple(replace(run, mode="braked") for run in problem.runs))
    moved = replace(problem, runs=tuple(replace(run, mode="observer") for run in problem.runs))
    laws = [
        s
        for s in (*COULOMB, *STRIBECK)
        if s.name == name and s.location == location and "rounded" not in s.variant
    ]
    assert laws
    for law in laws:
        position = [p.name for p in law.parameters].index("presliding")
        before = (1.0, 1.5, 0.1 * problem.scales.speed)[:position]
        after = (0.0,) * (len(law.parameters) - position - 1)
        short, long = ((*before, wind_ups * problem.scales.wind_up, *after) for wind_ups in (0.5, 2.0))
        assert at_rig(law, moved).sensible(short) and not at_rig(law, moved).sensible(long)
        assert at_rig(law, held).sensible(long)


@pytest.mark.parametrize(
    ("values", "falls"),
    [
        ((20.0, 30.0, 0.05, 0.002), True),  # up within 2 mrad/s, and down again over 50
        ((20.0, 30.0, 0.0035, 0.0031), False),  # over before it has risen: another rounding of 20 N m
        ((20.0, 21.0, 0.05, 0.002), False),  # 5 % is what Coulomb's form leaves open
        ((20.0, 130.0, 0.5, 0.002), False),  # no contact breaks away at six times
    ],
)
def test_rounded_friction_is_stribecks_where_it_anywhere_exceeds_what_slides(values, falls):
    assert rises_above(values) is falls


def test_a_bend_by_which_every_sensor_stops_to_follow_the_arm_is_the_sensors_own():
    """1 - s (s + 2 zeta w)/(s^2 + 2 zeta w s + w^2) is a mount's resonance, whatever else rings below it."""
    one = next(s for s in bends.SPECS if s.variant == "1-bends-1-places")
    assert one.sensible((518.0, 0.05, -0.5)) and one.sensible((518.0, 0.05, 0.3))
    assert not one.sensible((518.0, 0.05, -1.03))
    two = next(s for s in bends.SPECS if s.variant == "2-bends-1-places")
    assert not two.sensible((518.0, 0.05, -1.03, 64.0, 0.03, 0.03))
    placed = next(s for s in bends.SPECS if s.variant == "1-bends-2-places")
    assert placed.sensible((518.0, 0.05, -1.0, 0.4, 0.7))
    assert not placed.sensible((518.0, 0.05, -1.0, -0.7, 0.7))
