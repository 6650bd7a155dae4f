"""The closed forms obey the limits that the differential equations give."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from jointscope.models.joint import (
    DirectForm,
    antiresonance,
    denominator,
    hammer_accelerance,
    hammer_receptance,
    load_acceleration_per_torque,
    load_speed_per_torque,
    motor_acceleration_per_torque,
    sum_of_modes,
    torsion_frequency,
)
from jointscope.models.paper import paper_rig
from jointscope.models.parameters import Joint, ParameterError, Rig

JOINT = paper_rig().joint
positive = st.floats(0.01, 100.0)


@settings(max_examples=50, deadline=None)
@given(positive, positive, st.floats(1e3, 1e6), st.floats(0.0, 100.0), st.floats(0.0, 10.0), st.floats(0.0, 10.0))
def test_closed_form_solves_the_equations_of_motion(J_M, J_L, K, c, b_m, b_l):
    """q' from (5) is the solution of the two-inertia equations (4), solved here as a 2 x 2 system."""
    joint = Joint(
        stiffness=K, damping=c, load_inertia=J_L, motor_inertia=J_M, reducer_inertia=0.0, reduction_ratio=1.0,
        motor_damping=b_m, load_damping=b_l,
    )  # fmt: skip
    for s in (3.0j, 50.0j, 700.0j):
        k = K + c * s
        matrix = np.array([[J_M * s**2 + b_m * s + k, -k], [-k, J_L * s**2 + b_l * s + k]])
        q_s, q = np.linalg.solve(matrix, [1.0, 0.0])
        at = np.array([s])
        assert load_speed_per_torque(joint, at)[0] == pytest.approx(s * q, rel=1e-6)
        assert motor_acceleration_per_torque(joint, at)[0] == pytest.approx(s**2 * q_s, rel=1e-6)


def test_low_frequencies_move_one_rigid_body():
    """Far below resonance and above the damping's corner both sides accelerate with 1/(J_M + J_L)."""
    joint = replace(JOINT, motor_damping=0.0, load_damping=0.0)
    s = np.array([2j * np.pi * 0.5])
    rigid = 1.0 / (joint.reflected_inertia + joint.load_inertia)
    assert abs(load_acceleration_per_torque(joint, s)[0]) == pytest.approx(rigid, rel=1e-3)
    assert abs(motor_acceleration_per_torque(joint, s)[0]) == pytest.approx(rigid, rel=1e-3)


def test_undamped_joint_has_its_zero_and_pole_at_8_and_9():
    """Without damping the motor stands still at w_ARF and nothing bounds it at w_NTF."""
    joint = replace(JOINT, damping=0.0, motor_damping=0.0, load_damping=0.0)
    at_zero = motor_acceleration_per_torque(joint, np.array([1j * antiresonance(joint)]))
    assert abs(at_zero[0]) < 1e-9
    roots = np.roots(denominator(joint))
    assert np.abs(roots).max() == pytest.approx(torsion_frequency(joint), rel=1e-9)


def test_hammer_below_resonance_meets_the_spring_and_above_the_mass():
    """q/T -> 1/K and q''/T -> 1/J_L."""
    assert hammer_receptance(JOINT, np.array([1e-3j]))[0].real == pytest.approx(1.0 / JOINT.stiffness, rel=1e-6)
    assert hammer_accelerance(JOINT, np.array([1e6j]))[0].real == pytest.approx(1.0 / JOINT.load_inertia, rel=1e-3)


def test_gravity_stiffens_a_hanging_arm_and_softens_a_raised_one():
    """K_g = -m g r sin(q): positive below the horizontal, zero on it."""
    rig = paper_rig()
    assert rig.gravity_stiffness(-0.5) > 0.0 > rig.gravity_stiffness(0.5)
    assert rig.gravity_stiffness(0.0) == 0.0
    step = 1e-6
    slope = -(rig.gravity_torque(0.7 + step) - rig.gravity_torque(0.7 - step)) / (2.0 * step)
    assert rig.gravity_stiffness(0.7) == pytest.approx(slope, rel=1e-6)


def test_direct_form_of_a_joint_returns_its_parameters():
    """(21) inverts (20), and the form with b2 = b3 = 0 is the accelerance."""
    b1, damping = 1.0 / JOINT.load_inertia, JOINT.damping + JOINT.load_damping
    form = DirectForm(b1=b1, b2=0.0, b3=0.0, a1=damping * b1, a2=JOINT.stiffness * b1)
    assert (form.inertia, form.damping, form.stiffness) == pytest.approx(
        (JOINT.load_inertia, damping, JOINT.stiffness)
    )
    s = 2j * np.pi * np.linspace(1.0, 100.0, 7)
    np.testing.assert_allclose(sum_of_modes([form], s), hammer_accelerance(JOINT, s), rtol=1e-12)


@pytest.mark.parametrize(
    ("name", "value"), [("stiffness", -1.0), ("damping", -1e-9), ("load_inertia", float("nan"))]
)
def test_unphysical_joint_is_refused_by_name(name, value):
    """The error carries the parameter's name and value."""
    with pytest.raises(ParameterError, match=name) as caught:
        replace(JOINT, **{name: value})
    assert caught.value.name == name


def test_arm_without_inertia_of_its_own_is_refused():
    """J_L must exceed m r^2."""
    with pytest.raises(ParameterError, match="above m r"):
        Rig(joint=JOINT, arm_mass=12.0, arm_com_radius=0.6, hammer_radius=0.8, accelerometer_radius=0.9)
