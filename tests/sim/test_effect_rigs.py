"""What acts on the load, and which rigs and runs are replayed, stepped in MuJoCo the way confirm does it."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

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
