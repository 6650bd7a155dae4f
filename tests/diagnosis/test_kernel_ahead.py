"""What is compiled ahead is what simulations then call, and the shares are the whole of it."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.kernel import ahead
from jointscope.diagnosis.kernel.scalar_steps import FIXED, FREE
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare

STEPPERS = 1 + len(FREE) + len(FIXED)


class Noted:
    """In a stepper's place: notes what it is asked to compile."""

    def __init__(self, names, name):
        self.names, self.name = names, name

    def compile(self, signature):
        self.names.append(self.name)


@pytest.mark.parametrize("parts", [1, 2, 3, STEPPERS + 1])
def test_every_stepper_is_in_one_share(monkeypatch, parts):
    names = []
    monkeypatch.setattr(ahead, "simulate_full", Noted(names, "full"))
    monkeypatch.setattr(ahead, "FREE", {k: Noted(names, ("free", k)) for k in FREE})
    monkeypatch.setattr(ahead, "FIXED", {k: Noted(names, ("fixed", k)) for k in FIXED})
    assert sum(ahead.compile_ahead(part, parts) for part in range(parts)) == STEPPERS
    assert len(names) == len(set(names)) == STEPPERS


def test_a_simulation_asks_for_nothing_else(builders):
    """The plain driven joint's stepper, compiled for the arrays that it is then given, however they lie in memory."""
    assert ahead.compile_ahead(1, STEPPERS) == 1
    problem = prepare(builders.campaign_of([builders.sweep_run(builders.Plant(), 40.0, "s")]))
    (run,) = problem.runs
    strided = replace(run, load_half=np.repeat(run.load_half, 2)[::2])
    plain, same = (predict_outputs(r, problem.theta(), (), problem) for r in (run, strided))
    for y, other in zip(plain, same, strict=True):
        np.testing.assert_array_equal(y, other)
    assert len(FREE[0].signatures) == 1
