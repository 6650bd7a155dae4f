"""Accelerometers in volts beside channels with units: one scale, found by the base, never an effect."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.effects import catalogue
from jointscope.diagnosis.model_file import model_json
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.unscaled import in_si, rescaled, unscaled

PER_VOLT = 11.45  # m/s^2


def in_volts(channel):
    if channel.quantity != "linear-acceleration":
        return channel
    return replace(channel, unit="1", samples=channel.samples / PER_VOLT)


def without_angle(channel):
    return None if channel.quantity == "angle" else in_volts(channel)


@pytest.fixture(scope="module")
def volts(bench, edited):
    return prepare(replace(bench, runs=tuple(edited(run, in_volts) for run in bench.runs)))


def test_the_scale_and_the_joint_are_found(volts, plant):
    """One scale for all runs; stiffness and inertia as with units; what one volt comes to is said."""
    assert all(not o.calibrated for run in volts.runs for o in run.outputs if o.quantity != "angle")
    scales = {o.scale for run in volts.runs for o in (*run.outputs, *run.declared) if not o.calibrated}
    assert len(scales) == 1 and 1.0 / scales.pop() == pytest.approx(PER_VOLT, rel=0.05)  # before any fit
    start = dict(zip(volts.base.names, volts.base.start, strict=True))
    assert start["stiffness"] == pytest.approx(plant.K, rel=0.05)
    assert start["load_inertia"] == pytest.approx(plant.J_L, rel=0.05)
    assert [line for line in volts.findings if "its unit is unknown; one of it is 1" in line]


def test_of_the_right_base_the_scale_is_least_squares(volts, truth):
    """Whatever the scale was before: it is found again from data a thousand times too large."""
    runs = tuple(
        replace(run, outputs=tuple(o if o.calibrated else rescaled(o, 1e-3) for o in run.outputs))
        for run in volts.runs
    )
    found = in_si(replace(volts, runs=runs), truth, exact=True)
    scales = {o.scale for run in found.runs for o in run.outputs if not o.calibrated}
    assert len(scales) == 1 and 1.0 / scales.pop() == pytest.approx(PER_VOLT, rel=2e-3)


def test_what_is_predicted_is_in_the_record_s_own_unit(volts):
    for run in volts.runs:
        for output in run.declared:
            channel = run.run.streams[output.channel[0]].channels[output.channel[1]]
            assert output.recorded(output.data)[output.mask] == pytest.approx(
                np.asarray(channel.samples)[output.mask]
            )
    stated = model_json(volts, volts.base.start, ())["sensors"]
    assert [s["scale"] for s in stated] == [pytest.approx(1.0 / PER_VOLT, rel=0.05)]


def test_a_gain_of_what_has_no_scale_is_no_effect(volts, problem):
    (gain,) = (s for s in catalogue(volts) if (s.name, s.variant) == ("sensor-gain", "accelerometer"))
    assert gain.possible(problem) is None
    assert gain.possible(volts) == "no accelerometer's scale is known"


def test_where_no_other_output_has_a_unit_the_channel_is_taken_as_it_is_and_that_is_said(bench, edited):
    runs = tuple(edited(run, without_angle) for run in bench.runs)
    alone = prepare(replace(bench, runs=runs))
    assert not unscaled(alone.runs)
    assert all(o.scale == 1.0 for run in alone.runs for o in run.outputs)
    assert [line for line in alone.findings if "its unit is unknown and no other channel tells it" in line]
