"""Each law of friction and transmission in effects.json by a fact in closed form, stepped in MuJoCo the way confirm does it."""

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jointscope.models.effects import augment
from jointscope.sim.effects.transmission import Spring, hysteresis, relaxation

sys.path.insert(0, str(Path(__file__).parent))
from effect_rig import (  # type: ignore[import-not-found]
    ACC,
    ARM,
    BASE,
    J_L,
    J_M,
    RATE,
    W0,
    K,
    N,
    entry,
    frequency,
    hit,
    peaks,
    pushed,
    stepped,
)


@pytest.mark.parametrize(
    "effect",
    [
        entry("coulomb-friction", "load", "plain", torque=4.0),
        entry("stribeck-friction", "load", "gaussian", torque=4.0, breakaway=6.0, stribeck_velocity=1e-4),
    ],
    ids=lambda e: e["effect"],
)
def test_coulomb_takes_the_same_amplitude_from_every_swing_and_then_holds(effect):
    """2 T w_0 / (pi K) per second; a Stribeck peak narrower than any swing's speed changes only the stop."""
    t, A = peaks(stepped(hit(impulse=3.0), effect)[ARM])
    swinging = (t > 0.03) & (A > 4.0 * 4.0 / K)
    slope = np.polyfit(t[swinging], A[swinging], 1)[0]
    assert slope == pytest.approx(-2.0 * 4.0 * W0 / (math.pi * K), rel=0.01)
    held = stepped(hit(impulse=0.3), effect)[("angular-acceleration", "arm")][-200:]
    assert np.max(np.abs(held)) < 1e-3


@pytest.mark.parametrize(
    "law",
    [{"variant": "output-side"}, {"variant": "output-side-rounded", "rounding": 1e-5},
     {"variant": "output-side-presliding", "presliding": 1e-8}],
    ids=lambda law: law["variant"],
)  # fmt: skip
def test_friction_in_proportion_to_the_torque_decays_like_a_loss_factor(law):
    """mu |T_S| loses 2 mu K A^2 a cycle of 1/2 K A^2: A falls by exp(-2 mu) each cycle, at every level."""
    effect = entry("load-dependent-friction", "transmission", coefficient=0.02, **law)
    t, A = peaks(stepped(hit(), effect)[ARM])
    early = (t > 0.03) & (t < 0.8)
    rate = np.polyfit(t[early], np.log(A[early]), 1)[0]
    assert rate == pytest.approx(-2.0 * 0.02 * W0 / (2.0 * math.pi), rel=0.02)


def test_drag_takes_amplitude_by_its_square():
    """1/A grows by 4 c_q w_0 / (3 pi J) per second."""
    c_q = 40.0
    t, A = peaks(stepped(hit(), entry("quadratic-damping", "load", "drag", coefficient=c_q))[ARM])
    after = t > 0.03
    growth = np.polyfit(t[after], 1.0 / A[after], 1)[0]
    assert growth == pytest.approx(4.0 * c_q * W0 / (3.0 * math.pi * J_L), rel=0.01)


def dead_zone(A, half):
    """Describing function over K."""
    r = half / A
    return 1.0 - 2.0 / math.pi * (math.asin(r) + r * math.sqrt(1.0 - r * r))


@pytest.mark.parametrize("variant", ["free-flight", "damped", "sheds"])
def test_play_lowers_the_frequency_by_its_describing_function(variant):
    gap = 2e-4
    x = stepped(hit(), entry("backlash", "transmission", variant, gap=gap))[ARM]
    t, A = peaks(x)
    level = np.median(A[(t > 0.1)])
    expected = math.sqrt(dead_zone(level, 0.5 * gap)) * W0 / (2.0 * math.pi)
    assert frequency(t, x, 0.1, 0.9) == pytest.approx(expected, rel=2e-3)


