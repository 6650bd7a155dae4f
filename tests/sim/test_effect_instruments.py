"""Each law of drive and instruments in effects.json by its transfer function, stepped in MuJoCo the way confirm does it."""

import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lsim

from jointscope.errors import RefusedError
from jointscope.models.effects import augment
from jointscope.recordings.campaign import Campaign
from jointscope.sim.effects import physics_of
from jointscope.sim.effects.torque_log import relogged
from jointscope.sim.replay import replay_run

sys.path.insert(0, str(Path(__file__).parent))
from effect_rig import (  # type: ignore[import-not-found]
    ACC,
    ARM,
    BASE,
    FLAT,
    J_L,
    MOTOR,
    RATE,
    UPRIGHT,
    H,
    N,
    channel,
    entry,
    hit,
    pushed,
    ratio,
    run_of,
    stepped,
    tone,
)


def test_a_lag_is_first_order_and_a_gain_is_a_gain():
    found = ratio(entry("drive-lag", "motor", "first-order", time_constant=2e-3), 30.0)
    assert found == pytest.approx(1.0 / (1.0 + 2j * math.pi * 30.0 * 2e-3), rel=5e-3)
    assert ratio(entry("torque-gain", "motor", "constant", gain=1.1), 30.0) == pytest.approx(1.1, rel=1e-6)


def test_cogging_holds_its_torque_by_position_and_ripple_by_position_and_torque():
    """At a standstill position the extra torque is a sin(order n q + phase), or share of what the motor gives."""
    t, torque = np.arange(200) / RATE, np.full(200, 0.5)
    run = pushed(torque)
    tau = 0.5 * N
    for effect, extra in (
        (entry("torque-ripple", "motor", "cogging", amplitude=5.0, order=1.0, phase=0.5), 5.0 * math.sin(0.5)),
        (
            entry("torque-ripple", "motor", "load-proportional", share=0.1, order=1.0, phase=0.5),
            0.1 * tau * math.sin(0.5),
        ),
    ):
        first = stepped(run, effect)[MOTOR][8] / N  # 4 ms: hardly moved
        assert first / (stepped(run)[MOTOR][8] / N) == pytest.approx((tau + extra) / tau, rel=2e-2)
    assert t.size == torque.size


def test_a_late_devices_torque_acted_earlier_than_it_is_stamped():
    """delay > 0: phase + w delay of the DAQ's response against the logged torque, gain 1; and the encoder is late."""
    f, delay = 30.0, 2e-3
    effect = entry("delay", "acquisition", "constant", delay=delay)
    assert ratio(effect, f, every=2) == pytest.approx(np.exp(2j * math.pi * f * delay), rel=1e-3)
    run = pushed(tone(f)[1], every=2)
    base, late = (stepped(run, *effects, damping=200.0)[MOTOR] for effects in ((), (effect,)))
    moved = slice(20, -20)
    assert late[moved] == pytest.approx(base[moved], abs=1e-3 * np.ptp(base))  # torque and encoder share the clock


def test_a_late_arm_encoder_leaves_the_motors_angle_and_the_accelerometer_alone():
    run = pushed(tone(30.0)[1])
    effect = entry("delay", "acquisition", "encoder", delay=3.0 / RATE)
    base, late = stepped(run), stepped(run, effect)
    for key in (MOTOR, ACC):
        assert late[key] == pytest.approx(base[key], abs=1e-9 * np.ptp(base[key]))
    angle = ("angle", "arm")
    assert late[angle][3:] == pytest.approx(base[angle][:-3], abs=1e-4 * np.ptp(base[angle]))


def test_a_fast_clocks_stamps_run_ahead_in_proportion():
    f = 30.0
    t, torque = tone(f, 2.0)
    run = pushed(torque, every=1)
    base, fast = (
        stepped(run, *effects, damping=200.0)[ACC]
        for effects in ((), (entry("clock-drift", "acquisition", "", ppm=500.0),))
    )
    late = t > 1.8
    line = np.exp(-2j * math.pi * f * t[late]) * np.hanning(late.sum())
    phase = np.angle((line @ fast[late]) / (line @ base[late]))
    assert phase == pytest.approx(2.0 * math.pi * f * 500e-6 * 1.9, rel=0.02)


