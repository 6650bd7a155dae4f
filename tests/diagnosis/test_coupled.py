"""A bend beside which the joint resonates as the base does, by the eigenproblem of the two inertias."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import eigh

from jointscope.diagnosis import kernel, uncoupling
from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.effects.coupled import COUPLED, PLAIN, beside_bend, uncoupled

K0, J0 = 1.6e5, 3.4
OWN = math.sqrt(K0 / J0) / (2.0 * math.pi)


def modes(stiffness, whole, frequency, outer, hit, sensed):
    """Squares of the held joint's two resonances, and what each answers to a hit [1/(kg m^2)]."""
    spring = outer * (2.0 * math.pi * frequency) ** 2
    squares, shapes = eigh(
        np.array([[stiffness + spring, -spring], [-spring, spring]]), np.diag([whole - outer, outer])
    )
    follows = [shapes[0] + share * (shapes[1] - shapes[0]) for share in (hit, sensed)]
    return squares, follows[0] * follows[1]


@pytest.mark.parametrize("factor", [1.3, 2.0, 5.0])
@pytest.mark.parametrize("outer", [0.02, 0.4])
@pytest.mark.parametrize(("hit", "sensed"), [(0.0, 0.0), (0.1, 0.25), (0.3, 0.6)])
def test_the_joint_beside_the_bend_resonates_where_the_base_does_and_answers_as_much(factor, outer, hit, sensed):
    stiffness, whole = beside_bend(K0, J0, factor * OWN, outer, hit, sensed)
    squares, answers = modes(stiffness, whole, factor * OWN, outer, hit, sensed)
    assert squares[0] == pytest.approx(K0 / J0, rel=1e-9)
    assert answers[0] == pytest.approx(1.0 / J0, rel=1e-9)


def test_without_an_outer_part_it_is_the_base():
    assert beside_bend(K0, J0, 2.0 * OWN, 0.0, 0.0, 0.0) == pytest.approx((K0, J0))
    assert COUPLED.is_null((50.0, 0.0, 0.02, 0.05, 0.05))


def test_its_own_terms_say_the_same():
    """The law of two shapes beside K and J_L packs the numbers that the coupled one packs beside K_0 and J_0."""
    values = (1.7 * OWN, 0.3, 0.02, 0.1, 0.25)
    stiffness, whole, plain = uncoupled(K0, J0, values, PLAIN)
    packed = []
    for k, j, apply, numbers in (
        (K0, J0, COUPLED.apply, values),
        (stiffness, whole, PLAIN.apply, plain.values),
    ):
        P, S = np.zeros(kernel.N_P), np.full(kernel.N_S, -1, dtype=np.int64)
        P[kernel.K], P[kernel.J_L], S[kernel.N_X] = k, j, 4
        apply(SimpleNamespace(P=P, S=S), numbers, 1.0)
        packed.append((P, S))
    np.testing.assert_allclose(packed[0][0], packed[1][0], rtol=1e-12)
    np.testing.assert_array_equal(packed[0][1], packed[1][1])


@pytest.mark.parametrize("missing", ["stiffness", "load_inertia"])
def test_it_is_not_sought_where_the_numbers_that_it_moves_are_known(missing):
    free = [position for name, position in BASE_INDEX.items() if name != missing]
    parent = SimpleNamespace(fit=SimpleNamespace(coordinates=SimpleNamespace(free=free)), names=(), specs=())
    problem = SimpleNamespace(rig=SimpleNamespace(motion="rotational"))
    objective = SimpleNamespace(problem=problem)
    assert uncoupling.bends_beside(objective, parent, None) == []
