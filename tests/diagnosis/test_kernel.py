"""The compiled joint obeys mechanics: closed forms, conservation, convergence, and another integrator."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jointscope.diagnosis import kernel as k
from jointscope.diagnosis.effects.transmission import branches
from jointscope.diagnosis.kernel.compiled import SOURCES, digest
from jointscope.diagnosis.kernel.scalar_steps import FREE

sys.path.insert(0, str(Path(__file__).parent))
from packed_joint import KW, W0, modes, packed, run  # type: ignore[import-not-found]


def peaks(t, q):
    """Times and heights of the maxima of |q|, by parabolas."""
    a = np.abs(q)
    i = np.flatnonzero((a[1:-1] >= a[:-2]) & (a[1:-1] > a[2:])) + 1
    d = 0.5 * (a[i - 1] - a[i + 1]) / (a[i - 1] - 2 * a[i] + a[i + 1])
    return t[i] + d * (t[1] - t[0]), a[i] - 0.25 * (a[i - 1] - a[i + 1]) * d


def crossings(t, q):
    i = np.flatnonzero(q[:-1] * q[1:] < 0)
    return t[i] - q[i] * (t[i + 1] - t[i]) / (q[i + 1] - q[i])


def frequency(t, q):
    c = crossings(t, q)
    return (len(c) - 1) / 2.0 / (c[-1] - c[0])


def test_undamped_joint_conserves_energy():
    P, S = packed(MOTOR=k.MOTOR_FREE)
    _, out = run(P, S, x=(1e-3, 0.0, 0.0, 0.2), duration=2.0)
    energy = 0.5 * (
        9.1 * out[:, k.X_VS] ** 2 + 3.0 * out[:, k.X_V] ** 2 + 1.9e5 * (out[:, k.X_QS] - out[:, k.X_Q]) ** 2
    )
    assert np.ptp(energy) / energy[0] < 2e-4  # Runge-Kutta loses (w h)^6/144 per step
    momentum = 9.1 * out[:, k.X_VS] + 3.0 * out[:, k.X_V]
    assert np.ptp(momentum) < 1e-11


@pytest.mark.parametrize(("per_motor", "per_load"), [(200.0, 0.0), (0.0, 60.0)])
@pytest.mark.parametrize("loop", [False, True])
def test_a_kinematic_error_that_reacts_does_no_work(per_motor, per_load, loop):
    """With T_S handed on by dDelta/dq_s and dDelta/dq the energy of inertias and spring is kept; without it is not.

    By the scalar stepper, and by the one with a state vector (a loop that does nothing makes it step so).
    """
    line = {"TE_0": 4e-5, "TE_0+1": per_motor, "TE_0+2": per_load}

    def drift(reacts):
        P, S = packed(MOTOR=k.MOTOR_FREE, N_TE=1, TE_REACTS=reacts)
        for offset, value in enumerate(line.values()):
            P[k.TE_0 + offset] = value
        x = (1e-3, 0.6, 0.0, 0.6)
        if loop:
            S[k.AT_LOOP], S[k.N_X] = 4, 5
            x = (*x, 0.0)
        _, out = run(P, S, x=x, duration=1.0, rate=8000.0)
        q_s, q = out[:, k.X_QS], out[:, k.X_Q]
        error = 4e-5 * np.sin(per_motor * q_s + per_load * q)
        energy = 0.5 * (9.1 * out[:, k.X_VS] ** 2 + 3.0 * out[:, k.X_V] ** 2 + 1.9e5 * (q_s + error - q) ** 2)
        return np.ptp(energy) / energy[0]

    assert drift(1.0) < 1e-5 < 1e-4 < drift(0.0)


def test_error_falls_with_the_fourth_power_of_the_step():
    P, S = packed(MOTOR=k.MOTOR_FREE, C=40.0, K_3=2e10)
    force = lambda t: 200.0 * np.exp(-(((t - 0.05) / 0.01) ** 2))  # noqa: E731
    ends = [run(P, S, ul=force, duration=0.3, rate=rate)[1][-1, :5] for rate in (1000.0, 2000.0, 4000.0, 16000.0)]
    errors = [np.abs(e - ends[-1])[[0, 3]].max() for e in ends[:-1]]
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(orders > 3.6), orders


@pytest.mark.parametrize(
    ("numbers", "law"),
    [
        ({}, lambda q_s, v_s, q, v: (0.0, 0.0, 0.0)),
        ({"K_3": 3e10}, lambda q_s, v_s, q, v: (3e10 * (q_s - q) ** 3, 0.0, 0.0)),
        ({"C_QUADRATIC": 60.0}, lambda q_s, v_s, q, v: (0.0, 0.0, -60.0 * v * abs(v))),
        ({"G_COS": 30.0}, lambda q_s, v_s, q, v: (0.0, 0.0, -30.0 * math.cos(q))),
        (
            {"K_SOFT": 5e4, "SOFT_ANGLE": 2e-4},
            lambda q_s, v_s, q, v: (-5e4 * min(max(q_s - q, -2e-4), 2e-4), 0.0, 0.0),
        ),
        (
            {"STOP_ANGLE": 5e-4, "STOP_K": 1e5},
            lambda q_s, v_s, q, v: (0.0, 0.0, -1e5 * max(q - 5e-4, 0.0)),
        ),
    ],
)
def test_agrees_with_lsoda(numbers, law):
    P, S = packed(MOTOR=k.MOTOR_FREE, C=40.0, B_M=3.0, B_L=2.0, **numbers)
    force = lambda t: 200.0 * np.exp(-(((t - 0.05) / 0.006) ** 2))  # noqa: E731
    motor = lambda t: 30.0 * np.sin(2 * np.pi * 11.0 * t)  # noqa: E731
    t, out = run(P, S, ul=force, um=motor, duration=0.3)

    def f(u, x):
        q_s, v_s, q, v = x
        extra, m, arm = law(q_s, v_s, q, v)
        T = 1.9e5 * (q_s - q) + 40.0 * (v_s - v) + extra
        return [v_s, (motor(u) - T - 3.0 * v_s + m) / 9.1, v, (T + force(u) - 2.0 * v + arm) / 3.0]

    reference = solve_ivp(
        f, (0, t[-1]), np.zeros(4), method="LSODA", rtol=1e-9, atol=1e-12, max_step=2e-3, t_eval=t
    ).y
    for column, row in ((k.X_QS, 0), (k.X_Q, 2)):
        assert np.abs(out[:, column] - reference[row]).max() < 2e-5 * np.ptp(reference[row])


DRY = dict(FM_PLUS=2.0, FM_MINUS=2.5, FL_PLUS=1.0, FL_MINUS=1.0, FL_EXCESS=0.5, FRICTION_M=1, FRICTION_L=1)
BRISTLES = dict(PRE_TORQUE=4.0, PRE_ANGLE=2e-5, PRE_EXCESS=0.4, PRE_SPEED=0.01, PRE_SIDED=0.1)
MODE = dict(LINK_J=0.3, LINK_OMEGA=560.0, LINK_ZETA=0.02, LINK_HIT=0.5, NEAR_J=0.3, NEAR_OMEGA=300.0, BASE_SHARE=0.2,
            BASE_OMEGA=140.0, BASE_ZETA=0.02)  # fmt: skip


@pytest.mark.parametrize("motor", [k.MOTOR_FREE, k.MOTOR_HELD])
@pytest.mark.parametrize(
    ("numbers", "switch"),
    [
        (dict(GAP_HALF=2e-5, **DRY), None),
        (dict(HYST_TORQUE=5.0, HYST_ANGLE=5e-5, HYST_KIND=k.BOUC_WEN, **DRY), None),
        (dict(HYST_TORQUE=5.0, HYST_ANGLE=5e-5, HYST_KIND=k.MAXWELL_SLIP), None),
        (dict(N_TE=1, N_RIPPLE=1, REID=0.05, REID_OMEGA=250.0), None),
        (dict(PRE_SITE=k.AT_MOTOR, **BRISTLES), None),
        (dict(PRE_SITE=k.AT_LOAD, **BRISTLES, **DRY), None),
        (dict(PRE_SITE=k.AT_MOTOR, PRE_LOAD=0.1, PRE_ANGLE=2e-5, ROUND_L_LOAD=0.05, ROUND_L_SPEED=0.02), None),
        (dict(PRE_SITE=k.AT_LOAD, PRE_LOAD=0.1, PRE_ANGLE=2e-5, ROUND_M_LOAD=0.05, ROUND_M_SPEED=0.02), None),
        (
            dict(
                ROUND_M_LOAD=0.1,
                ROUND_M_SPEED=0.02,
                ROUND_M_QUADRANT=0.3,
                ROUND_L_LOAD=0.05,
                ROUND_L_SPEED=0.02,
                ROUND_L_QUADRANT=-0.2,
            ),
            None,
        ),
        (dict(PAR_SHARE=0.1, PAR_MOTOR=5.0, PAR_LOAD=3.0, PAR_PHASE=0.4, RUB=2e5), None),
        (MODE | DRY, k.AT_LINK),
        (MODE, k.AT_NEAR),
        (MODE | DRY, k.AT_BASE),
        (dict(N_BRANCH=5, **DRY), k.AT_BRANCH),
        (dict(N_BRANCH=3), k.AT_BRANCH),
        (MODE | DRY | dict(N_BRANCH=5), k.AT_LINK),
        (MODE | dict(N_BRANCH=5), k.AT_BASE),
    ],
)
def test_the_scalar_kernels_and_the_full_one_are_one_model(numbers, switch, motor):
    """The fast paths give the motion of the path that holds every law, for all laws that they share."""
    P, S = packed(MOTOR=motor, C=40.0, G_COS=10.0, OBS_1=30.0, OBS_2=355.0, OBS_QS=1.0, **numbers)
    P[k.TE_0 : k.TE_0 + 4] = (3e-5, 141.0, 0.0, 0.3)
    P[k.RIPPLE_0 : k.RIPPLE_0 + 4] = (2.0, 0.02, 141.0, 0.3)
    if switch is not None and switch != k.AT_BRANCH:
        modes(S, switch)
    if S[k.N_BRANCH]:
        S[k.AT_BRANCH], S[k.N_X] = S[k.N_X], S[k.N_X] + S[k.N_BRANCH]
        P[k.BRANCH_0 : k.BRANCH_0 + 10 : 2], P[k.BRANCH_0 + 1 : k.BRANCH_0 + 10 : 2] = (
            4e3,
            1e-3 * 2.0 ** np.arange(5),
        )
    n, rate = 2048, 4096.0
    t = np.arange(2 * n + 1) / (2 * rate)
    um, ul = 30.0 * np.sin(2 * np.pi * 11.0 * t), 200.0 * np.exp(-(((t - 0.05) / 0.006) ** 2))
    y, w = 1e-3 * np.sin(7 * t), np.zeros(t.size)
    results = []
    for integrate in (k.simulate, k.simulate_full):
        out = np.zeros((n + 1, k.N_OUT))
        integrate(np.zeros(int(S[k.N_X])), P, S, um, ul, y, w, 0.0, 1 / rate, out)
        results.append(out)
    fast, full = results
    for column in (k.X_QS, k.X_Q, k.X_AS, k.X_A, k.X_LINK, k.X_TS, k.X_TAU):
        assert np.abs(fast[:, column] - full[:, column]).max() <= 1e-6 * np.abs(full[:, column]).max()


def test_coulomb_friction_takes_a_constant_amplitude_per_second():
    """dA/dt = -2 T w0/(pi K) whatever the amplitude; the frequency stays; the end is rest within +-T/K."""
    T = 1.5
    P, S = packed(FL_PLUS=T, FL_MINUS=T, FRICTION_L=1)
    t, out = run(P, S, x=(0, 0, 1e-3, 0), duration=1.5)
    q = out[:, k.X_Q]
    times, heights = peaks(t, q)
    early, late = heights > 4e-4, (heights < 4e-4) & (heights > 1e-4)
    for part in (early, late):
        slope = np.polyfit(times[part], heights[part], 1)[0]
        assert slope == pytest.approx(-2 * T * W0 / (math.pi * KW["K"]), rel=2e-3)
    assert frequency(t[times.searchsorted(0) : 600], q[:600]) == pytest.approx(W0 / 2 / math.pi, rel=1e-3)
    assert abs(q[-1]) <= T / KW["K"] and np.ptp(q[-200:]) == 0.0


def test_asymmetric_friction_is_friction_plus_a_constant_torque():
    P, S = packed(MOTOR=k.MOTOR_FREE, K=0.0, FM_PLUS=6.0, FM_MINUS=4.0, FRICTION_M=1)
    Q, R = packed(MOTOR=k.MOTOR_FREE, K=0.0, FM_PLUS=5.0, FM_MINUS=5.0, FRICTION_M=1)
    drive = lambda t: 20.0 * np.sin(2 * np.pi * 2.0 * t)  # noqa: E731
    _, a = run(P, S, um=drive)
    _, b = run(Q, R, um=lambda t: drive(t) - 1.0)
    moving = (np.abs(a[:, k.X_VS]) > 0.02) & (np.abs(b[:, k.X_VS]) > 0.02)
    np.testing.assert_allclose(a[moving, k.X_AS], b[moving, k.X_AS], atol=1e-9)


def test_stuck_until_breakaway_then_accelerated_by_the_excess():
    """Below the breakaway torque nothing moves at all; above it a = (tau - T)/J."""
    P, S = packed(MOTOR=k.MOTOR_FREE, K=0.0, FM_PLUS=5.0, FM_MINUS=5.0, FM_EXCESS=0.6, FM_SPEED=1e-4, FRICTION_M=1)
    t, out = run(P, S, um=lambda t: 10.0 * t)
    start = t[np.flatnonzero(out[:, k.X_VS] > 0)[0]]
    assert start == pytest.approx(0.8, abs=1e-3)
    assert np.all(out[t < 0.799, k.X_QS] == 0.0)
    late = t > 0.9
    np.testing.assert_allclose(out[late, k.X_AS], (10.0 * t[late] - 5.0) / 9.1, rtol=1e-6)


def test_a_sliding_mass_stops_where_energy_says():
    """v0^2 J/(2 T) of path, and exact rest."""
    P, S = packed(K=0.0, FL_PLUS=3.0, FL_MINUS=3.0, FRICTION_L=1)
    _, out = run(P, S, x=(0, 0, 0, 0.5), duration=1.0)
    assert out[-1, k.X_Q] == pytest.approx(0.25 * 3.0 / (2 * 3.0), rel=1e-6)
    assert out[-1, k.X_V] == 0.0


def test_quadratic_drag_decays_with_the_square():
    """d(1/A)/dt = 4 c_q w0/(3 pi J)."""
    P, S = packed(C_QUADRATIC=50.0)
    t, out = run(P, S, x=(0, 0, 1e-3, 0), duration=1.0)
    times, heights = peaks(t, out[:, k.X_Q])
    slope = np.polyfit(times, 1.0 / heights, 1)[0]
    assert slope == pytest.approx(4 * 50.0 * W0 / (3 * math.pi * 3.0), rel=5e-3)


@pytest.mark.parametrize("amplitude", [2e-4, 5e-4, 1e-3])
def test_backlash_backbone_is_the_dead_zones_describing_function(amplitude):
    """f(A) = f0 sqrt(N(A)/K), N the dead zone's describing function (A measured in the spring and the play)."""
    gap = 1e-4
    P, S = packed(GAP_HALF=0.5 * gap, GAP_DAMPING=1.0)
    t, out = run(P, S, x=(0, 0, amplitude, 0), duration=1.0, rate=16384.0)
    r = 0.5 * gap / amplitude
    N = 1 - 2 / math.pi * (math.asin(r) + r * math.sqrt(1 - r * r))
    # the describing function is first-order; the exact period is the arcs in contact plus the free flights
    contact, flight = math.pi / W0 * 2, 4 * (0.5 * gap) / ((amplitude - 0.5 * gap) * W0)
    assert frequency(t, out[:, k.X_Q]) == pytest.approx(1 / (contact + flight), rel=2e-4)
    assert frequency(t, out[:, k.X_Q]) == pytest.approx(W0 / 2 / math.pi * math.sqrt(N), rel=0.02)