def test_play_frees_the_damper_inside_only_where_it_is_said_to():
    """In flight the arm keeps its speed without damping, and loses it with the damper's rate c/J when damped."""
    loss = {}
    for variant in ("free-flight", "damped"):
        x = stepped(hit(0.06, 1.0), entry("backlash", "transmission", variant, gap=0.04), damping=60.0)[ARM]
        v = np.diff(x) * RATE
        flying = (x[1:] > 1e-3) & (x[1:] < 0.015)
        loss[variant] = np.polyfit(np.flatnonzero(flying) / RATE, np.log(v[flying]), 1)[0]
    assert abs(loss["free-flight"]) < 0.05
    assert loss["damped"] == pytest.approx(-60.0 / J_L, rel=0.02)


def test_rounded_flanks_give_way_as_hertz_and_do_not_pull():
    """K x^(3/2) / (x + x_h)^(1/2) and c s^fade at a depth x, s = x/(x + x_h); leaving at speed, the torque is none."""
    spring = Spring(
        stiffness=K, damping=60.0, gap=2e-4, gap_damping=0.0, gap_sheds=1.0, gap_round=3e-5, gap_fade=2.0
    )
    for x in (1e-7, 2e-5, 1e-3):
        share = x / (x + 3e-5)
        assert spring.torque(1e-4 + x, 0.0) == pytest.approx(K * x**1.5 / math.sqrt(x + 3e-5))
        assert spring.torque(-1e-4 - x, -0.01) == pytest.approx(-(K * x * math.sqrt(share) + 0.6 * share**2))
    for leaving in (replace(spring, gap_fade=0.5), replace(spring, gap_round=0.0)):
        assert leaving.torque(1e-4 + 1e-7, -1.0) == 0.0 == leaving.torque(5e-5, 1.0)


def test_a_smooth_soft_middle_lowers_the_backbone_by_its_mean_over_a_swing():
    """f^2 falls by share <el^2 d^2/(el^2 + d^2)> / <el^2>, means over a sine: share d^2 (2/A^2) (1 - d/(A^2 + d^2)^(1/2))."""
    share, d = 0.2, 3e-4
    x = stepped(
        hit(), entry("stiffness-nonlinearity", "transmission", "smooth", soft_share=share, transition_angle=d)
    )[ARM]
    t, A = peaks(x)
    level = float(np.median(A[t > 0.1]))
    less = share * 2.0 * (d / level) ** 2 * (1.0 - d / math.hypot(level, d))
    assert frequency(t, x, 0.1, 0.9) == pytest.approx(math.sqrt(1.0 - less) * W0 / (2.0 * math.pi), rel=3e-3)


@pytest.mark.parametrize("exponent", [1.6, 3.0])
def test_a_power_bends_the_backbone_by_its_mean_over_a_swing(exponent):
    """f^2 rises by growth (A/d)^(p-1) 2 <|sin|^(p+1)>; p = 3 is a cubic, whose mean is 3/8."""
    growth, d = 0.005, 3e-4
    values = dict(growth=growth, exponent=exponent, reference_angle=d)
    x = stepped(hit(), entry("stiffness-nonlinearity", "transmission", "power", **values))[ARM]
    t, A = peaks(x)
    swing = np.abs(np.sin(np.linspace(0.0, 2.0 * math.pi, 4001)[1:]))
    more = (
        growth
        * float(np.mean((A[t > 0.1] / d) ** (exponent - 1.0)))
        * 2.0
        * float(np.mean(swing ** (exponent + 1.0)))
    )
    assert frequency(t, x, 0.1, 0.9) == pytest.approx(math.sqrt(1.0 + more) * W0 / (2.0 * math.pi), rel=3e-3)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_cubic_bends_the_backbone_by_three_eighths(sign):
    k3 = sign * 2e10
    x = stepped(hit(impulse=0.6), entry("stiffness-nonlinearity", "transmission", "cubic", cubic=k3))[ARM]
    t, A = peaks(x)
    level = float(np.median(A[t > 0.1]))
    shift = frequency(t, x, 0.1, 0.9) / (W0 / (2.0 * math.pi)) - 1.0
    assert shift == pytest.approx(3.0 * k3 * level**2 / (8.0 * K), rel=0.03)


