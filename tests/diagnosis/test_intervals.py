"""Intervals: what a law's form leaves open is in proportion to its size, and nothing to a frequency or an order."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis import intervals
from jointscope.diagnosis.effects import REGISTRY
from jointscope.diagnosis.intervals import (
    FORM,
    FORM_OF_EXACT,
    RATTLED,
    STRETCH,
    Estimate,
    _at_its_shape,
    with_form,
)
from jointscope.diagnosis.refit import Fit, covariance


def spec_of(name, variant):
    return next(s for s in REGISTRY if (s.name, s.variant) == (name, variant))


def coordinates_of(*specs):
    """Coordinates of effects alone, each linear parameter in units of 2."""
    logs = np.array([p.log for s in specs for p in s.parameters])
    edges = np.cumsum([0, *(len(s.parameters) for s in specs)])
    rows = tuple(slice(int(a), int(b)) for a, b in pairwise(edges))
    return SimpleNamespace(
        effects=specs, effect_slices=lambda: rows, logarithm=logs, scale=np.full(len(logs), 2.0),
        n_base=0, lower=np.full(len(logs), -np.inf), upper=np.full(len(logs), np.inf),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("name", "variant", "x", "expected"),
    [
        ("quadratic-damping", "drag", [7.0], [FORM * 7.0]),
        ("torque-gain", "constant", [0.6], [FORM * 0.1]),  # 1.2 of a gain whose null is 1
        ("delay", "constant", [3.0], [FORM_OF_EXACT * 3.0]),
        ("hysteresis", "dahl", [4.0, 9.0], [FORM * 4.0, FORM]),  # the stiffness is a logarithm
        ("base-compliance", "turning-mount", [3.0, 0.5, -4.0], [0.0, FORM * 0.5, FORM]),
        ("transmission-error", "motor-order", [1.0, 0.7, 0.3], [FORM, 0.0, 0.0]),
    ],
)
def test_a_laws_form_moves_sizes_and_neither_frequencies_nor_orders_nor_phases(name, variant, x, expected):
    where = coordinates_of(spec_of(name, variant))
    x = np.array(x)
    assert with_form(where, x, np.zeros(len(x))) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("name", "variant", "share"), [("backlash", "sheds", RATTLED), ("stiffness-nonlinearity", "cubic", 0.0)]
)
def test_beside_what_rattles_the_base_is_known_to_a_hundredth_at_best(name, variant, share):
    where = coordinates_of(spec_of(name, variant))
    where.n_base, where.effect_slices = 2, lambda: (slice(2, 3),)
    where.logarithm, where.scale = np.zeros(3, dtype=bool), np.ones(3)
    found = with_form(where, np.array([1.9e5, -3.0, 4e-4]), np.array([1e-3, 0.0, 0.0]))
    assert found[:2] == pytest.approx(np.hypot([1e-3, 0.0], [share * 1.9e5, share * 3.0]))


def test_chance_and_form_add_in_squares():
    where = coordinates_of(spec_of("quadratic-damping", "drag"))
    found = with_form(where, np.array([2.0]), np.array([0.1]))
    assert found == pytest.approx(np.hypot(STRETCH * 0.1, FORM * 2.0))
    bare = replace(spec_of("quadratic-damping", "drag"), exact=True)
    assert with_form(coordinates_of(bare), np.array([2.0]), np.array([0.1])) < found


@pytest.mark.parametrize(
    ("name", "variant", "estimate", "told"),
    [
        ("gravity", "level", Estimate(-0.022, -0.059, 0.015), False),
        ("gravity", "level", Estimate(-0.022, -0.029, -0.015), True),
        ("torque-gain", "constant", Estimate(1.02, 0.99, 1.05), False),
        ("torque-gain", "constant", Estimate(1.02, 1.01, 1.03), True),
        ("coulomb-friction", "plain", Estimate(0.3, 0.0, 0.9), False),  # the bound is where it is absent
        ("sensor-resonance", "bandwidth", Estimate(900.0, 100.0, 5000.0), True),  # absent at infinity
    ],
)
def test_an_effect_whose_interval_holds_nothing_is_not_told_from_nothing(
    monkeypatch, name, variant, estimate, told
):
    where = coordinates_of(spec_of(name, variant))
    found = (estimate, *(Estimate(0.0, -1.0, 1.0) for _ in where.effects[0].parameters[1:]))
    monkeypatch.setattr(intervals, "estimates", lambda objective, fit: found)
    alike = intervals.like_nothing(None, SimpleNamespace(coordinates=where, fresh=True))
    assert alike == (() if told else where.effects)


@pytest.mark.parametrize(("wider", "told"), [(1.0, True), (1.9, True), (2.1, False)])
def test_a_size_may_be_asked_to_be_farther_from_nothing_than_its_interval(monkeypatch, wider, told):
    where = coordinates_of(spec_of("coulomb-friction", "plain"))
    found = (Estimate(2.0, 1.0, 3.0), *(Estimate(0.0, -1.0, 1.0) for _ in where.effects[0].parameters[1:]))
    monkeypatch.setattr(intervals, "estimates", lambda objective, fit: found)
    alike = intervals.like_nothing(None, SimpleNamespace(coordinates=where, fresh=True), wider)
    assert alike == (() if told else where.effects)


def test_of_a_bend_the_size_is_asked_for_at_its_shape():
    """Inertia and shape move every sample alike, so neither is known by itself; their product is."""
    spec = spec_of("link-flexibility", "one-shape")
    names = [p.name for p in spec.parameters]
    where = SimpleNamespace(**vars(coordinates_of(spec)), n=len(names))
    rng = np.random.default_rng(1)
    jacobian = rng.standard_normal((400, len(names)))
    jacobian[:, names.index("shape")] = jacobian[:, names.index("inertia")] * (
        1.0 + 1e-3 * rng.standard_normal(400)
    )
    fit = Fit(where, np.ones(len(names)), rng.standard_normal(400), jacobian, 1.0, True, True, 1)
    inertia = names.index("inertia")
    assert covariance(fit)[inertia, inertia] > 1e4 * covariance(_at_its_shape(fit))[inertia, inertia]


@pytest.mark.parametrize("width", [0.1, 3.0])
def test_what_the_data_see_one_way_only_is_known_by_the_bounds_of_the_bases_own(width):
    """An offset within its bounds and a weight act alike: the weight's variance is the range's, b^2/12, and the data's."""
    column = np.full(100, 0.7)
    where = SimpleNamespace(
        n=2, n_base=1, lower=np.array([-width / 2, -np.inf]), upper=np.array([width / 2, np.inf])
    )
    fit = Fit(where, np.zeros(2), np.zeros(100), np.stack([column, column], axis=1), 1.0, True, True, 1)
    found = covariance(fit, 2.0)
    assert found[0, 0] == pytest.approx(width**2 / 12.0)
    assert found[1, 1] == pytest.approx(width**2 / 12.0 + 2.0 / (column @ column))
    assert found[0, 1] == pytest.approx(-(width**2) / 12.0)
