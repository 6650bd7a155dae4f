"""What acts on the load, and which rigs and runs are replayed, stepped in MuJoCo the way confirm does it."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy import signal

from jointscope.errors import InputError, RefusedError
from jointscope.models.effects import augment
from jointscope.recordings.campaign import Campaign, Nameplate
from jointscope.sim.effects import physics_of
from jointscope.sim.effects.transmission import Spring
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
    K,
    N,
    channel,
    entry,
    frequency,
    hit,
    peaks,
    run_of,
    stepped,
    transfer,
)


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


def test_a_lifted_payload_weighs_in_the_runs_that_carry_it_only():
    """At rest the wind-up carries M cos(q), and inertia g / percussion_radius more of it with the payload."""
    none = np.zeros(400)
    run = run_of((RATE, [channel("angle", "motor", "output", none), channel("angle", "arm", "output", none)]),
                 experiment="free", arm_angle=0.5)  # fmt: skip
    for weight in (0.0, 1.0):
        payload = entry("payload", "load", "lifted", {"a": weight}, inertia=0.6, percussion_radius=0.5)
        found = stepped(run, payload, rig=UPRIGHT, gravity_moment=40.0)
        torque = (40.0 + weight * 0.6 * 9.80665 / 0.5) * math.cos(0.5)
        assert found[MOTOR][0] / N - 0.5 == pytest.approx(torque / K, rel=1e-4)


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


SLIDE = Nameplate(topology="single-dof", motion="translational", plane="horizontal", ground_spring=False)
AXIS = Nameplate(
    topology="single-dof", motion="rotational", plane="vertical", ground_spring=False, reduction_ratio=N
)


def driven(torque, **more):
    """A torque at the motor of a rigid axis, and its angle."""
    none = np.zeros(torque.size)
    channels = [channel("torque", "motor", "input", torque / N), channel("angle", "arm", "output", none)]
    return run_of((RATE, channels), experiment="torque-sweep", **more)


@pytest.mark.parametrize("variant", ["input-side", "output-side", "input-side-rounded"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_rigid_axiss_gear_takes_its_share_of_what_passes_it(variant, sign):
    """U = J_M a + T (1 + k), J a = T - M cos q with friction ahead; U = J_M a + T, J a = T (1 - k) - M cos q behind."""
    mu, J_M, M = 0.2, 1.2, 5.0
    t = np.arange(1000) / RATE
    more = {"rounding": 1e-3} if variant.endswith("rounded") else {}
    run = driven(np.full(t.size, 40.0 * sign))
    plate = {"motor_inertia": J_M / N**2, "reducer_inertia": 0.0}
    q = stepped(
        run, entry("load-dependent-friction", "transmission", variant, coefficient=mu, **more), rig=AXIS,
        gravity_moment=M, plate=plate,
    )[ARM]  # fmt: skip
    a = np.gradient(np.gradient(q, t), t)[300:-3]
    at_rest = M * np.cos(q[300:-3])
    J, k = J_L - J_M, mu * sign * sign  # of T v, which is positive where the axis follows its torque
    if variant.startswith("input"):
        assert J_M * a + (J * a + at_rest) * (1.0 + k) == pytest.approx(40.0 * sign, rel=3e-3)
    else:
        assert J * a + at_rest == pytest.approx((40.0 * sign - J_M * a) * (1.0 - k), rel=3e-3)


def test_a_slides_motor_cogs_with_its_path_and_takes_no_energy():
    """M v^2/2 + (a/k) cos(k x) is what the force has done."""
    a, k, push = 3.0, 2.0 * math.pi / 0.024, 20.0
    t = np.arange(2000) / RATE
    none = np.zeros(t.size)
    run = run_of((RATE, [channel("force", "load", "input", np.full(t.size, push)),
                         channel("position", "load", "output", none), channel("velocity", "load", "output", none)]),
                 experiment="torque-sweep")  # fmt: skip
    cogging = entry("torque-ripple", "motor", "pitch", amplitude=a, order=k, phase=0.0)
    plate = {"reduction_ratio": 1.0}
    found = stepped(run, cogging, rig=SLIDE, plate=plate)
    x, v = found["position", "load"], found["velocity", "load"]
    left = 0.5 * J_L * v**2 + a / k * (np.cos(k * x) - 1.0) - push * x
    assert np.ptp(x) > 10.0 * 0.024
    assert np.max(np.abs(left[20:-20])) < 2e-3 * push * np.ptp(x)
    assert np.ptp(v - push / J_L * t) > 0.01


def test_a_rigid_axis_is_held_by_its_drives_loop():
    """J v' = K_p (w - v) + K_i int (w - v) with the whole law in the torque, whatever the log holds beside it."""
    gain, integral = 80.0, 600.0
    t = np.arange(4000) / RATE
    w = 0.5 * np.sin(2.0 * t) ** 2
    none = np.zeros(t.size)
    run = run_of((RATE, [channel("speed-command", "motor", "input", N * w), channel("torque", "motor", "input", none + 0.01),
                         channel("angle", "arm", "output", none)]), experiment="speed-motion")  # fmt: skip
    flat = Nameplate(
        topology="single-dof", motion="rotational", plane="horizontal", ground_spring=False, reduction_ratio=N
    )
    q = stepped(run, rig=flat, drive_gain=gain, drive_integral=integral, drive_trust=1.0)[ARM]
    law = signal.lti([gain, integral], [J_L, gain, integral])
    _, v, _ = signal.lsim(law, w, t)
    held = signal.lsim(signal.lti([1.0, 0.0], [J_L, gain, integral]), none + 0.01 * N, t)[1]
    expected = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1])) / RATE])
    assert np.max(np.abs(q - expected)) < 0.02 * np.ptp(expected) + abs(held).sum() / RATE