def loop(form, cycles=2, points=4000, amplitude=3e-4):
    law = hysteresis({"torque": 8.0, "angle": 8e-5, "form": form})
    phase = np.linspace(0.0, 2.0 * math.pi * cycles, cycles * points + 1)
    delta = amplitude * np.sin(phase)
    torque = np.array([law(float(p), float(d), 0.0) for p, d in zip(phase, delta, strict=True)])
    return delta[-points - 1 :], torque[-points - 1 :]


@pytest.mark.parametrize("form", ["bouc-wen", "dahl"])
def test_a_loop_closes_is_odd_and_its_area_does_not_depend_on_the_rate(form):
    delta, torque = loop(form)
    assert torque[0] == pytest.approx(torque[-1], rel=1e-3)
    half = len(torque) // 2
    assert torque[half:-1] == pytest.approx(-torque[:half], abs=0.02)
    area = np.trapezoid(torque, delta)
    assert area == pytest.approx(np.trapezoid(*reversed(loop(form, points=500))), rel=1e-3)
    assert 0.5 * 4.0 * 8.0 * 3e-4 < area < 4.0 * 8.0 * 3e-4  # below a Coulomb rectangle
    assert np.max(torque) == pytest.approx(8.0, rel=0.03)


@pytest.mark.parametrize("shape", [-1.4, -0.5, 1.0])
def test_a_shaped_loop_follows_bouc_and_wens_equation_with_exact_exponentials(shape):
    """Loaded from rest z = (1 - exp(-p x))/p with p = 1 + shape, and back with m = 1 - shape until z = 0."""
    law = hysteresis({"torque": 8.0, "angle": 8e-5, "form": "bouc-wen-shaped", "shape": shape})
    law(0.0, 0.0, 0.0)
    loading, unloading = 1.0 + shape, 1.0 - shape
    up = law(1e-4, 8e-5, 0.0) / 8.0
    assert up == pytest.approx(-math.expm1(-loading) / loading, rel=1e-4)
    down = law(2e-4, 8e-5 - 2e-5, 0.0) / 8.0
    exact = up - 0.25 if unloading == 0.0 else 1.0 / unloading
    if unloading:
        exact = -((-up - exact) * math.exp(-unloading * 0.25) + exact)
    assert down == pytest.approx(exact, rel=1e-3)


def test_hysteresis_starts_unloaded_with_the_slope_of_its_stiffness():
    for form in ("bouc-wen", "dahl"):
        law = hysteresis({"torque": 8.0, "angle": 8e-5, "form": form})
        assert law(0.0, 1e-3, 0.0) == 0.0
        assert law(1e-4, 1e-3 + 8e-8, 0.0) == pytest.approx(8.0 / 8e-5 * 8e-8, rel=1e-3)


@pytest.mark.parametrize("law", [{"variant": "maxwell-slip"}, {"variant": "slip-spread", "spread": 3.0}], ids=str)
def test_slipping_elements_stiffen_small_motion_by_their_sum_and_yield_at_the_torque(law):
    """Below the first slip the frequency is that of K + stiffness; far above, that of K."""
    law = dict(law)
    slip = entry("hysteresis", "transmission", law.pop("variant"), torque=8.0, stiffness=1e5, **law)
    x = stepped(hit(impulse=0.01), slip)[ARM]
    assert frequency(*peaks(x), 0.05, 0.9) == pytest.approx(math.sqrt(3e5 / J_L) / (2.0 * math.pi), rel=1e-3)
    t, A = peaks(stepped(hit(impulse=6.0), slip)[ARM])
    early = (t > 0.03) & (A > 1.5e-3)
    slope = np.polyfit(t[early], A[early], 1)[0]
    assert slope == pytest.approx(-2.0 * 8.0 * W0 / (math.pi * K), rel=0.1)


