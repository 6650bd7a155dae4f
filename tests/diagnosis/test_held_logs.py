"""A campaign whose torque log repeats its values: what is said of it, which laws of a slow log remain, and its noise."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.effects import catalogue
from jointscope.diagnosis.prepare import prepare


def repeating(campaign, edited, every):
    """Every torque log refreshed at every so many samples."""

    def change(channel):
        if channel.quantity != "torque":
            return channel
        at = np.arange(channel.samples.size) // every * every
        return replace(channel, samples=channel.samples[at])

    return replace(campaign, runs=tuple(edited(run, change) for run in campaign.runs))


def laws(problem):
    return {s.variant for s in catalogue(problem) if s.name == "torque-logging" and s.possible(problem) is None}


@pytest.fixture(scope="module")
def held(bench, edited):
    return prepare(repeating(bench, edited, 4))


def test_it_is_told_and_its_laws_keep_the_rate(held):
    assert any("refreshed at 125 Hz, written at 500 Hz" in line for line in held.findings)
    assert laws(held) == {"seen-held", "averaged-held"}
    seen = next(s for s in catalogue(held) if s.variant == "seen-held")
    assert seen.scale(held)[1] == pytest.approx(125.0, rel=2e-3)
    assert seen.limits(held)["rate"] == pytest.approx((125.0, 125.0), rel=3e-3)
    assert seen.limits(held)["age"] == (-1 / 500.0, 1 / 500.0)


def test_the_staircase_is_no_noise(held):
    assert [run.motor.noise for run in held.runs if run.motor is not None and run.motor_moves] == [0.0]


def test_of_any_other_log_nothing_is_said(problem):
    assert not any("refreshed" in line for line in problem.findings)
    assert laws(problem) == {"averaged", "held", "aliased"}