@pytest.mark.parametrize("share", [0.2, -0.3])
def test_a_smooth_soft_middle_lowers_the_backbone_by_its_mean_over_a_swing(share):
    """f(A)^2 = f0^2 (1 - 2 share (d/A)^2 (1 - d/(A^2 + d^2)^(1/2))): harmonic balance, to first order in the share."""
    A, d = 6e-4, 3e-4
    P, S = packed(K_SOFT=share * KW["K"], SOFT_ANGLE=d, SOFT_SMOOTH=1.0)
    t, out = run(P, S, x=(0, 0, A, 0), duration=1.0)
    less = share * 2.0 * (d / A) ** 2 * (1.0 - d / math.hypot(A, d))
    assert frequency(t, out[:, k.X_Q]) == pytest.approx(math.sqrt(1.0 - less) * W0 / 2 / math.pi, rel=2e-3)


@pytest.mark.parametrize("exponent", [1.6, 3.0])
def test_a_power_bends_the_backbone_by_its_mean_over_a_swing(exponent):
    """f^2 rises by growth (A/d)^(p-1) 2 <|sin|^(p+1)>; p = 3 is a cubic, whose mean is 3/8."""
    A, d, growth = 6e-4, 3e-4, 0.02
    P, S = packed(POW_K=growth * KW["K"], POW_ANGLE=d, POW_EXPONENT=exponent)
    t, out = run(P, S, x=(0, 0, A, 0), duration=1.0)
    swing = np.abs(np.sin(np.linspace(0.0, 2.0 * math.pi, 4001)[1:]))
    more = growth * (A / d) ** (exponent - 1.0) * 2.0 * float(np.mean(swing ** (exponent + 1.0)))
    assert frequency(t, out[:, k.X_Q]) == pytest.approx(math.sqrt(1.0 + more) * W0 / 2 / math.pi, rel=1e-3)
    P, S = packed(POW_K=0.0, POW_ANGLE=d, POW_EXPONENT=exponent)
    assert np.array_equal(run(P, S, x=(0, 0, A, 0))[1], run(*packed(), x=(0, 0, A, 0))[1])


