"""The joint's own resonance, where everything rings."""

import numpy as np
import pytest

from jointscope.diagnosis.vibration import resonance


def test_the_resonance_is_the_eigenvalue_of_the_free_joint(problem):
    """Both frequency and damping, light dampers of motor and load included; none for one inertia."""
    J_M, J_L, K, c, b_m, b_l = 9.0, 3.0, 1.9e5, 60.0, 20.0, 5.0
    theta = problem.theta(
        stiffness=K, damping=c, load_inertia=J_L, motor_inertia=J_M, motor_damping=b_m, load_damping=b_l
    )
    M = np.diag([J_M, J_L])
    D, S = np.array([[c + b_m, -c], [-c, c + b_l]]), K * np.array([[1.0, -1.0], [-1.0, 1.0]])
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-np.linalg.solve(M, S), -np.linalg.solve(M, D)]])
    root = max(np.linalg.eigvals(A), key=lambda s: s.imag)
    frequency, zeta = resonance(problem, theta)
    assert frequency == pytest.approx(abs(root) / 2 / np.pi, rel=1e-4)
    assert zeta == pytest.approx(-root.real / abs(root), rel=1e-3)
