"""Each law of effects.json by a fact in closed form, stepped in MuJoCo the way confirm does it."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jointscope.errors import InputError, RefusedError
from jointscope.models.effects import augment
from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream
from jointscope.sim.effects import loop_of, physics_of
from jointscope.sim.effects.torque_log import relogged
from jointscope.sim.effects.transmission import Spring, hysteresis, relaxation
from jointscope.sim.replay import replay_run

K, C, J_L, J_M, N = 2e5, 0.0, 3.0, 9.0, 100.0
W0 = math.sqrt(K / J_L)
BASE = {
    "stiffness": K, "damping": C, "load_inertia": J_L, "motor_inertia": J_M, "motor_damping": 0.0, "load_damping": 0.0,
    "gravity_moment": 0.0, "efficiency": 1.0, "torque_scale": 1.0, "torque_offset": 0.0, "drive_gain": 0.0,
    "drive_integral": 0.0, "drive_acceleration": 0.0, "drive_velocity": 0.0, "drive_limit": 0.0,
}  # fmt: skip
FLAT = Nameplate(topology="two-inertia", motion="rotational", plane="horizontal", reduction_ratio=N)
UPRIGHT = Nameplate(topology="two-inertia", motion="rotational", plane="vertical", reduction_ratio=N)
RATE = 2000.0
H = 1e-4


def channel(quantity, location, role, samples, **more):
    units = {"force": "N", "torque": "N m", "angle": "rad", "angular-velocity": "rad/s", "position": "m",
             "linear-acceleration": "m/s^2", "angular-acceleration": "rad/s^2", "acceleration": "m/s^2",
             "speed-command": "rad/s", "velocity": "m/s", "voltage": "V"}  # fmt: skip
    return Channel(
        column=f"{quantity} {location} {len(more)}", quantity=quantity, unit=units[quantity], location=location,
        role=role, samples=samples, **more,
    )  # fmt: skip


def run_of(*streams, experiment="hammer", **more):
    """One run of streams (rate, channels)."""
    return Run(
        id="a",
        experiment=experiment,
        streams=tuple(
            Stream(file=f"{i}.csv", sampling_rate=rate, length=len(channels[0].samples), channels=tuple(channels))
            for i, (rate, channels) in enumerate(streams)
        ),
        **more,
    )


def hit(seconds=1.0, impulse=3.0, rate=RATE, **more):
    """A pulse of ``impulse`` [N m s] on the braked arm at 1 m; its angular acceleration and an accelerometer."""
    t = np.arange(round(seconds * rate)) / rate
    width = 1.5e-3
    force = impulse / (width * math.sqrt(math.pi)) * np.exp(-(((t - 0.02) / width) ** 2))
    none = np.zeros(t.size)
    return run_of(
        (rate, [channel("force", "arm", "input", force, radius=1.0),
                channel("angle", "arm", "output", none), channel("angular-acceleration", "arm", "output", none),
                channel("linear-acceleration", "arm", "output", none, radius=0.5)]),
        brake=True, **more,
    )  # fmt: skip


def pushed(torque, rate=RATE, *, start=0.0, every=None, experiment="torque-sweep"):
    """Motor torque [N m on the shaft] on the free rig; with ``every`` a second device logs the motor's samples so often."""
    none = np.zeros(torque.size)
    arm = [
        channel("linear-acceleration", "arm", "output", none, radius=1.0),
        channel("angle", "arm", "output", none),
    ]
    torque = torque[:: every or 1]
    motor = [
        channel("torque", "motor", "input", torque),
        channel("angle", "motor", "output", np.zeros(torque.size)),
    ]
    streams = [(rate, motor + arm)] if every is None else [(rate, arm), (rate / every, motor)]
    return run_of(*streams, experiment=experiment, arm_angle=start)


def entry(effect, location, variant="", runs=None, **parameters):
    found = {"effect": effect, "location": location, "variant": variant, "parameters": parameters}
    return found if runs is None else {**found, "runs": runs}


