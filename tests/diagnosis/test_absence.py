"""What a second effect explains where the first one does nothing is its own; what acts there with it may be a form of it."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.absence import shown_in_absence
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.search import Hypothesis, names_of

NOISE = 2e-3  # of each channel's rms


def law(problem, name, variant):
    return next(s for s in catalogue(problem) if s.name == name and s.variant == variant)


@pytest.fixture
def asked(problem, recorded, fitted):
    """shown_in_absence of ``second`` beside ``first``, where the data hold ``concealed``."""

    def ask(first, second, concealed):
        found = [fitted(recorded(problem, NOISE, seed=seed, effects=concealed), first, second) for seed in (1, 2)]
        (objective, at), (held, _) = found

        def judged(*actives):
            fit = replace(at(problem.base.start, *actives), jacobian=np.zeros((0, 0)))
            specs = tuple(a.spec for a in actives)
            return SimpleNamespace(fit=fit, names=names_of(specs), hypothesis=Hypothesis(specs, fit, 0.0))

        return shown_in_absence(
            SimpleNamespace(objective=objective, held=held), judged(first), judged(first, second)
        )

    return ask


def test_a_loss_beside_a_lag_of_the_drive_is_seen_in_the_hits(problem, asked):
    lag = ActiveEffect(law(problem, "drive-lag", "first-order"), (8e-4,))
    loss = ActiveEffect(law(problem, "structural-damping", "relaxation"), (0.05,))
    assert asked(lag, loss, (lag, loss))
    assert not asked(lag, loss, (lag,))  # nothing there to be seen


def test_what_acts_only_with_the_first_effect_is_not(problem, asked):
    lag = ActiveEffect(law(problem, "drive-lag", "first-order"), (8e-4,))
    gain = ActiveEffect(law(problem, "torque-gain", "constant"), (1.1,))
    assert not asked(lag, gain, (lag, gain))


def test_an_effect_that_acts_everywhere_is_absent_nowhere(problem, asked):
    drag = ActiveEffect(
        law(problem, "quadratic-damping", "drag"), (law(problem, "quadratic-damping", "drag").scale(problem)[2],)
    )
    loss = ActiveEffect(law(problem, "structural-damping", "relaxation"), (0.05,))
    assert not asked(drag, loss, (drag, loss))
