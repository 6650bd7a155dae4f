"""A wrong name's nearest fit, on a linear stand-in for the engine: its distance, and trials that can't be followed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from jointscope.sim.concealed import rival_fit
from jointscope.sim.concealed.law import Effect
from jointscope.sim.concealed.yardstick import Yardstick

TRUTH = np.array([0.3, -0.2, 1.0])
SHAPE = np.array([[1.0, 0.4, 0.0], [0.0, 1.0, 0.2], [0.3, 0.0, 1.0], [0.0, 0.0, 0.5]])


def _refit(monkeypatch: pytest.MonkeyPatch, followed: Callable[[np.ndarray], bool] = lambda x: True) -> float:
    """Distance left by a rival of log strength s beside one base parameter k, linear in (k, s, f); truth at TRUTH."""
    law = SimpleNamespace(strength="s")

    def misfit(
        rig: dict[str, float], plan: object, runs: object, record: object, _: object, effects: Sequence[Effect]
    ) -> np.ndarray:
        values = effects[0].values
        x = np.array([rig.get("k", 0.0), np.log(values["s"]), np.log(values["f"])])
        if not followed(x):
            raise FloatingPointError
        return SHAPE @ (x - TRUTH) + np.array([0.0, 0.0, 0.0, 0.1])

    monkeypatch.setattr(rival_fit, "misfit_of", misfit)
    monkeypatch.setattr(rival_fit, "changed", lambda rig, changes: dict(changes))
    monkeypatch.setattr(rival_fit, "off", lambda scatter, w: w)
    yard = SimpleNamespace(
        steps={"k": 0.02}, rig={}, plan=None, runs=(), origin=np.zeros(4), scatter=None, white=lambda m: m
    )
    rival = cast(Effect, SimpleNamespace(law=law, values={"s": 1.0, "f": 1.0}))
    sight = cast(Any, SimpleNamespace(record=None))
    return rival_fit.refitted(cast(Yardstick, yard), sight, rival, ("f",), (1e-3, 1e3))


def _least(free: Sequence[int]) -> float:
    columns, wanted = SHAPE[:, free], SHAPE @ TRUTH - np.array([0.0, 0.0, 0.0, 0.1])
    return float(np.linalg.norm(wanted - columns @ np.linalg.lstsq(columns, wanted, rcond=None)[0]))


def test_the_distance_left_is_the_least_squares_residual(monkeypatch: pytest.MonkeyPatch) -> None:
    assert _refit(monkeypatch) == pytest.approx(_least([0, 1, 2]), rel=0.02)


def test_a_parameter_that_the_engine_cannot_follow_stays_where_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    """It once made every slope infinite, the next step NaN, and the case was lost."""
    assert _refit(monkeypatch, lambda x: abs(x[2]) < 1e-9) == pytest.approx(_least([0, 1]), rel=0.02)


def test_a_rival_that_cannot_be_simulated_at_all_is_infinitely_far(monkeypatch: pytest.MonkeyPatch) -> None:
    assert np.isinf(_refit(monkeypatch, lambda x: False))