def stepped(run, *effects, rig=FLAT, timestep=H, **base):
    """The run's outputs through the model with ``effects``, by (quantity, location)."""
    plate = {key: getattr(rig, key) for key in ("topology", "motion", "plane", "reduction_ratio", "ground_spring")}
    built = augment({"kind": "diagnosis", "rig": plate, "base": {**BASE, **base}, "effects": list(effects)})
    campaign = Campaign(path=Path("campaign"), rig=rig, runs=(run,))
    done = replay_run(
        campaign, run, built.spec, physics_of(built.description)(run),
        loop=loop_of(built.description["drive"]), timestep=timestep,
    )  # fmt: skip
    return {(s.channel.quantity, s.channel.location): np.array(s.samples) for s in done.select(role="output")}


ARM, MOTOR, ACC = ("angle", "arm"), ("angle", "motor"), ("linear-acceleration", "arm")


def peaks(x, rate=RATE):
    """Times and sizes of the maxima of |x|, by parabolas."""
    size = np.abs(x)
    i = np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:])) + 1
    a, b, c = size[i - 1], size[i], size[i + 1]
    shift = 0.5 * (a - c) / (a - 2.0 * b + c)
    return (i + shift) / rate, b - 0.25 * (a - c) * shift


def frequency(t, x, low, high):
    """Mean frequency of the ring-down between two times, from its maxima [Hz]."""
    inside = (t > low) & (t < high)
    return (np.count_nonzero(inside) - 1) / 2.0 / (t[inside][-1] - t[inside][0])


# --- dry friction and drag ------------------------------------------------------------------------------------------


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


def test_friction_in_proportion_to_the_torque_decays_like_a_loss_factor():
    """mu |T_S| loses 2 mu K A^2 a cycle of 1/2 K A^2: A falls by exp(-2 mu) each cycle, at every level."""
    t, A = peaks(
        stepped(hit(), entry("load-dependent-friction", "transmission", "output-side", coefficient=0.02))[ARM]
    )
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


# --- the transmission ------------------------------------------------------------------------------------------------


def dead_zone(A, half):
    """Describing function over K."""
    r = half / A
    return 1.0 - 2.0 / math.pi * (math.asin(r) + r * math.sqrt(1.0 - r * r))


@pytest.mark.parametrize("variant", ["free-flight", "damped"])
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


def test_hysteresis_starts_unloaded_with_the_slope_of_its_stiffness():
    for form in ("bouc-wen", "dahl"):
        law = hysteresis({"torque": 8.0, "angle": 8e-5, "form": form})
        assert law(0.0, 1e-3, 0.0) == 0.0
        assert law(1e-4, 1e-3 + 8e-8, 0.0) == pytest.approx(8.0 / 8e-5 * 8e-8, rel=1e-3)


def test_slipping_elements_stiffen_small_motion_by_their_sum_and_yield_at_the_torque():
    """Below the first slip the frequency is that of K + stiffness; far above, that of K."""
    slip = entry("hysteresis", "transmission", "maxwell-slip", torque=8.0, stiffness=1e5)
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


# --- the drive -------------------------------------------------------------------------------------------------------


def tone(f, seconds=1.0, rate=RATE, amplitude=1.0):
    t = np.arange(round(seconds * rate)) / rate
    return t, amplitude * np.sin(2.0 * math.pi * f * t) * np.clip(t / 0.2, 0.0, 1.0) ** 2


def transfer(x, y, f, t):
    late = t > 0.4
    line = np.exp(-2j * math.pi * f * t[late]) * np.hanning(late.sum())
    return complex((line @ (y[late] - y[late].mean())) / (line @ (x[late] - x[late].mean())))


def ratio(effect, f, **more):
    """Arm acceleration with over without ``effect`` at ``f`` [Hz]."""
    t, torque = tone(f)
    run = pushed(torque, **more)
    return transfer(stepped(run, damping=200.0)[ACC], stepped(run, effect, damping=200.0)[ACC], f, t)


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


