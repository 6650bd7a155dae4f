"""The multi-joint predictor, and users' own models beside a campaign."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.errors import InputError, RefusedError
from jointscope.models.arm.build import build_arm, with_reducers, write_arm
from jointscope.models.paper import paper_rig
from jointscope.models.rig import rig_spec
from jointscope.prediction.arm import held_as, predict_arm
from jointscope.prediction.arm_campaign import mapped_base_model, predict_mapped
from jointscope.prediction.arm_comparison import compare, suspect
from jointscope.prediction.arm_guess import guess_map, mapped_arm
from jointscope.prediction.arm_map import read_map, write_map
from jointscope.prediction.scores import band_score
from jointscope.prediction.spectra import spectrum
from jointscope.recordings.campaign import Campaign, Nameplate, Run
from jointscope.sim.arm.campaign import arm_campaign, simulate_arm
from jointscope.sim.arm.plan import ELBOW, JOINT, ArmMotion, ArmPlan, ArmSweep, HammerSpot
from jointscope.sim.plan import HammerPlan

COLUMN = "acc_upper_arm"


@pytest.fixture(scope="module")
def plan():
    hammer = HammerPlan(hits=1, levels=(100.0,), duration=1.0, double_hit_probability=0.0)
    return ArmPlan(
        spots=(HammerSpot(hammer=hammer),),
        sweep=ArmSweep(levels=(0.9,), sweep_time=2.0, lead=0.2, trail=0.3),
        motion=ArmMotion(travels=(-0.8,), motion_time=1.5, lead=0.2, trail=0.3),
    )


@pytest.fixture(scope="module")
def recordings(plan):
    return {r.run.experiment: r for r in simulate_arm(plan, np.random.default_rng(2))}


@pytest.fixture(scope="module")
def rig(plan):
    return arm_campaign(plan, ()).rig


@pytest.fixture(scope="module")
def arm(plan):
    return build_arm(plan.truth)


def score(recording, prediction, column=COLUMN):
    true = next(s for s in recording.truth.signals if s.channel.column == column).samples
    return band_score(spectrum(true, 1024.0), spectrum(prediction.channel(column).values, 1024.0), 5.0, 80.0)


@pytest.mark.parametrize("column", [COLUMN, "acc_forearm"])
def test_the_right_model_predicts_the_sweep(arm, rig, recordings, column):
    recording = recordings["torque-sweep"]
    found = score(recording, predict_arm(arm, rig, recording.run), column)
    assert found.median_error < 0.05
    assert found.frac > 0.998


def test_the_right_model_predicts_the_motion_and_does_not_drift(arm, rig, recordings):
    recording = recordings["speed-motion"]
    prediction = predict_arm(arm, rig, recording.run)
    assert score(recording, prediction).frac > 0.998
    angle = prediction.channel("motor_angle")
    assert np.max(np.abs(angle.values - angle.signal.samples)) / 141.0 < 0.01


def test_the_right_model_predicts_the_hit(arm, rig, recordings):
    recording = recordings["hammer"]
    true = next(s for s in recording.truth.signals if s.channel.column == COLUMN).samples
    predicted = predict_arm(arm, rig, recording.run).channel(COLUMN).values
    assert np.sqrt(np.mean((true - predicted) ** 2) / np.mean(true**2)) < 0.05  # the force cell's noise acts too


def test_a_wrong_reducer_is_seen(arm, rig, recordings):
    wrong = with_reducers(arm, {JOINT: 1e5}, {})
    recording = recordings["torque-sweep"]
    assert score(recording, predict_arm(wrong, rig, recording.run)).median_error > 0.5


def test_joints_that_are_locked_instead_of_held_are_seen(arm, rig, recordings):
    recording = recordings["torque-sweep"]
    locked = {name: "locked" for name in arm.rotors if name != JOINT}
    alone = predict_arm(arm, rig, replace(recording.run, hold={**locked, JOINT: "drive"}))
    assert score(recording, alone).median_error > 1.0


def test_outputs_are_not_read(arm, rig, recordings):
    run = recordings["torque-sweep"].run
    streams = tuple(
        replace(s, channels=tuple(c if c.role == "input" else replace(c, samples=None) for c in s.channels))
        for s in run.streams
    )
    blind = predict_arm(arm, rig, replace(run, streams=streams))
    seeing = predict_arm(arm, rig, run)
    assert np.array_equal(blind.channel(COLUMN).values, seeing.channel(COLUMN).values)


def test_a_brake_with_play_is_refused(arm, recordings):
    run = replace(recordings["hammer"].run, hold={ELBOW: "brake-with-play"})
    with pytest.raises(RefusedError, match="play"):
        held_as(arm, run)


def test_an_arm_s_own_model_is_mapped_joint_by_joint(tmp_path, plan, arm, recordings):
    write_arm(tmp_path / "arm.xml", arm)
    campaign = arm_campaign(plan, tuple(r.run for r in recordings.values()))
    found = guess_map(tmp_path / "arm.xml", campaign)
    assert [(j.campaign, j.rotor, j.link) for j in found.joints] == [
        (name, name, name + "_elastic") for name in arm.rotors
    ]
    rows = compare(found, campaign)
    silent = [row for row in rows if row.figure != "stiffness"]
    assert not any(row.verdict for row in silent)
    write_map(tmp_path / "map.toml", found, rows)
    assert read_map(tmp_path / "map.toml").joints == found.joints


def test_a_model_under_other_names_predicts_the_same(tmp_path, plan, arm, rig, recordings):
    renamed = arm.xml
    for k, name in enumerate(arm.rotors):
        renamed = renamed.replace(f'"{name}"', f'"axis{k}"').replace(f'"{name}_', f'"axis{k}_')
    (tmp_path / "mine.xml").write_text(renamed)
    run = recordings["torque-sweep"].run
    campaign = arm_campaign(plan, (run,))
    found = guess_map(tmp_path / "mine.xml", campaign)
    assert mapped_arm(found).rotors[1] == "axis1"
    write_map(tmp_path / "map.toml", found, ())
    (prediction,) = predict_mapped(tmp_path / "mine.xml", tmp_path / "map.toml", campaign)
    by_name = next(c for c in prediction.channels if c.signal.channel.column == COLUMN)
    assert np.allclose(by_name.values, predict_arm(arm, rig, run).channel(COLUMN).values, atol=1e-9)


@pytest.fixture
def bench():
    rig = paper_rig()
    joint = rig.joint
    plate = Nameplate(
        topology="two-inertia", motion="rotational", reduction_ratio=joint.reduction_ratio,
        motor_inertia=joint.motor_inertia, reducer_inertia=joint.reducer_inertia, arm_mass=rig.arm_mass,
        arm_com_radius=rig.arm_com_radius, efficiency=joint.efficiency, inertia_reference=joint.load_inertia,
    )  # fmt: skip
    return Campaign(path=".", rig=plate, runs=(Run(id="a", experiment="hammer", streams=(), arm_angle=0.2),))


@pytest.fixture
def bench_xml(tmp_path):
    (tmp_path / "rig.xml").write_text(rig_spec(paper_rig()).to_xml())
    return tmp_path / "rig.xml"


def test_a_single_joint_model_becomes_the_base_model(bench, bench_xml):
    joint = paper_rig().joint
    model = mapped_base_model(guess_map(bench_xml, bench), bench)
    for name in ("stiffness", "damping", "load_inertia", "motor_damping", "load_damping", "efficiency"):
        assert model.joint[name] == pytest.approx(getattr(joint, name), rel=1e-5), name
    assert model.as_joint().reflected_inertia == pytest.approx(joint.reflected_inertia, rel=1e-5)
    assert model.rig.arm_mass * model.rig.arm_com_radius == pytest.approx(6.0, rel=1e-5)


def test_a_right_model_is_not_suspected(bench, bench_xml):
    assert not any(row.verdict for row in compare(guess_map(bench_xml, bench), bench))


@pytest.mark.parametrize(
    ("figure", "change", "named"),
    [
        (
            "reflected armature",
            lambda s: s.replace('armature="9.1055"', f'armature="{9.1055 / 141.0**2:.9g}"'),
            "n^2",
        ),
        (
            "reflected armature",
            lambda s: s.replace('armature="9.1055"', f'armature="{9.1055 / 141.0:.9g}"'),
            "1 over n =",
        ),
        (
            "load inertia",
            lambda s: s.replace('mass="12"', 'mass="12" ').replace("0.02 0.02", "1.271 1.271"),
            "sqrt 2",
        ),
    ],
)
def test_a_likely_mistake_is_named(bench, bench_xml, figure, change, named):
    changed = change(bench_xml.read_text())
    assert changed != bench_xml.read_text()
    bench_xml.write_text(changed)
    verdicts = {row.figure: row.verdict for row in compare(guess_map(bench_xml, bench), bench)}
    assert named in verdicts[figure]


def test_a_turned_axis_is_found_by_gravity(bench, bench_xml):
    bench_xml.write_text(bench_xml.read_text().replace('axis="0 -1 0"', 'axis="0 1 0"'))
    found = guess_map(bench_xml, bench)
    assert found.joints[0].sign == -1
    assert found.joints[0].zero_offset == pytest.approx(0.0, abs=1e-6)
    assert not any(row.verdict for row in compare(found, bench))
    wrong = replace(found, joints=(replace(found.joints[0], sign=1),))
    verdicts = {row.figure: row.verdict for row in compare(wrong, bench)}
    assert "sign" in verdicts["holding torque"]


@pytest.mark.parametrize("ratio", [1.0, 1.02, 0.9, 1.2])
def test_rough_agreement_is_no_mistake(ratio):
    assert suspect(ratio, 141.0) == ""


@pytest.mark.parametrize(
    ("ratio", "words"),
    [
        (141.0, "n = 141"),
        (141.0**-2, "n^2"),
        (-1.0, "-1"),
        (57.3, "180/pi"),
        (6.28, "2 pi"),
        (-1.414, "sqrt 2"),
        (3.0, "none"),
    ],
)
def test_usual_factors_are_named(ratio, words):
    assert words in suspect(ratio, 141.0)


def test_a_rigid_joint_is_sent_to_the_builder(tmp_path, bench):
    (tmp_path / "rigid.xml").write_text(
        '<mujoco><worldbody><body><inertial pos="0.5 0 0" mass="1" diaginertia=".1 .1 .1"/>'
        '<joint name="arm" axis="0 -1 0"/></body></worldbody></mujoco>'
    )
    with pytest.raises(RefusedError, match="jointscope arm build"):
        mapped_base_model(guess_map(tmp_path / "rigid.xml", bench), bench)


def test_a_wrong_map_is_refused_by_its_key(tmp_path):
    (tmp_path / "map.toml").write_text(
        'format = "jointscope-map/1"\nmodel = "a.xml"\n[[joint]]\ncampaign = ""\nlink = "a"\nsign = 2\n'
    )
    with pytest.raises(InputError, match="sign"):
        read_map(tmp_path / "map.toml")
