"""The second engine: its laws first, then its draws."""

from __future__ import annotations

import ast
from pathlib import Path

import numpy as np
import pytest

from jointscope.cli import main
from jointscope.errors import InputError
from jointscope.recordings.reader import read_campaign
from jointscope.sim import outside
from jointscope.sim.concealed.seal import folder_digest, open_seal, sealed_digest
from jointscope.sim.outside.effect import Scene
from jointscope.sim.outside.effects import MAKERS
from jointscope.sim.outside.equations import integrate
from jointscope.sim.outside.excitation import half_steps, hit
from jointscope.sim.outside.intent import BLOCK, LISTED, UNLISTED, intent_of
from jointscope.sim.outside.layout import ARM_ANGLE, ARM_RATE, JOINT_TORQUE, STATES, STEP, Q
from jointscope.sim.outside.physics import HELD, MOTOR_SPEED, TORQUE, Control, Physics, packed
from jointscope.sim.outside.production import Order, case_name, produce
from jointscope.sim.outside.rig import draw_rig
from jointscope.sim.outside.running import go, go_all, wind_up_at_rest
from jointscope.sim.outside.sampling import sampled
from jointscope.sim.outside.setup import draw_setup
from jointscope.sim.outside.takes import Take

INERTIA, STIFFNESS = 3.0, 2e4  # kg m^2, N m/rad: 13 Hz
CONTRACT = {
    "coulomb-friction@motor", "coulomb-friction@load", "stribeck-friction@motor", "stribeck-friction@load",
    "load-dependent-friction@transmission", "quadratic-damping@load", "backlash@transmission",
    "stiffness-nonlinearity@transmission", "hysteresis@transmission", "structural-damping@transmission",
    "transmission-error@transmission", "torque-ripple@motor", "drive-lag@motor", "torque-gain@motor", "gravity@load",
    "payload@load", "link-flexibility@load", "base-compliance@base", "neighbour-flexibility@neighbour", "end-stop@load",
    "stiffness-drift@transmission", "external-vibration@base", "delay@acquisition", "clock-drift@acquisition",
    "sensor-tilt@acquisition", "sensor-resonance@acquisition", "sensor-saturation@acquisition",
    "sensor-gain@acquisition", "torque-logging@acquisition",
}  # fmt: skip


def joint(**changes: float) -> Physics:
    plain: dict[str, float] = {
        "motor_inertia": 6.0, "load_inertia": INERTIA, "stiffness": STIFFNESS, "damping": 0.0, "motor_damping": 0.0,
        "load_damping": 0.0, "gravity": 0.0, "ratio": 60.0,
    }  # fmt: skip
    return Physics(**(plain | changes))


def released(physics: Physics, wound: float, steps: int, step: float = STEP, **control: float) -> np.ndarray:
    """The arm let go at ``wound`` [rad], every step stored."""
    state = np.zeros(STATES)
    state[Q] = wound
    still = Control(**{"mode": HELD, **control})
    return integrate(packed(physics), packed(still), state, np.zeros(2 * steps + 2), steps, 0, step, 1)


def test_an_undamped_joint_keeps_its_energy():
    """J w^2/2 + K q^2/2 stays to 1e-9 over ten cycles, and the cycle lasts 2 pi sqrt(J/K)."""
    found = released(joint(), 1e-3, 30_000)
    energy = 0.5 * INERTIA * found[:, ARM_RATE] ** 2 + 0.5 * STIFFNESS * found[:, ARM_ANGLE] ** 2
    assert np.ptp(energy) < 1e-9 * energy[0]
    cycle = 2.0 * np.pi * np.sqrt(INERTIA / STIFFNESS)
    times = np.arange(len(found)) * STEP
    assert found[:, ARM_ANGLE] == pytest.approx(1e-3 * np.cos(2.0 * np.pi * times / cycle), abs=1e-10)