# --- the load --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("at", "of"), [("motor", "angle"), ("load", "angle"), ("transmission", "wind-up")])
def test_a_law_without_a_name_shifts_the_rest_by_what_its_table_reads_there(at, of):
    """Constant beyond its nodes, straight between them: here -k times its variable, a spring."""
    none, k = np.zeros(400), 3000.0
    run = run_of((RATE, [channel("angle", "motor", "output", none), channel("angle", "arm", "output", none)]),
                 experiment="free", arm_angle=0.5)  # fmt: skip
    sign = 1.0 if at == "transmission" else -1.0
    nodes = {f"torque_{i}": sign * k * (-0.8 + 0.2 * i) for i in range(9)}
    table = {**entry("latent-law", at, of, **nodes), "range": [-0.8, 0.8]}
    found = stepped(run, table, rig=UPRIGHT, gravity_moment=40.0)
    torque = 40.0 * math.cos(0.5) + (k * 0.5 if at == "load" else 0.0)
    stiffness = K + (k if at == "transmission" else 0.0)
    assert found[MOTOR][0] / N - 0.5 == pytest.approx(torque / stiffness, rel=1e-4)
    assert np.ptp(found[ARM]) < 1e-9


def test_payload_moves_the_frequency_in_the_runs_that_carry_it_only():
    for weight in (0.0, 1.0):
        x = stepped(hit(), entry("payload", "load", "some-runs", {"a": weight}, inertia=0.6))[ARM]
        expected = math.sqrt(K / (J_L + 0.6 * weight)) / (2.0 * math.pi)
        assert frequency(*peaks(x), 0.05, 0.9) == pytest.approx(expected, rel=1e-3)


def test_at_rest_the_drive_carries_the_weight_and_nothing_moves():
    """The motor's equilibrium torque is M cos(q + phase); a run without torque is held there."""
    none = np.zeros(400)
    run = run_of((RATE, [channel("angle", "motor", "output", none), channel("angle", "arm", "output", none)]),
                 experiment="free", arm_angle=0.5)  # fmt: skip
    for rig in (UPRIGHT, FLAT):  # out of gravity's plane the weight is a law
        found = stepped(run, entry("gravity", "load", "inclined", moment=40.0, phase=0.7), rig=rig)
        assert np.ptp(found[ARM]) < 1e-10
        assert found[ARM][0] == pytest.approx(0.5)
        wind_up = found[MOTOR][0] / N - 0.5
        assert wind_up == pytest.approx(40.0 * math.cos(1.2) / K, rel=1e-4)


def test_rest_is_found_on_the_edge_of_a_play():
    none = np.zeros(400)
    run = run_of((RATE, [channel("angle", "motor", "output", none), channel("angle", "arm", "output", none)]),
                 experiment="free", arm_angle=0.5)  # fmt: skip
    for moment in (40.0, -40.0):
        found = stepped(
            run, entry("backlash", "transmission", "damped", gap=4e-4), rig=UPRIGHT, gravity_moment=moment
        )
        wind_up = found[MOTOR][0] / N - 0.5
        expected = math.copysign(2e-4, moment) + moment * math.cos(0.5) / K
        assert wind_up == pytest.approx(expected, rel=1e-4)
        assert np.ptp(found[ARM]) < 1e-9


def test_a_disturbance_of_known_phase_acts_and_one_of_unknown_phase_does_not():
    effect = entry("external-vibration", "base", "torque", frequency=10.0, amplitude=2.0)
    plate = {"topology": "two-inertia", "motion": "rotational", "plane": "horizontal", "reduction_ratio": N}
    built = augment({"kind": "diagnosis", "rig": plate, "base": {**BASE, "damping": 300.0}, "effects": [effect]})
    run = hit(1.5, impulse=0.0)
    campaign = Campaign(path=Path("campaign"), rig=FLAT, runs=(run,))
    silent = replay_run(campaign, run, built.spec, physics_of(built.description)(run), timestep=H)
    assert np.max(np.abs(silent.select("angle", location="arm")[0].samples)) < 1e-12
    (law,) = built.description["laws"]
    known = {**built.description, "laws": [{**law, "phases": {"a": 0.3}}]}
    shaken = replay_run(campaign, run, built.spec, physics_of(known)(run), timestep=H)
    late = shaken.select("angle", location="arm")[0].samples[-1000:]
    s = 2j * math.pi * 10.0
    assert np.max(np.abs(late)) == pytest.approx(abs(2.0 / (J_L * s**2 + 300.0 * s + K)), rel=5e-3)


