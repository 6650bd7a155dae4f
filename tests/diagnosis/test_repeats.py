"""Where a noisy log drives every run, what no two takes have in common is given no name."""

import math
from dataclasses import dataclass, replace
from types import SimpleNamespace

import pytest

from jointscope.diagnosis.repeats import with_what_repeats


@dataclass(frozen=True)
class Answer:
    verdict: str
    chosen: object
    adequacy: object
    probability: float = 0.99
    unknown_reason: str | None = None
    candidates: tuple = ()


def run(noise=0.1, moves=True, experiment="speed-motion"):
    taken = SimpleNamespace(experiment=experiment)
    return SimpleNamespace(run=taken, motor_moves=moves, motor=SimpleNamespace(noise=noise))


def answer(
    *, left=0.0, common=1e-6, weights=None, profiled=0, family="hysteretic", shown=("hammer",), claimed=0.0
):
    spec = SimpleNamespace(run_weights=weights, profiled=profiled, family=family, revealed_by=shown)
    chosen = SimpleNamespace(hypothesis=SimpleNamespace(specs=(spec,)))
    key = ("speed-motion", False, "linear-acceleration", "arm")
    angle = SimpleNamespace(key=(*key[:2], "angle", "arm"), base_common=math.nan)
    shaken = SimpleNamespace(key=key, base_common=common, claimed=claimed, error=1e-5)
    blocks = (shaken, angle)
    return Answer("effects", chosen, SimpleNamespace(blocks=blocks, base_left=left))


def judged(*runs):
    return SimpleNamespace(
        base="base", objective=SimpleNamespace(prepared=runs[:-1]), held=SimpleNamespace(prepared=runs[-1:])
    )


def test_a_gain_that_no_two_takes_share_is_no_name():
    found = with_what_repeats(judged(run(), run(), run()), answer())
    assert (found.verdict, found.chosen, found.unknown_reason) == ("none", "base", None)


def test_nor_is_what_takes_would_share_visibly():
    given = answer(shown=("speed-motion",), claimed=3e-5)
    assert with_what_repeats(judged(run(), run(), run()), given).verdict == "none"


@pytest.mark.parametrize(
    ("given", "runs"),
    [
        (answer(left=0.02), (run(), run())),  # takes share what the base leaves
        (answer(common=math.nan), (run(), run())),  # no two takes are driven alike
        (answer(weights=(0.0, 1.0)), (run(), run())),  # a payload is in some runs only
        (answer(profiled=1), (run(), run())),  # a vibration has another phase in each
        (answer(family="periodic"), (run(), run())),  # and a shaft's order, where takes start elsewhere
        (
            answer(shown=("speed-motion",)),
            (run(), run()),
        ),  # the experiment is made to show it, and takes can't tell
        (answer(), (run(), run(moves=False))),  # a hit is driven by no log
        (answer(), (run(), run(noise=0.0))),  # a log without noise rings nothing
    ],
)
def test_whatever_else_is_known_leaves_the_name(given, runs):
    assert with_what_repeats(judged(*runs), given) is given


def test_what_was_not_named_stays(monkeypatch):
    unknown = replace(answer(), verdict="unknown")
    assert with_what_repeats(judged(run(), run()), unknown) is unknown