def test_relaxation_branches_have_a_flat_loss_factor():
    omega = W0
    plate = {"topology": "two-inertia", "motion": "rotational", "reduction_ratio": N}
    effect = entry("structural-damping", "transmission", "relaxation", loss_factor=0.05)
    built = augment({"kind": "diagnosis", "rig": plate, "base": BASE, "effects": [effect]})
    (law,) = built.description["laws"]
    for w in (omega / 5.0, omega, omega * 5.0):
        part, n = relaxation(law), 2000
        t = np.arange(40 * n + 1) * (2.0 * math.pi / w / n)
        delta = np.sin(w * t)
        torque = np.array([part(float(a), float(b), 0.0) for a, b in zip(t, delta, strict=True)])[-n - 1 :]
        x = delta[-n - 1 :]
        loss = np.trapezoid(torque, x) / math.pi
        assert loss / K == pytest.approx(0.05, rel=0.005 if w == omega else 0.07)
        if w == omega:
            storage = 2.0 / n * float(torque[:-1] @ x[:-1])
            assert built.description["spring"]["stiffness"] + storage == pytest.approx(K, rel=1e-3)


@pytest.mark.parametrize("variant", ["relaxation", "rate-independent"])
def test_structural_damping_leaves_the_frequency_and_halves_the_loss_factor(variant):
    x = stepped(hit(), entry("structural-damping", "transmission", variant, loss_factor=0.03))[ARM]
    t, A = peaks(x)
    early = (t > 0.03) & (t < 0.6)
    assert frequency(t, x, 0.03, 0.6) == pytest.approx(W0 / (2.0 * math.pi), rel=3e-3)
    assert np.polyfit(t[early], np.log(A[early]), 1)[0] == pytest.approx(-0.5 * 0.03 * W0, rel=0.03)


def test_drift_raises_the_frequency_within_the_run_and_from_run_to_run():
    x = stepped(hit(2.0), entry("stiffness-drift", "transmission", "in-run", rate=0.04))[ARM]
    t, _ = peaks(x)
    for low in (0.1, 1.5):
        middle = 1.0 + 0.04 * (low + 0.2)
        assert frequency(t, x, low, low + 0.4) == pytest.approx(math.sqrt(middle) * W0 / (2.0 * math.pi), rel=3e-3)
    for weight in (0.0, 3.0):
        drift = entry("stiffness-drift", "transmission", "per-run", {"a": weight}, rate=0.02)
        x = stepped(hit(), drift)[ARM]
        expected = math.sqrt(1.0 + 0.02 * weight) * W0 / (2.0 * math.pi)
        assert frequency(*peaks(x), 0.05, 0.9) == pytest.approx(expected, rel=1e-3)


def test_kinematic_error_shakes_the_arm_at_order_times_speed_with_the_linear_joints_gain():
    """Wind-up a sin(order angle): arm and motor feel K times it, opposite; the whole rig's momentum is unmoved."""
    a, order, speed = 2e-5, 1.0, 1.2
    t = np.arange(round(1.5 * RATE)) / RATE
    torque = np.where(t < 0.3, speed / 0.3 * (J_L + J_M) / N, 0.0)
    found = stepped(
        pushed(torque), entry("transmission-error", "transmission", "motor-order", amplitude=a, order=order, phase=0.0),
        damping=400.0,
    )  # fmt: skip
    w = order * N * speed
    late = t > 0.8
    line = np.exp(-1j * w * t[late])
    window = np.hanning(late.sum())
    arm = 2.0 * abs(np.sum(window * line * found[ACC][late])) / window.sum()
    s = 1j * w
    joint = K + 400.0 * s
    reduced = J_L * J_M / (J_L + J_M)
    expected = abs(a * joint * (reduced / J_L) * s**2 / (reduced * s**2 + joint))
    assert arm == pytest.approx(expected, rel=0.03)