# --- the instruments -------------------------------------------------------------------------------------------------


def test_a_late_devices_torque_acted_earlier_than_it_is_stamped():
    """delay > 0: phase + w delay of the DAQ's response against the logged torque, gain 1; and the encoder is late."""
    f, delay = 30.0, 2e-3
    effect = entry("delay", "acquisition", "constant", delay=delay)
    assert ratio(effect, f, every=2) == pytest.approx(np.exp(2j * math.pi * f * delay), rel=1e-3)
    run = pushed(tone(f)[1], every=2)
    base, late = (stepped(run, *effects, damping=200.0)[MOTOR] for effects in ((), (effect,)))
    moved = slice(20, -20)
    assert late[moved] == pytest.approx(base[moved], abs=1e-3 * np.ptp(base))  # torque and encoder share the clock


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


@pytest.mark.parametrize("form", ["averaged", "held"])
def test_a_slow_logs_torque_is_restored_below_half_its_rate(form):
    rate, log_rate, f = 1000.0, 200.0, 20.0
    t = np.arange(4000) / rate
    truth = np.sin(2.0 * math.pi * f * t)
    every = round(rate / log_rate)
    if form == "held":
        logged = truth[(np.arange(t.size) // every) * every]
    else:
        fine = np.sin(2.0 * math.pi * f * (np.arange(t.size * 20) / (20 * rate)))
        sums = np.cumsum(np.insert(fine, 0, 0.0))
        at = np.arange(t.size) * 20
        logged = (sums[at] - sums[np.maximum(at - 20 * every, 0)]) / (20 * every)
    restored = relogged(logged, rate, log_rate, form)
    inside = slice(500, -500)
    assert np.sqrt(np.mean((restored - truth)[inside] ** 2)) < 0.03
    assert np.sqrt(np.mean((logged - truth)[inside] ** 2)) > 0.15


# --- rigs and runs ---------------------------------------------------------------------------------------------------


def test_a_single_sliding_mass_obeys_newton_with_friction():
    """Constant force F on m with viscous b and Coulomb F_c: v -> (F - F_c)/b (1 - exp(-b t/m))."""
    rig = Nameplate(topology="single-dof", motion="translational", plane="horizontal")
    t = np.arange(2000) / 1000.0
    run = run_of((1000.0, [channel("force", "motor", "input", np.full(t.size, 100.0)),
                           channel("velocity", "load", "output", np.zeros(t.size))]), experiment="free")  # fmt: skip
    found = stepped(run, entry("coulomb-friction", "load", "plain", torque=20.0), rig=rig,
                    load_inertia=95.0, load_damping=200.0, stiffness=0.0)  # fmt: skip
    expected = 80.0 / 200.0 * (1.0 - np.exp(-200.0 * t / 95.0))
    assert found[("velocity", "load")][50:-50] == pytest.approx(expected[50:-50], rel=1e-3)


def test_a_sprung_mass_rings_about_its_loaded_rest():
    rig = Nameplate(topology="single-dof", motion="rotational", plane="vertical", ground_spring=True)
    found = stepped(hit(arm_angle=0.4), rig=rig, gravity_moment=58.0)
    x = found[ARM]
    assert x[0] == pytest.approx(0.4, abs=1e-9)
    geometric = K - 58.0 * math.sin(0.4)
    assert frequency(*peaks(x - 0.4), 0.05, 0.9) == pytest.approx(
        math.sqrt(geometric / J_L) / (2.0 * math.pi), rel=1e-3
    )
    assert found[ACC][5] == pytest.approx(9.80665 * math.cos(0.4), rel=1e-3)


def test_the_drives_loop_follows_its_command_where_no_torque_was_logged():
    t = np.arange(1500) / 500.0
    command = 20.0 * np.sin(2.0 * math.pi * 0.5 * t) ** 2
    none = np.zeros(t.size)
    run = run_of((500.0, [channel("speed-command", "motor", "input", command), channel("angle", "motor", "output", none),
                          channel("torque", "motor", "output", none)]), experiment="speed-motion")  # fmt: skip
    gains = {"drive_gain": 3000.0, "drive_integral": 60000.0}
    found = stepped(run, damping=60.0, **gains)
    followed = np.cumsum(command) / 500.0
    assert found[MOTOR] - found[MOTOR][0] == pytest.approx(followed, abs=0.05 * followed[-1])
    limited = stepped(run, damping=60.0, drive_limit=4.0, **gains)[("torque", "motor")]
    assert np.max(np.abs(limited)) == pytest.approx(0.04, rel=0.05)  # the log's filter rings


def test_a_prescribed_motor_drives_the_arm_by_the_springs_transfer_function():
    """q/q_s = (K + c s)/(J s^2 + c s + K) at 15 Hz."""
    f, t = 15.0, np.arange(2000) / RATE
    angle = 0.05 * N * np.sin(2.0 * math.pi * f * t) * np.clip(t / 0.3, 0.0, 1.0) ** 3
    run = run_of((RATE, [channel("angle", "motor", "input", angle), channel("angle", "arm", "output", 0.0 * t)]),
                 experiment="speed-motion")  # fmt: skip
    found = stepped(run, damping=400.0)[ARM]
    s = 2j * math.pi * f
    expected = (K + 400.0 * s) / (J_L * s**2 + 400.0 * s + K)
    assert transfer(angle / N, found, f, t) == pytest.approx(expected, rel=5e-3)


def test_a_prescribed_load_needs_its_inertia_damping_and_friction():
    rig = Nameplate(topology="single-dof", motion="translational", plane="horizontal")
    t = np.arange(3000) / 1000.0
    w = 2.0 * math.pi * 1.5
    run = run_of((1000.0, [channel("position", "load", "input", 0.1 * np.sin(w * t)),
                           channel("force", "load", "output", 0.0 * t)]), experiment="speed-motion")  # fmt: skip
    force = stepped(run, entry("coulomb-friction", "load", "asymmetric", torque=20.0, asymmetry=0.1), rig=rig,
                    load_inertia=95.0, load_damping=200.0, stiffness=0.0)[("force", "load")]  # fmt: skip
    v, a = 0.1 * w * np.cos(w * t), -0.1 * w * w * np.sin(w * t)
    expected = 95.0 * a + 200.0 * v + 20.0 * np.sign(v) + 2.0
    moving = (np.abs(v) > 0.2) & (t > 0.5) & (t < 2.5)
    assert np.sqrt(np.mean((force - expected)[moving] ** 2)) < 0.3  # of some 900 N


def test_what_is_not_replayed_is_refused():
    t = np.arange(100) / RATE
    run = run_of((RATE, [channel("angle", "arm", "input", 0.0 * t)]), experiment="speed-motion")
    with pytest.raises(RefusedError, match="prescribed"):
        stepped(run)
    with pytest.raises(InputError, match="unknown kind"):
        physics_of({"laws": [{"kind": "magic"}], "rig": {}, "spring": {}})


def test_springs_of_description_and_mjcf_agree():
    numbers = {
        "stiffness": K,
        "damping": 60.0,
        "cubic": 2e10,
        "gap": 1e-4,
        "centre": 2e-5,
        "soft_stiffness": 5e4,
        "soft_angle": 1e-4,
    }
    spring = Spring(**numbers, gap_damping=0.0)
    for delta in np.linspace(-5e-4, 5e-4, 11):
        inside = abs(delta - 2e-5) <= 5e-5
        assert spring.native(delta, 0.1) - spring.torque(delta, 0.1) == pytest.approx(6.0 if inside else 0.0)