def test_cubic_backbone():
    """f(A) = f0 (1 + 3 k3 A^2/(8 K)) for small k3 A^2/K."""
    A, k3 = 1e-3, 6e9
    P, S = packed(K_3=k3)
    t, out = run(P, S, x=(0, 0, A, 0), duration=1.0)
    assert frequency(t, out[:, k.X_Q]) == pytest.approx(
        W0 / 2 / math.pi * (1 + 3 * k3 * A * A / (8 * KW["K"])), rel=2e-4
    )


def test_structural_branches_have_a_flat_loss_factor():
    """Im/Re of the branches' stiffness is eta K/K within 7 % over 0.2 to 5 times the resonance, and storage is K there."""
    omega = 250.0
    stiffness, times, storage = branches(0.05, 1.9e5, omega)
    w = omega * np.geomspace(0.2, 5.0, 41)
    s = 1j * w[:, None] * times
    G = (stiffness * s / (1 + s)).sum(axis=1) + 1.9e5 - storage
    np.testing.assert_allclose(G.imag, 0.05 * 1.9e5, rtol=0.07)
    at = np.interp(omega, w, G.real)
    assert at == pytest.approx(1.9e5, rel=1e-4)


def test_rate_independent_structural_law_loses_the_same_share_at_any_amplitude():
    """zeta = eta/2 at 1e-3 and 1e-5 rad alike."""
    for A in (1e-3, 1e-5):
        P, S = packed(REID=0.5 * math.pi * 0.04, REID_OMEGA=W0)
        t, out = run(P, S, x=(0, 0, A, 0), duration=0.6)
        times, heights = peaks(t, out[:, k.X_Q])
        zeta = -np.polyfit(times, np.log(heights), 1)[0] / W0
        assert zeta == pytest.approx(0.02, rel=0.03)


