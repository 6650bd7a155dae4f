"""Further modes of the compiled joint: eigenfrequencies, and the equations of motion of what carries it."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jointscope.diagnosis import kernel as k

sys.path.insert(0, str(Path(__file__).parent))
from packed_joint import KW, modes, packed, run  # type: ignore[import-not-found]


def eigenfrequencies(M, Kmat):
    return np.sort(np.sqrt(np.real(np.linalg.eigvals(np.linalg.solve(M, Kmat))))) / 2 / math.pi


def spectrum_peaks(t, x):
    n = 8 * x.size
    A = np.abs(np.fft.rfft((x - x.mean()) * np.hanning(x.size), n))
    f = np.fft.rfftfreq(n, t[1] - t[0])
    i = np.flatnonzero((A[1:-1] > A[:-2]) & (A[1:-1] > A[2:])) + 1
    return np.sort(f[i[np.argsort(A[i])[-2:]]])


@pytest.mark.parametrize("switch", ["link", "near", "base"])
def test_further_modes_stand_at_the_eigenfrequencies(switch):
    w = 2 * math.pi * 95.0
    K, J = KW["K"], KW["J_L"]
    if switch == "base":
        P, S = packed(BASE_SHARE=0.3, BASE_OMEGA=w, BASE_ZETA=0.0)
        modes(S, k.AT_BASE)
        J_B = J / 0.3  # beta'' J_B = K q - J_B w^2 beta ; J (q'' + beta'') = -K q
        expected = eigenfrequencies(np.array([[J, J], [0.0, J_B]]), np.array([[K, 0.0], [-K, J_B * w * w]]))
    else:
        J_b = 0.4
        names = dict(LINK_J=J_b, LINK_OMEGA=w) if switch == "link" else dict(NEAR_J=J_b, NEAR_OMEGA=w)
        P, S = packed(**names)
        modes(S, k.AT_LINK if switch == "link" else k.AT_NEAR)
        expected = eigenfrequencies(np.array([[J, J_b], [J_b, J_b]]), np.array([[K, 0.0], [0.0, J_b * w * w]]))
    t, out = run(P, S, ul=lambda t: 300.0 * np.exp(-(((t - 0.02) / 0.001) ** 2)), duration=4.0)
    tail = t > 0.1
    np.testing.assert_allclose(spectrum_peaks(t[tail], out[tail, k.X_A]), expected, rtol=3e-3)


@pytest.mark.parametrize(("offset", "radius"), [(math.inf, 0.9), (0.35, 0.9), (0.35, 0.5), (0.0, 0.7)])
def test_what_carries_the_joint_is_the_two_body_problem_in_space(offset, radius):
    """Mount that slides (offset infinite) or turns about a parallel axis, against the bodies' own equations of motion.

    Arm of mass m, centre l, J_L about the joint; the joint moves by y = x (slides) or y = d n, the arm also turns by n.
    """
    K, J, mass, com, arm = KW["K"], KW["J_L"], 5.0, 0.4, 30.0
    slides = math.isinf(offset)
    turn, shift = (
        (0.0, 1.0) if slides else (1.0, offset)
    )  # per coordinate: rotation of the arm, motion of the joint
    coupling = J * turn + mass * com * shift
    own = arm + J * turn**2 + 2.0 * mass * com * shift * turn + mass * shift**2
    M = np.array([[J, coupling], [coupling, own]])
    k_n = own * (2.0 * math.pi * 31.0) ** 2
    a, b = (0.0, J / (mass * com)) if slides else (J / coupling, J * shift / coupling)
    assert turn == pytest.approx(a * coupling / J) and shift == pytest.approx(b * coupling / J)
    rest = own * (J / coupling) ** 2 - J  # J_n of the mode in units of the arm's angle
    P, S = packed(
        BASE_SHARE=J / rest, BASE_OMEGA=math.sqrt(k_n * (J / coupling) ** 2 / rest), BASE_HIT=a + b / radius - 1.0
    )
    modes(S, k.AT_BASE)

    def hit(t):
        return 200.0 * np.exp(-(((np.asarray(t) - 0.02) / 0.002) ** 2))

    t, out = run(P, S, ul=lambda t: radius * hit(t), duration=0.3, rate=8192.0)
    ours = radius * (out[:, k.X_A] + (a + b / radius - 1.0) * out[:, k.X_MOUNT])
    lever = np.array([radius, radius * turn + shift])
    stiff = np.diag([K, k_n])

    def f(time, x):
        return np.concatenate([x[2:], np.linalg.solve(M, lever * hit(time) - stiff @ x[:2])])

    found = solve_ivp(
        f, (0.0, float(t[-1])), np.zeros(4), method="DOP853", rtol=1e-9, atol=1e-13, t_eval=t, max_step=1e-3
    ).y
    theirs = np.array([lever @ f(time, x)[2:] for time, x in zip(t, found.T, strict=True)])
    np.testing.assert_allclose(ours, theirs, atol=2e-3 * np.max(np.abs(theirs)))