def test_two_free_inertias_keep_their_momentum():
    """Without a drive the transmission acts on both sides alike, opposite in sign."""
    found = released(joint(), 1e-3, 8_000, mode=TORQUE)
    momentum = 6.0 * found[:, 1] + INERTIA * found[:, ARM_RATE]
    assert np.max(np.abs(momentum)) < 1e-9 * INERTIA * np.max(np.abs(found[:, ARM_RATE]))


def test_the_integrator_is_of_order_four():
    """Halving the step divides the error by 16."""
    physics = joint(cubic=STIFFNESS / 1e-6, damping=5.0)
    ends = [released(physics, 1e-3, n, 0.1 / n)[-1] for n in (100, 200, 400)]
    # the last stored sample is one step before the end
    fine = released(physics, 1e-3, 6400, 0.1 / 6400)[:, ARM_ANGLE]
    errors = [abs(end[ARM_ANGLE] - fine[6400 - 6400 // n]) for end, n in zip(ends, (100, 200, 400), strict=True)]
    assert errors[0] / errors[1] == pytest.approx(16.0, rel=0.3)
    assert errors[1] / errors[2] == pytest.approx(16.0, rel=0.3)


def test_coulomb_friction_takes_four_t_over_k_a_cycle():
    """The ring-down is linear: 4 T/K per cycle."""
    friction = 0.5
    found = released(joint(load_friction=friction, load_smoothing=1e-5), 1e-3, 24_000)
    angle = found[:, ARM_ANGLE]
    peaks = [
        angle[0],
        *angle[1:-1][(angle[1:-1] > angle[:-2]) & (angle[1:-1] >= angle[2:]) & (angle[1:-1] > 2e-4)],
    ]
    assert len(peaks) > 5
    assert np.diff(peaks) == pytest.approx(-4.0 * friction / STIFFNESS, rel=0.01)


def test_the_arm_rests_on_one_flank_of_the_play():
    """At rest the wind-up is m g r cos q/K + gap/2, the torque is the weight's, and nothing moves."""
    physics = joint(gravity=20.0, gap=1e-3)
    assert wind_up_at_rest(physics, 0.3) == pytest.approx(20.0 * np.cos(0.3) / STIFFNESS + 5e-4, rel=1e-9)
    steps, times = half_steps(0.2)
    found = go(physics, Take(control=Control(mode=HELD), angle=0.3, duration=0.2, programme=np.zeros_like(times)))
    assert len(found) == steps // 2
    assert found[:, ARM_ANGLE] == pytest.approx(0.3, abs=1e-12)
    assert found[:, JOINT_TORQUE] == pytest.approx(20.0 * np.cos(0.3), rel=1e-9)


def test_a_horizontal_arm_moves_freely_within_the_play():
    """Inside the gap no torque is transmitted; beyond it K (d - gap/2)."""
    loose = released(joint(gap=1e-3), 4e-4, 100)
    tight = released(joint(gap=1e-3), 7e-4, 1)
    assert np.all(loose[:, JOINT_TORQUE] == 0.0)
    assert tight[0, JOINT_TORQUE] == pytest.approx(-STIFFNESS * 2e-4)


def test_hysteresis_loses_energy_whatever_the_speed():
    """A Dahl element's loop, 4 T (A - width) per cycle, does not depend on how fast it is gone through."""
    physics = joint(
        stiffness=0.0, load_inertia=1e9, slip_count=1.0, slip_stiffness=(100.0, 0.0, 0.0, 0.0),
        slip_width=(1e-4, 1.0, 1.0, 1.0),
    )  # fmt: skip
    losses = []
    for frequency in (2.0, 8.0):
        steps = round(3.0 / frequency / STEP)
        times = np.arange(2 * steps + 2) * STEP / 2.0
        speed = 1e-3 * 2.0 * np.pi * frequency * np.cos(2.0 * np.pi * frequency * times)
        drive = Control(mode=MOTOR_SPEED, proportional=6.0 * 4000.0)
        state = np.zeros(STATES)
        found = integrate(packed(physics), packed(drive), state, speed, steps, 0, STEP, 1)
        last = slice(-round(1.0 / frequency / STEP), None)
        losses.append(np.sum(found[last, JOINT_TORQUE] * found[last, 1]) * STEP)
    assert losses[0] == pytest.approx(losses[1], rel=0.01)
    assert losses[0] == pytest.approx(4.0 * 100.0 * 1e-4 * (1e-3 - 1e-4), rel=0.01)


def test_sampling_passes_what_a_device_can_hold_and_stops_what_it_cannot():
    """0.3 of the rate passes to 1e-4, 0.6 of it is gone to 1e-3."""
    times, rate = np.arange(40_000) / 20_000.0, 1000.0
    at = np.arange(2000) / rate
    inside, outside_ = np.sin(2.0 * np.pi * 300.0 * times), np.sin(2.0 * np.pi * 600.0 * times)
    assert sampled(inside, rate, at)[200:-200] == pytest.approx(
        np.sin(2.0 * np.pi * 300.0 * at)[200:-200], abs=3e-4
    )
    assert np.max(np.abs(sampled(outside_, rate, at)[200:-200])) < 1e-3


def test_the_laws_are_those_of_the_contract():
    """Every effect and place of the contract has a law; the unlisted ones are no part of it."""
    assert set(LISTED) == CONTRACT
    assert set(MAKERS) == CONTRACT | set(UNLISTED)
    assert not set(UNLISTED) & CONTRACT
    assert not {label.split("@")[0] for label in UNLISTED} & {label.split("@")[0] for label in CONTRACT}


@pytest.mark.parametrize("label", [*LISTED, *UNLISTED])
def test_every_law_builds_and_stays_finite(label):
    """At middling size a hit and a motion go through; the main parameter is reported unless the form has none."""
    rng = np.random.default_rng(5)
    rig = draw_rig(rng, vertical=label != "brake-slip@motor", textbook=True, slide=None)
    swing = 0.4 * rig.rated_torque / rig.stiffness
    scene = Scene(
        rig=rig, experiments="HSM", swing=swing, speed=0.8, poses=(0.0,), lowest=-0.4, highest=0.5, acceleration=2.0,
        peak=20.0, runs=2,
    )  # fmt: skip
    law = MAKERS[label](scene, rng)
    build = law.build(1.0)
    assert law.main in build.parameters or law.name == "soft at low torque"
    assert all(np.isfinite(value) for value in build.parameters.values())
    _, times = half_steps(0.3)
    takes = [
        Take(control=Control(mode=HELD, push=rig.hammer_radius), angle=0.0, duration=0.3,
             programme=hit(rng, rig, swing, 0.3, 2000.0, 1.0)),
        Take(control=Control(mode=MOTOR_SPEED, proportional=20.0 * rig.load_inertia), angle=0.0, duration=0.3,
             programme=0.5 * np.sin(2.0 * np.pi * 3.0 * times)),
    ]  # fmt: skip
    assert all(np.all(np.isfinite(run)) for run in go_all(rig.physics, takes, [build]))


def test_a_block_holds_every_listed_effect_once_alone():
    """64 mixed cases: 14 nulls, 36 singles with all 29 labels, 8 pairs, 6 unlisted."""
    intents = [intent_of(3, "mixed", index) for index in range(BLOCK)]
    kinds = [intent.kind for intent in intents]
    assert [kinds.count(kind) for kind in ("null", "single", "pair", "unlisted")] == [14, 36, 8, 6]
    assert {label for one in intents if one.kind == "single" for label in one.labels} == CONTRACT
    assert intent_of(3, "mixed", 70) == intent_of(3, "mixed", 70)


def first_of(label: str) -> int:
    """A seed whose first single conceals ``label`` in hits alone, which are quick."""
    for seed in range(9999):
        intent = intent_of(seed, "singles", 0)
        if intent.labels == (label,):
            stream = np.random.SeedSequence([seed, 0, 17, 0]).spawn(6)[0]
            if draw_setup(intent, np.random.default_rng(stream)).experiments == "H":
                return seed
    raise AssertionError(label)


def test_the_same_seed_gives_the_same_files_and_goes_on_where_it_stopped(tmp_path):
    """Two draws are equal byte for byte; a draw that is run again keeps what it has."""
    order = Order(seed=next(s for s in range(999) if intent_of(s, "nulls", 0).place == 0), cases=1, kind="nulls")
    first, second = produce(order, tmp_path / "a"), produce(order, tmp_path / "b")
    name = case_name(order, 0)
    assert first == second
    assert folder_digest(tmp_path / "a" / name) == folder_digest(tmp_path / "b" / name)
    kept = (tmp_path / "a" / name / "campaign.toml").stat().st_ino
    assert produce(order, tmp_path / "a") == first
    assert (tmp_path / "a" / name / "campaign.toml").stat().st_ino == kept
    with pytest.raises(InputError, match="another draw"):
        produce(Order(seed=order.seed + 1, cases=1, kind="nulls"), tmp_path / "a")
    campaign = read_campaign(tmp_path / "a" / name)
    assert {run.experiment for run in campaign.runs} == {"hammer"}
    truth = open_seal(tmp_path / "a", first)["cases"][name]
    assert truth["effects"] == [] and truth["strength"] is None


def test_the_seal_opens_to_effects_of_the_contract_by_the_command(tmp_path, capsys):
    """'conceal --engine outside' writes what 'prove' asks for: entries with place, law, numbers, strength, floor."""
    label = "stiffness-nonlinearity@transmission"
    seed = first_of(label)
    words = ["conceal", "--seed", str(seed), "--cases", "1", "--kind", "singles", "--engine", "outside"]
    assert main([*words, "--workers", "1", "--out", str(tmp_path / "draw")]) == 0
    assert sealed_digest(tmp_path / "draw") in capsys.readouterr().out
    truth = open_seal(tmp_path / "draw", sealed_digest(tmp_path / "draw"))
    assert truth["format"] == "jointscope-truth/1"
    assert truth["order"]["engine"] == "outside"
    for name, case in truth["cases"].items():
        assert folder_digest(tmp_path / "draw" / name) == case["digest"]
        assert {f"{e['effect']}@{e['location']}" for e in case["effects"]} == {label}
        assert case["strength"]["z_d"] == case["strength"]["z"] > 0.0
        assert case["strength"]["nearest"] == ""
        assert set(case["floor"]) == {run.id for run in read_campaign(tmp_path / "draw" / name).runs}
        assert "stiffness-nonlinearity" not in (tmp_path / "draw" / name / "campaign.toml").read_text()


def test_nothing_is_imported_from_who_explains_or_from_the_other_engine():
    """The package names neither MuJoCo, nor diagnosis, nor anything of sim but itself, a draw's folder and its seal."""
    package = Path(outside.__file__).parent
    files = [*package.glob("*.py"), package.parent / "draws.py"]  # what both engines share is held to the same
    assert len(files) > 20
    found = set()
    for file in files:
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                found |= {alias.name for alias in node.names}
            elif isinstance(node, ast.ImportFrom):
                found |= {node.module} | {f"{node.module}.{alias.name}" for alias in node.names}
    own = {name for name in found if name.startswith("jointscope.")}
    allowed = ("jointscope.sim.outside", "jointscope.sim.draws", "jointscope.sim.concealed.seal", "jointscope.recordings",
               "jointscope.atomic", "jointscope.errors", "jointscope.progress")  # fmt: skip
    assert all(name.startswith(allowed) for name in own), own
    assert not any(name.split(".")[0] in ("mujoco", "pinocchio") for name in found)


def test_a_signal_that_flew_apart_is_told_as_such():
    """Between samples nothing can be read of it; production then draws the case anew."""
    signal = np.zeros(4000)
    signal[2000:] = np.nan
    with pytest.raises(FloatingPointError, match="flew apart"):
        sampled(signal, 1000.0, np.arange(10) / 1000.0 + 1.3e-4)