def test_load_dependent_friction_differs_by_the_direction_of_power():
    """Driving, the motor needs (1 + mu) of the load torque; braking, (1 - mu)."""
    for v0, expected in ((0.5, 1.1), (-0.5, 0.9)):
        P, S = packed(MOTOR=k.MOTOR_FREE, C=300.0, FM_LOAD=0.1, FRICTION_M=1, G_CONST=40.0)
        _t, out = run(
            P, S, um=lambda t, e=expected: np.full(t.size, 40.0 * e), x=(40.0 / 1.9e5, v0, 0, v0), duration=0.4
        )
        assert out[-1, k.X_VS] == pytest.approx(v0, abs=2e-3)


def test_prescribed_load_returns_the_force_that_the_motion_took():
    """Inverse of forward: the force fed in comes out along the motion that it made."""
    drive = lambda t: 30.0 * np.sin(2 * np.pi * 1.5 * t)  # noqa: E731
    P, S = packed(K=0.0, B_L=4.0, FL_PLUS=3.0, FL_MINUS=3.0, FRICTION_L=1)
    t, out = run(P, S, ul=drive, duration=2.0)
    Q, R = packed(K=0.0, B_L=4.0, FL_PLUS=3.0, FL_MINUS=3.0, FRICTION_L=1, LOAD_PRESCRIBED=1)
    half = np.repeat(out, 2, axis=0)[: 2 * len(t) - 1]
    back = np.zeros_like(out)
    k.simulate(np.zeros(4), Q, R, half[:, k.X_A].copy(), np.zeros(len(half)), half[:, k.X_Q].copy(),
               half[:, k.X_V].copy(), 0.0, t[1], back)  # fmt: skip
    moving = np.abs(out[:, k.X_V]) > 1e-3
    np.testing.assert_allclose(back[moving, k.X_TEXT], drive(t)[moving], atol=1e-9)