def test_accelerometer_faults_by_their_transfer_functions():
    f, t = 30.0, tone(30.0)[0]
    s = 2j * math.pi * f
    for effect, expected in (
        (entry("sensor-gain", "acquisition", "accelerometer", gain=1.07), 1.07),
        (
            entry("sensor-resonance", "acquisition", "bandwidth", frequency=80.0),
            1.0 / (1.0 + s / (2.0 * math.pi * 80.0)),
        ),
        (
            entry("sensor-resonance", "acquisition", "mount", frequency=90.0, damping=0.1),
            1.0 / (1.0 + 0.2 * s / (2.0 * math.pi * 90.0) + (s / (2.0 * math.pi * 90.0)) ** 2),
        ),
    ):
        assert ratio(effect, f) == pytest.approx(expected, rel=2e-3)
    run = pushed(tone(f)[1])
    assert stepped(run, entry("sensor-gain", "acquisition", "accelerometer", gain=1.07))[ARM] == pytest.approx(
        stepped(run)[ARM]
    )
    level = 0.5 * float(np.max(np.abs(stepped(run)[ACC])))
    clipped = stepped(run, entry("sensor-saturation", "acquisition", "clip", level=level))[ACC]
    assert clipped == pytest.approx(np.clip(stepped(run)[ACC], -level, level))
    assert t.size == clipped.size
    soft = stepped(run, entry("sensor-saturation", "acquisition", "compressing", level=level, knee=2.0))[ACC]
    y = stepped(run)[ACC]
    assert soft == pytest.approx(y / np.sqrt(1.0 + (y / level) ** 2))


def test_a_tilted_accelerometer_sees_gravitys_radial_part_and_the_cosine_of_its_own():
    none = np.zeros(100)
    run = run_of((RATE, [channel("linear-acceleration", "arm", "output", none, radius=0.7),
                         channel("linear-acceleration", "arm", "output", none, radius=0.7, direction="radial")]),
                 experiment="free", arm_angle=0.5)  # fmt: skip
    built = augment({"kind": "diagnosis", "rig": {"topology": "two-inertia", "motion": "rotational", "plane": "vertical",
                     "reduction_ratio": N}, "base": BASE,
                     "effects": [entry("sensor-tilt", "acquisition", "radial", angle=0.1)]})  # fmt: skip
    campaign = Campaign(path=Path("campaign"), rig=UPRIGHT, runs=(run,))
    done = replay_run(campaign, run, built.spec, physics_of(built.description)(run), timestep=H)
    tangential, radial = (s.samples[50] for s in done.select("linear-acceleration"))
    g, q = 9.80665, 0.5
    assert tangential == pytest.approx(g * math.cos(q - 0.1), rel=1e-6)
    assert radial == pytest.approx(g * math.sin(q - 0.1), rel=1e-6)


def test_a_force_cells_gain_divides_what_it_recorded():
    base, wrong = (
        stepped(hit(), *effects)[ARM]
        for effects in ((), (entry("sensor-gain", "acquisition", "force", gain=1.25),))
    )
    assert wrong == pytest.approx(base / 1.25, rel=1e-6, abs=1e-12)


def test_a_cells_noise_between_hits_pushes_nothing():
    quiet = hit()
    noisy = quiet.streams[0].channels[0]
    shaken = noisy.samples + np.random.default_rng(0).normal(0.0, 0.5, noisy.samples.size)
    stream = quiet.streams[0]
    channels = (channel("force", "arm", "input", shaken, radius=1.0), *stream.channels[1:])
    run = run_of((RATE, list(channels)), brake=True)
    friction = entry("coulomb-friction", "load", "plain", torque=1e-4)
    before_contact = slice(0, 12)
    still = np.max(np.abs(stepped(run, friction)[ARM][before_contact]))
    shaken = np.max(np.abs(stepped(replace(run, experiment="free"), friction)[ARM][before_contact]))
    assert still < 0.05 * shaken


