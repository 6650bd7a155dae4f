"""The sum of modes: its derivatives, its limits, and its agreement with the joint's closed forms."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.identification.modal_model import ModalModel, single_mode
from jointscope.models.joint import hammer_accelerance
from jointscope.models.parameters import Joint

S = 2j * np.pi * np.linspace(1.0, 120.0, 40)


def model() -> ModalModel:
    return ModalModel(
        a1=np.array([3.0, 9.0]), a2=np.array([2e4, 9e4]), b1=np.array([[0.3, 0.1], [0.2, -0.4]]),
        mass_line=np.array([0.01, 0.02]), stiffness_line=np.array([1e-6, -2e-6]), b2=np.array([[1.0, -2.0], [0.5, 0.3]]),
    )  # fmt: skip


def test_the_jacobian_is_the_derivative() -> None:
    at = model()
    vector = at.vector()
    exact = at.jacobian(S)
    for k, value in enumerate(vector):
        step = 1e-6 * max(abs(value), 1e-6)
        up, down = vector.copy(), vector.copy()
        up[k] += step
        down[k] -= step
        numeric = (at.with_vector(up).response(S) - at.with_vector(down).response(S)) / (2 * step)
        scale = np.abs(exact[..., k]).max()
        np.testing.assert_allclose(exact[..., k], numeric, atol=2e-6 * scale)


def test_a_vector_round_trip_changes_nothing() -> None:
    at = model()
    np.testing.assert_array_equal(at.with_vector(at.vector()).vector(), at.vector())
    bare = replace(at, b2=np.zeros((0, 0)), mass_line=np.zeros(0), stiffness_line=np.zeros(0))
    np.testing.assert_array_equal(bare.with_vector(bare.vector()).response(S), bare.response(S))


def test_one_mode_is_the_braked_joint() -> None:
    joint = Joint(
        stiffness=193665.0,
        damping=59.76,
        load_inertia=3.02,
        motor_inertia=2e-4,
        reducer_inertia=2e-4,
        reduction_ratio=141.0,
    )
    own = single_mode(b1=1 / 3.02, a1=59.76 / 3.02, a2=193665.0 / 3.02)
    np.testing.assert_allclose(own.response(S)[0], hammer_accelerance(joint, S), rtol=1e-12)


@pytest.mark.parametrize("wrong", [{"a1": np.array([-1.0, 9.0])}, {"a2": np.array([2e4, -9e4])}])
def test_a_mode_that_grows_or_does_not_oscillate_is_not_admissible(wrong: dict[str, np.ndarray]) -> None:
    assert model().admissible()
    assert not replace(model(), **wrong).admissible()
