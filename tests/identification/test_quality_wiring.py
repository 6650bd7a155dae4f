"""A mistake settled by one run is tried on the others; one that leaves a contradiction settles nothing."""

import numpy as np
import pytest

from jointscope.identification.quality_relation import Party, Relation
from jointscope.identification.quality_wiring import first_look, second_look, settled
from jointscope.recordings.campaign import Channel, Nameplate, Run, Signal, Stream

RIG = Nameplate(topology="two-inertia", motion="rotational", plane="horizontal", reduction_ratio=100.0)
DEGREES, WRONG = 180.0 / np.pi, -1.0


def take(name, *, angle=1.0, acc=1.0, command=False):
    """A run whose channels read ``angle`` and ``acc`` times what is true."""

    def channel(column, quantity, unit, location, factor, radius=None):
        samples = factor * np.linspace(1.0, 2.0, 64)
        return Channel(
            column=column,
            quantity=quantity,
            unit=unit,
            location=location,
            role="output",
            samples=samples,
            radius=radius,
        )

    channels = [
        channel("q", "angle", "rad", "motor", angle),
        channel("a", "linear-acceleration", "m/s^2", "arm", acc, 1.0),
    ]
    if command:
        channels.append(channel("w", "angular-velocity", "rad/s", "motor", 1.0))
    return Run(
        id=name,
        experiment="torque-sweep",
        streams=(Stream(file="x", sampling_rate=1.0, length=64, channels=tuple(channels)),),
    )


def build(run):
    """The angle against the acceleration in every run; the angle against the speed where there is one."""
    signals = {s.channel.column: s for s in run.signals}

    def level(column):
        return float(signals[column].samples[0])

    both = (Party(signals["q"], 1), Party(signals["a"], -1))
    made = [Relation(both, level("q") / level("a"), 0.9, 1.1, "q against a")]
    if "w" in signals:
        made.append(Relation((Party(signals["q"], 1),), level("q") / level("w"), 0.9, 1.1, "q against w"))
    return made


def looked(*runs):
    outcomes = [first_look(run, RIG, build) for run in runs]
    wiring = settled(outcomes)
    return {outcome.run.id: second_look(outcome, wiring, RIG, build) for outcome in outcomes}


def named(outcome):
    return {(finding.finding, finding.channel) for finding in outcome.found}


def test_runs_without_mistakes_stay_without_findings():
    found = looked(take("a", command=True), take("b"))
    assert all(outcome.found == () for outcome in found.values())


def test_a_run_that_says_it_alone_is_believed():
    found = looked(take("a", angle=DEGREES, command=True))
    assert named(found["a"]) == {("suspicious-unit", "q")} and found["a"].left == 0.0


def test_two_mistakes_that_one_run_can_not_part_are_parted_by_another():
    # alone, b could be put right by one far-fetched factor on either channel
    both = {"angle": DEGREES, "acc": WRONG}
    found = looked(take("a", **both, command=True), take("b", **both))
    assert named(found["a"]) == named(found["b"]) == {("suspicious-unit", "q"), ("inverted-polarity", "a")}
    assert found["b"].left == 0.0


def test_what_is_right_elsewhere_is_not_put_on_a_run_that_is_sound():
    found = looked(take("a", angle=DEGREES, command=True), take("b", command=True))
    assert found["b"].found == ()


@pytest.mark.parametrize("acc", [0.013, 77.0])
def test_a_contradiction_that_stays_settles_nothing(acc):
    run = take("a", acc=acc)
    outcome = first_look(run, RIG, build)
    if outcome.left > 0.0:
        assert settled([outcome]) == {}


def test_signals_are_matched_by_what_is_declared_of_them():
    other = take("b", angle=DEGREES, acc=WRONG)
    streams = tuple(
        Stream(file=s.file, sampling_rate=1.0, length=64, channels=tuple(
            Channel(**{**vars(c), "unit": "deg"}) if c.column == "q" else c for c in s.channels))
        for s in other.streams
    )  # fmt: skip
    other = Run(id="b", experiment="torque-sweep", streams=streams)
    assert isinstance(other.signals[0], Signal)
    found = looked(take("a", angle=DEGREES, acc=WRONG, command=True), other)
    assert ("suspicious-unit", "q") not in {
        (f.finding, f.channel) for f in found["b"].found if "as in the runs" in f.detail
    }
