"""What was predicted before is predicted again without being simulated, to the bit; the oldest is forgotten first."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.effects import catalogue
from jointscope.diagnosis.memory import Memory
from jointscope.diagnosis.objective import Objective
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.screen import trial_effects

RUN, PROBLEM, THETA = object(), object(), np.array([1.0, 2.0])


def asked(memory, value, run=RUN, problem=PROBLEM, effects=()):
    """What the memory says, and how often it had to simulate for it."""
    calls = []

    def simulate():
        calls.append(value)
        return (np.full(4, value),)

    return memory.outputs(run, np.array([value]), effects, problem, simulate)[0][0], len(calls)


def test_the_same_question_is_simulated_once():
    memory = Memory()
    assert asked(memory, 1.0) == (1.0, 1)
    assert asked(memory, 1.0) == (1.0, 0)
    assert asked(memory, 1.0 + 1e-16) == (1.0, 0)  # the same number
    assert asked(memory, np.nextafter(1.0, 2.0))[1] == 1


@pytest.mark.parametrize("other", [{"run": object()}, {"problem": object()}], ids=["run", "problem"])
def test_another_run_or_campaign_is_another_question(other):
    memory = Memory()
    asked(memory, 1.0)
    assert asked(memory, 1.0, **other)[1] == 1


def test_a_forgotten_run_lends_its_identity_to_none():
    memory = Memory()
    for _ in range(200):
        assert asked(memory, 1.0, run=object())[1] == 1


def test_the_oldest_is_forgotten_and_what_was_asked_for_lately_is_kept():
    memory = Memory(limit=3 * 32)
    for value in (1.0, 2.0, 3.0):
        asked(memory, value)
    asked(memory, 1.0)
    asked(memory, 4.0)
    assert [asked(memory, value)[1] for value in (1.0, 3.0, 4.0)] == [0, 0, 0]
    assert asked(memory, 2.0)[1] == 1


def test_what_is_kept_cannot_be_written_to():
    data = np.zeros(3)
    (kept,) = Memory().outputs(RUN, THETA, (), PROBLEM, lambda: (data,))
    with pytest.raises(ValueError, match="read-only"):
        kept[0] = 1.0
    data[0] = 1.0  # the simulation's own arrays stay its own


def test_predictions_with_and_without_a_memory_are_the_same_bits(problem, truth):
    laws = [spec for spec in catalogue(problem) if spec.possible(problem) is None]
    trials = [active for spec in laws for active in trial_effects(spec, problem)[:1]]
    assert len(trials) > 30
    with ThreadPoolExecutor(2) as pool:
        objective = Objective(problem, predict_outputs, (0, 1), pool)
        forgetful = replace(objective, memory=Memory(limit=0))
        for active in (*trials, *trials):
            kept, simulated = objective.predictions(truth, (active,)), forgetful.predictions(truth, (active,))
            for a, b in zip(kept, simulated, strict=True):
                np.testing.assert_array_equal(a[0], b[0])