def test_observer_follows_the_rigid_body_and_leaves_the_wind_up_alone():
    """A constant angle offset is forgotten within a second; the wind-up never notices."""
    w = 2 * math.pi * 3.0
    P, S = packed(MOTOR=k.MOTOR_FREE, C=40.0, OBS_1=1.6 * w, OBS_2=w * w, OBS_QS=1.0)
    _t, out = run(P, S, y=lambda t: np.full(t.size, 0.1))
    assert out[-1, k.X_QS] == pytest.approx(0.1, abs=1e-6)
    assert np.abs(out[:, k.X_QS] - out[:, k.X_Q]).max() < 1e-12


def test_a_change_in_any_file_of_the_kernel_compiles_it_anew(tmp_path):
    """Compiled code is kept under a digest of all its sources, of those that it only calls too."""
    for name in ("laws", "steps"):
        (tmp_path / f"{name}.py").write_text(f"{name} = 1\n")
    before = digest(tmp_path)
    assert digest(tmp_path) == before
    (tmp_path / "laws.py").write_text("laws = 2\n")
    assert digest(tmp_path) != before
    run(*packed(), duration=0.01)
    kept = Path(FREE[0].stats.cache_path).glob("*.nbi")
    assert any(FREE[0].__name__ in file.name and SOURCES in file.name for file in kept)


@pytest.mark.parametrize("motor", [k.MOTOR_FREE, k.MOTOR_HELD])
@pytest.mark.parametrize(
    "law",
    [
        {},
        {"POW_K": 100.0, "POW_ANGLE": 1e-3, "POW_EXPONENT": 1.5},
        {"ROUND_L": 1.0, "ROUND_L_SPEED": 0.1},
        {"HYST_KIND": k.BOUC_WEN, "HYST_TORQUE": 1.0, "HYST_ANGLE": 1e-3},
        {"N_RIPPLE": 1, "RIPPLE_0": 1.0},
    ],
)
def test_a_joint_moves_alike_whatever_else_its_stepper_holds(monkeypatch, law, motor):
    """What is left out when a stepper is compiled is what the joint does not have."""
    started = (1e-3, 0.0, 0.0, 0.1)
    _, own = run(*packed(MOTOR=motor, **law), x=started, duration=0.1)
    monkeypatch.setattr(k, "what_it_needs", lambda P, S: (0, k.HAS_ALL))
    _, all_laws = run(*packed(MOTOR=motor, **law), x=started, duration=0.1)
    np.testing.assert_allclose(own, all_laws, rtol=1e-9, atol=1e-9 * np.max(np.abs(own)))