@pytest.mark.parametrize(
    ("form", "age"), [("averaged", 0.0), ("held", 0.0), ("seen-held", 7e-4), ("averaged-held", 0.0)]
)
def test_a_slow_logs_torque_is_restored_below_half_its_rate(form, age):
    rate, log_rate, f = 1000.0, 200.0, 20.0
    t = np.arange(4000) / rate
    truth = np.sin(2.0 * math.pi * f * t)
    every = round(rate / log_rate)
    last = (np.arange(t.size) // every) * every
    fine = np.sin(2.0 * math.pi * f * (np.arange(t.size * 20) / (20 * rate) - age))
    sums = np.cumsum(np.insert(fine, 0, 0.0))
    at = np.arange(t.size) * 20
    logged = (sums[at] - sums[np.maximum(at - 20 * every, 0)]) / (20 * every) if "averaged" in form else fine[at]
    logged = logged[last] if form.endswith("held") else logged
    restored = relogged(logged, rate, log_rate, form, age)
    inside = slice(500, -500)
    assert np.sqrt(np.mean((restored - truth)[inside] ** 2)) < 0.03
    assert np.sqrt(np.mean((logged - truth)[inside] ** 2)) > 0.15


@pytest.mark.parametrize("rig", [FLAT, UPRIGHT], ids=["flat", "upright"])
def test_further_modes_add_their_own_answers_to_the_hit_and_weigh_nothing(rig):
    """Each is p'' + 2 zeta w p' + w^2 p = T/J_L from rest; the second accelerometer sees the joint's own by its shape."""
    modes = ((90.0, 0.02, 0.5, -0.3), (140.0, 0.01, 0.2, 0.4))
    parameters = {"shape_2": 0.8}
    for r, mode in enumerate(modes):
        tail = "" if r == 0 else f"_{r + 1}"
        names = (f"frequency{tail}", f"damping{tail}", f"share{tail}_of_1", f"share{tail}_of_2")
        parameters.update(zip(names, mode, strict=True))
    run = hit(0.5)
    bare = stepped(run, rig=rig, damping=200.0, gravity_moment=20.0)
    bent = stepped(run, entry("link-flexibility", "load", "2-bends-2-places", **parameters), rig=rig, damping=200.0,
                   gravity_moment=20.0)  # fmt: skip
    force = run.select("force", role="input")[0].samples
    t = np.arange(force.size) / RATE
    own = bare["angular-acceleration", "arm"]
    for place, (key, radius, shape) in enumerate(((("angular-acceleration", "arm"), 1.0, 1.0), (ACC, 0.5, 0.8))):
        added = radius * (shape - 1.0) * own
        for frequency, damping, *shares in modes:
            w = 2.0 * math.pi * frequency
            system = ([1.0, 0.0, 0.0], [1.0, 2.0 * damping * w, w * w])
            added = added + radius * shares[place] * lsim(system, force / J_L, t)[1]
        np.testing.assert_allclose((bent[key] - bare[key])[:-40], added[:-40], atol=0.02 * np.max(np.abs(added)))


@pytest.mark.parametrize(
    ("elbow", "curve", "hammer"), [(0.3, 1, 1.0), (0.7, 1, 1.0), (0.3, 1, 0.2), (0.1, 2.5, 0.9)]
)
def test_beyond_an_elbow_hit_and_sensor_follow_by_how_far_beyond_it_they_are(elbow, curve, hammer):
    """The two bodies' own equations: M (q, psi)'' + C (q, psi)' + K (q, psi) = (r_h, (r_h - r_e)+^curve) F."""
    c, m, frequency, zeta = 0.2, 0.1, 45.0, 0.02
    inertia, kappa, w = c * c / m, c / m, 2.0 * math.pi * frequency
    run = hit(0.5)
    device = run.streams[0]
    channels = tuple(replace(x, radius=hammer) if x.quantity == "force" else x for x in device.channels)
    run = replace(run, streams=(replace(device, channels=channels),))
    law = dict(
        frequency=frequency,
        inertia=inertia,
        damping=zeta,
        shape=kappa / math.sqrt(inertia / J_L),
        elbow_radius=elbow,
    )
    variant, more = ("elbow", {}) if curve == 1 else ("cantilever", {"curve": curve})
    bent = stepped(run, entry("link-flexibility", "load", variant, **law, **more), damping=200.0)
    M = np.array([[J_L, c], [c, m]])
    springs, dampers = np.diag([2e5, m * w * w]), np.diag([200.0, 2.0 * zeta * w * m])
    turned, outer = np.linalg.solve(M, springs), np.linalg.solve(M, dampers)
    push = np.linalg.solve(M, np.array([hammer, max(hammer - elbow, 0.0) ** curve]))
    A = np.block([[np.zeros((2, 2)), np.eye(2)], [-turned, -outer]])
    B = np.concatenate([np.zeros(2), push])[:, None]
    lever = np.array([0.5, max(0.5 - elbow, 0.0) ** curve])
    C = lever[None, :] @ np.hstack([-turned, -outer])
    force = run.select("force", role="input")[0].samples
    expected = lsim((A, B, C, (lever @ push).reshape(1, 1)), force, np.arange(force.size) / RATE)[1]
    np.testing.assert_allclose(bent[ACC][:-40], expected[:-40], atol=0.02 * np.max(np.abs(expected)))


@pytest.mark.parametrize(
    ("effect", "variant", "parameters"),
    [
        ("sensor-gain", "accelerometer", {"gain": 1.2}),
        ("sensor-resonance", "mount", {"frequency": 150.0, "damping": 0.1}),
        ("sensor-resonance", "bandwidth", {"frequency": 150.0}),
        ("sensor-saturation", "clip", {"level": 5.0}),
    ],
)
def test_a_fault_of_one_accelerometer_leaves_another_radius_as_it_is(effect, variant, parameters):
    """The rig's accelerometer is at 0.5 m: a law of that radius is the law, a law of another one nothing."""
    run = hit(0.3)
    plain = stepped(run, damping=200.0)[ACC]
    everywhere = stepped(run, entry(effect, "acquisition", variant, **parameters), damping=200.0)[ACC]
    here = stepped(run, entry(effect, "acquisition", f"{variant}-at-0.5", **parameters), damping=200.0)[ACC]
    elsewhere = stepped(run, entry(effect, "acquisition", f"{variant}-at-0.9", **parameters), damping=200.0)[ACC]
    np.testing.assert_allclose(here, everywhere, rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(elsewhere, plain)
    assert np.max(np.abs(here - plain)) > 1e-2 * np.max(np.abs(plain))


def test_a_place_that_is_no_radius_is_refused_in_one_line():
    with pytest.raises(RefusedError, match=r"variant 'clip-at-tip' names no radius \[m\]"):
        stepped(hit(0.1), entry("sensor-saturation", "acquisition", "clip-at-tip", level=5.0))
