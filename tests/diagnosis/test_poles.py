"""The joint's own resonances, where everything rings."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.poles import joint_poles

J_M, J_L, K, C, B_M, B_L = 9.0, 3.0, 1.9e5, 60.0, 20.0, 5.0


def slowest(mass, damping, stiffness):
    """Frequency [Hz] and damping ratio of the eigenvalue with the greatest imaginary part."""
    n = len(mass)
    A = np.block(
        [
            [np.zeros((n, n)), np.eye(n)],
            [-np.linalg.solve(mass, stiffness), -np.linalg.solve(mass, damping)],
        ]
    )
    root = max(np.linalg.eigvals(A), key=lambda s: s.imag)
    return abs(root) / 2 / np.pi, -root.real / abs(root)


FREE = slowest(
    np.diag([J_M, J_L]), np.array([[C + B_M, -C], [-C, C + B_L]]), K * np.array([[1.0, -1.0], [-1.0, 1.0]])
)
HELD = slowest(np.array([[J_L]]), np.array([[C + B_L]]), np.array([[K]]))


@pytest.mark.parametrize(
    ("moving", "expected"), [((True,), [FREE]), ((False,), [HELD]), ((True, False, True), [HELD, FREE])]
)
def test_the_resonances_are_the_eigenvalues_of_the_joint_free_and_held(problem, moving, expected):
    """Frequency and damping, light dampers of motor and load included."""
    theta = problem.theta(
        stiffness=K, damping=C, load_inertia=J_L, motor_inertia=J_M, motor_damping=B_M, load_damping=B_L
    )
    run = problem.runs[0]
    found = joint_poles(replace(problem, runs=tuple(replace(run, motor_moves=m) for m in moving)), theta)
    assert [f for f, _ in found.values()] == pytest.approx([f for f, _ in expected], rel=1e-4)
    assert [z for _, z in found.values()] == pytest.approx([z for _, z in expected], rel=1e-3)


def test_what_has_no_spring_has_no_resonance(problem):
    assert joint_poles(problem, problem.theta(stiffness=0.0, load_inertia=J_L)) == {}
