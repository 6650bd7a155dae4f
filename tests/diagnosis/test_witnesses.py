"""An accelerometer on the mount or on a neighbour says which of the two moves."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.effects import catalogue
from jointscope.diagnosis.effects.witnesses import contradicted, moved
from jointscope.diagnosis.prepare import prepare

NOISE = 1e-3  # m/s^2, of each accelerometer


@pytest.fixture
def witnessed(builders, plant):
    """The maker of three hits in two postures, with accelerometers at the given places that follow the arm's by a share."""
    level = replace(plant, weight=1e-9)

    def made(**shares):
        rng = np.random.default_rng(3)

        def with_witnesses(run):
            stream = run.streams[0]
            arm = next(c for c in stream.channels if c.quantity == "linear-acceleration")
            more = tuple(
                replace(
                    arm, column=place, location=place, radius=None,
                    samples=share * arm.samples + NOISE * rng.standard_normal(stream.length),
                )
                for place, share in shares.items()
            )  # fmt: skip
            noisy = replace(arm, samples=arm.samples + NOISE * rng.standard_normal(stream.length))
            channels = (*(noisy if c is arm else c for c in stream.channels), *more)
            return replace(run, streams=(replace(stream, channels=channels),))

        hits = [builders.hammer_run(level, peak, f"h{peak:.0f}", duration=0.6) for peak in (60.0, 100.0, 160.0)]
        turned = [replace(run, arm_angle=0.4 * k) for k, run in enumerate(hits)]
        return [with_witnesses(run) for run in turned]

    return made


@pytest.mark.parametrize(("share", "answer"), [(0.03, True), (0.0, False), (1e-3, False)])
def test_a_witness_moves_or_stands_still_and_where_there_is_none_nothing_is_said(witnessed, share, answer):
    for run in witnessed(base=share):
        assert moved(run, "base") is answer
        assert moved(run, "neighbour") is None


def test_the_level_of_a_still_witness_says_nothing(witnessed):
    """Noise as large as the arm's own ring is no motion."""
    (run, *_) = witnessed(base=0.0)
    stream = run.streams[0]
    loud = 30.0 * np.random.default_rng(1).standard_normal(stream.length)
    channels = tuple(replace(c, samples=loud) if c.location == "base" else c for c in stream.channels)
    assert moved(replace(run, streams=(replace(stream, channels=channels),)), "base") is False


@pytest.mark.parametrize(
    ("shares", "base", "neighbour"),
    [
        ({}, False, False),
        ({"base": 0.03}, False, True),
        ({"base": 0.0}, True, False),
        ({"neighbour": 0.03}, True, False),
        ({"neighbour": 0.0}, False, True),
        ({"base": 0.03, "neighbour": 0.0}, False, True),
        ({"base": 0.0, "neighbour": 0.03}, True, False),
        ({"base": 0.03, "neighbour": 0.03}, False, False),
    ],
)
def test_what_stands_still_and_what_nothing_was_seen_of_beside_a_thing_that_moves_carry_no_mode(
    builders, witnessed, shares, base, neighbour
):
    problem = prepare(builders.campaign_of(witnessed(**shares)))
    assert (contradicted(problem, "base") is not None) is base
    assert (contradicted(problem, "neighbour") is not None) is neighbour
    for spec in catalogue(problem):
        if (spec.name, spec.variant) in (
            ("base-compliance", "turning-mount"),
            ("neighbour-flexibility", "absorber"),
        ):
            assert (spec.possible(problem) is not None) is (base if spec.location == "base" else neighbour)
        if spec.variant == "carrier-turned" and neighbour:
            assert "accelerometer" in spec.possible(problem)
