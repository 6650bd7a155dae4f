"""A user's own file: read as text, understood as a joint, stepped unchanged, mended line by line."""

from __future__ import annotations

import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from jointscope.errors import InputError
from jointscope.experiments.own_model.changes import proposals
from jointscope.experiments.own_model.content import read_content
from jointscope.experiments.own_model.files import changes_csv, unified_diff
from jointscope.experiments.own_model.inertia import put_mass
from jointscope.experiments.own_model.mapping import own_joint
from jointscope.experiments.own_model.scoring import outputs_of
from jointscope.experiments.own_model.sections import simulation_sections
from jointscope.experiments.own_model.shares import shapley
from jointscope.experiments.own_model.stepping import place
from jointscope.experiments.own_model.study import OwnModelStudy, simulation_json, study_own_model
from jointscope.experiments.own_model.wanted import Wanted
from jointscope.experiments.own_model.xml_document import Draft, read_sources
from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream
from jointscope.sim.own_model import OwnJoint, load_own
from jointscope.sim.own_stepping import own_run

K, C, J_L, J_M, B_M, B_L, N = 193665.0, 59.76, 3.02, 9.105498, 2.0, 2.0, 141.0

NESTED = """<?xml version="1.0"?>
<!-- my robot: hands off -->
<mujoco model="bench">
  <option timestep="5e-4" integrator="RK4" gravity='0 0 0'/>
  <default><joint axis="0 -1 0"/></default>
  <worldbody>
    <body name="motor">
      <inertial pos="0 0 0" mass="1e-9" diaginertia="1e-12 1e-12 1e-12"/>
      <joint name="shoulder" armature="{J_M}" damping="2"{held}/> <!-- rotor > here -->
      <body name="arm">
        <inertial pos="0.5 0 0" mass="12" diaginertia="0.001 0.02 0.02"/>
        <joint name="shoulder_spring" stiffness="{K}" damping="59.76"/>
        <site name="imu" pos="0.95 0 0"/>
      </body>
    </body>
  </worldbody>
  <tendon>
    <fixed name="sum" damping="2"><joint joint="shoulder" coef="1"/><joint joint="shoulder_spring" coef="1"/></fixed>
  </tendon>
  <actuator>
    <motor name="drive" joint="shoulder" gear="98.7"/>
  </actuator>
</mujoco>
"""

GEARED = """<mujoco><option timestep="2e-4" integrator="RK4" gravity="0 0 0"/><worldbody>
  <body name="r"><inertial pos="0 0 0" mass="1e-9" diaginertia="1e-12 1e-12 1e-12"/>
    <joint name="rotor" axis="0 -1 0" armature="4.58e-4" damping="1.00598561e-4"/></body>
  <body name="a"><inertial pos="0.5 0 0" mass="12" diaginertia="0.001 0.02 0.02"/>
    <joint name="arm" axis="0 -1 0" damping="2"/></body></worldbody>
  <tendon><fixed name="gear" stiffness="193665" damping="59.76"><joint joint="rotor" coef="0.00709219858"/>
    <joint joint="arm" coef="-1"/></fixed></tendon>
  <actuator><motor name="m" joint="rotor" gear="0.7"/></actuator></mujoco>
"""

RIGID = """<mujoco><option timestep="1e-3" integrator="RK4" gravity="0 0 0"/><worldbody><body name="a">
    <joint name="arm" axis="0 -1 0" damping="4" armature="9.105498"/>
    <inertial pos="0.5 0 0" mass="12" diaginertia="0.001 0.02 0.02"/></body></worldbody>
  <actuator><motor name="m" joint="arm" gear="98.7"/></actuator></mujoco>
"""

JOINT = OwnJoint(link="shoulder_spring", rotor="shoulder", actuator="drive", torque="motor")
GEARED_JOINT = OwnJoint(link="arm", rotor="rotor", rotor_ratio=N, actuator="m", torque="motor")
RIG = Nameplate(
    topology="two-inertia", motion="rotational", plane="horizontal", reduction_ratio=N, motor_inertia=2.1e-4,
    reducer_inertia=2.48e-4, efficiency=0.7,
)  # fmt: skip


def nested(stiffness: float = K, held: str = "", **others: str) -> str:
    text = NESTED.replace("{K}", repr(stiffness)).replace("{J_M}", repr(J_M)).replace("{held}", held)
    for old, new in others.items():
        text = text.replace(old.replace("_", " "), new)
    return text


def written(folder: Path, text: str, name: str = "robot.xml") -> Path:
    path = folder / name
    path.write_text(text, encoding="utf-8")
    return path


def channel(quantity: Any, samples: np.ndarray, **more: Any) -> Channel:
    samples = np.asarray(samples, dtype=np.float64)
    samples.setflags(write=False)
    return Channel(column=more.pop("column", quantity), quantity=quantity, samples=samples, **more)


def recorded(truth: Path, joint: OwnJoint, *, noise: float = 0.002) -> Campaign:
    """Two braked hits and three sweeps, as the truth's own file gives them, with noise."""
    rng = np.random.default_rng(1)
    runs = []
    for k, peak in enumerate((300.0, 600.0)):
        t = np.arange(512) / 1024.0
        force = np.where((t > 0.05) & (t < 0.058), peak * np.sin(np.pi * (t - 0.05) / 0.008), 0.0)
        daq = Stream(file=f"h{k}", sampling_rate=1024.0, length=t.size, channels=(
            channel("force", force, unit="N", location="arm", role="input", radius=0.8),
            channel("linear-acceleration", t, unit="m/s^2", location="arm", role="output", radius=0.95),
        ))  # fmt: skip
        runs.append(Run(id=f"hit{k}", experiment="hammer", brake=True, streams=(daq,)))
    for k, size in enumerate((0.6, 0.9, 1.2)):
        t = np.arange(768) / 512.0
        torque = size * np.sin(2.0 * np.pi * (2.0 + 14.0 * t) * t) * np.minimum(1.0, 10.0 * t)
        plc = Stream(file=f"s{k}", sampling_rate=512.0, length=t.size, channels=(
            channel("torque", torque, unit="N m", location="motor", role="input"),
            channel("angle", t, unit="rad", location="motor", role="output"),
            channel("linear-acceleration", t, unit="m/s^2", location="arm", role="output", radius=0.95),
        ))  # fmt: skip
        runs.append(Run(id=f"sweep{k}", experiment="torque-sweep", streams=(plc,)))
    campaign = Campaign(path=Path("bench"), rig=RIG, runs=tuple(runs))
    spec, noisy = load_own(truth), []
    for run in runs:
        made = own_run(campaign, run, spec, joint)
        streams = []
        for stream in made.streams:
            channels = tuple(
                c if c.role == "input" or c.samples is None
                else replace(c, samples=c.samples + noise * np.std(c.samples) * rng.normal(size=c.samples.size))
                for c in stream.channels
            )  # fmt: skip
            streams.append(replace(stream, channels=channels))
        noisy.append(replace(made, streams=tuple(streams)))
    return replace(campaign, runs=tuple(noisy))


def diagnosed(effects: tuple[dict[str, Any], ...] = (), **base: float) -> tuple[dict[str, Any], dict[str, Any]]:
    """``diagnosis.json`` and ``model.json`` of a diagnosis that is right."""
    values = {
        "stiffness": K, "damping": C, "load_inertia": J_L, "motor_inertia": J_M, "motor_damping": B_M,
        "load_damping": B_L, "gravity_moment": 0.0, "efficiency": 0.7, "torque_scale": 1.0, "torque_offset": 0.0,
        "drive_gain": 0.0, "drive_integral": 0.0, "drive_acceleration": 0.0, "drive_velocity": 0.0, "drive_limit": 0.0,
    } | base  # fmt: skip
    units = {"stiffness": "N m/rad", "damping": "N m s/rad", "inertia": "kg m^2"}
    answer = {
        "parameters": {
            name: {"value": v, "unit": units[name], "interval95": [v * 0.999, v * 1.001]}
            for name, v in (("stiffness", values["stiffness"]), ("damping", values["damping"]), ("inertia", J_L))
        },
        "effects": [
            {**e, "parameters": {k: {"value": v, "unit": "", "interval95": [0.99 * v, 1.01 * v]}
                                 for k, v in e["parameters"].items()}} for e in effects
        ],
        "held_out": {"runs": ["hit0", "sweep1"]},
    }  # fmt: skip
    rig = {"topology": "two-inertia", "motion": "rotational", "plane": "horizontal", "reduction_ratio": N,
           "motor_inertia": 2.1e-4, "reducer_inertia": 2.48e-4, "efficiency": 0.7}  # fmt: skip
    model = {
        "format": "jointscope-model/1",
        "kind": "diagnosis",
        "rig": rig,
        "base": values,
        "effects": list(effects),
    }
    return answer, model


def coulomb(torque: float) -> dict[str, Any]:
    return {
        "effect": "coulomb-friction",
        "location": "motor",
        "variant": "plain",
        "parameters": {"torque": torque},
    }


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    folder = tmp_path_factory.mktemp("truth")
    return recorded(written(folder, nested().replace("5e-4", "2e-4")), JOINT)


def study(campaign: Campaign, file: Path, *effects: dict[str, Any], joint: OwnJoint = JOINT) -> OwnModelStudy:
    return study_own_model(campaign, *diagnosed(effects), file, joint)


# -- text ---------------------------------------------------------------------------------------------------------


def test_an_edit_touches_its_own_characters_and_nothing_else(tmp_path: Path) -> None:
    text = nested().replace("\n", "\r\n")
    path = tmp_path / "robot.xml"
    path.write_bytes(text.encode())
    sources = read_sources(path)
    draft = Draft(sources)
    draft.put(sources.element("joint", "shoulder"), "damping", "3.5")
    draft.put(sources.element("joint", "shoulder_spring"), "frictionloss", "1")
    expected = text.replace('damping="2"/> <!--', 'damping="3.5"/> <!--').replace(
        'damping="59.76"/>', 'damping="59.76" frictionloss="1"/>'
    )
    assert draft.texts()[0].decode() == expected
    assert [(r.element, r.attribute, r.old, r.new) for r in draft.lines] == [
        ("joint shoulder", "damping", "2", "3.5"),
        ("joint shoulder_spring", "frictionloss", "", "1"),
    ]


def test_no_edit_gives_the_same_bytes_and_single_quotes_stay(tmp_path: Path) -> None:
    sources = read_sources(written(tmp_path, nested()))
    assert Draft(sources).texts() == sources.texts
    draft = Draft(sources)
    draft.put(next(sources.select("option")), "gravity", "0 0 -9.81")
    assert b"gravity='0 0 -9.81'" in draft.texts()[0]


def test_an_included_file_gets_its_own_edits_and_its_own_diff(tmp_path: Path, plain: Campaign) -> None:
    (tmp_path / "parts").mkdir()
    text = nested(stiffness=160000.0)
    begin, end = text.index("  <tendon>"), text.index("  <actuator>")
    written(tmp_path, "<mujocoinclude>\n" + text[begin:end] + "</mujocoinclude>\n", "parts/springs.xml")
    body = text[text.index("  <worldbody>") : begin]
    written(tmp_path, f"<mujocoinclude>\n{body}</mujocoinclude>\n", "parts/bodies.xml")
    whole = text.replace(body, '  <include file="parts/bodies.xml"/>\n').replace(
        text[begin:end], '  <include file="parts/springs.xml"/>\n'
    )
    found = study(plain, written(tmp_path, whole))
    diff = unified_diff(found)
    assert [line for line in diff.splitlines() if line.startswith("+++")] == ["+++ b/parts/bodies.xml"]
    assert [k.change.key for k in found.kept] == ["stiffness"]
    assert found.kept[0].lines[0].file == "parts/bodies.xml"


# -- what a model holds -------------------------------------------------------------------------------------------


def test_a_nested_reducer_and_a_geared_rotor_hold_the_same_joint(tmp_path: Path) -> None:
    one = read_content(load_own(written(tmp_path, nested())), JOINT, two=True, angle=0.1, ratio=N)
    other = read_content(load_own(written(tmp_path, GEARED, "g.xml")), GEARED_JOINT, two=True, angle=0.1, ratio=N)
    truth = {"stiffness": K, "damping": C, "load_inertia": J_L, "motor_inertia": J_M, "motor_damping": B_M,
             "load_damping": B_L, "motor_friction": 0.0, "load_friction": 0.0, "torque_gain": 98.7}  # fmt: skip
    assert one.values == pytest.approx(truth, rel=1e-6)
    assert other.values == pytest.approx(truth, rel=1e-6)


def test_a_model_that_turns_the_other_way_records_the_same(tmp_path: Path, plain: Campaign) -> None:
    turned = written(
        tmp_path, nested().replace('axis="0 -1 0"', 'axis="0 1 0"').replace('gear="98.7"', 'gear="98.7"')
    )
    straight = load_own(written(tmp_path, nested(), "straight.xml"))
    for run in plain.runs[::2]:
        a = own_run(plain, run, straight, JOINT)
        b = own_run(plain, run, load_own(turned), replace(JOINT, sign=-1, zero_offset=0.3))
        for x, y in zip(outputs_of(a), outputs_of(b), strict=True):
            np.testing.assert_allclose(x.samples, y.samples, atol=1e-6 * np.abs(x.samples).max())


def test_geared_and_nested_record_the_same(tmp_path: Path, plain: Campaign) -> None:
    one = load_own(written(tmp_path, nested().replace("5e-4", "2e-4")))
    other = load_own(written(tmp_path, GEARED, "g.xml"))
    for run in plain.runs[1:3]:
        a, b = own_run(plain, run, one, JOINT), own_run(plain, run, other, GEARED_JOINT)
        for x, y in zip(outputs_of(a), outputs_of(b), strict=True):
            np.testing.assert_allclose(x.samples, y.samples, atol=2e-4 * np.abs(x.samples).max())


def test_a_rigid_joint_on_the_brake_stands_still(tmp_path: Path, plain: Campaign) -> None:
    rigid = load_own(written(tmp_path, RIGID))
    made = own_run(plain, plain.runs[0], rigid, OwnJoint(link="arm", actuator="m", torque="motor"))
    assert np.all(outputs_of(made)[0].samples == 0.0)


def test_a_joint_that_the_bench_held_is_as_if_it_were_not_there(tmp_path: Path, plain: Campaign) -> None:
    hand = (
        '<body name="w" pos="1 0 0"><joint name="wrist" type="hinge"/>'
        '<inertial pos="0 0 0" mass="1e-9" diaginertia="1e-12 1e-12 1e-12"/></body><site name="imu"'
    )
    wrist = nested().replace('<site name="imu"', hand)
    held = load_own(written(tmp_path, wrist))
    plainly = load_own(written(tmp_path, nested(), "p.xml"))
    a = own_run(plain, plain.runs[3], held, replace(JOINT, hold={"wrist": 0.7}))
    b = own_run(plain, plain.runs[3], plainly, JOINT)
    np.testing.assert_allclose(outputs_of(a)[1].samples, outputs_of(b)[1].samples, atol=1e-6)


@pytest.mark.parametrize(("change", "moment"), [(0.3, 0.0), (-0.012, 0.0), (0.2, 3.0), (-0.3, -8.0)])
def test_inertia_and_weight_end_where_they_should(tmp_path: Path, change: float, moment: float) -> None:
    path = written(tmp_path, nested().replace("gravity='0 0 0'", "gravity='0 0 -9.81'"))
    before = read_content(load_own(path), JOINT, two=True, angle=0.0, ratio=N)
    draft = Draft(read_sources(path))
    put_mass(draft, before, change, moment)
    path.write_bytes(draft.texts()[0])
    after = read_content(load_own(path), JOINT, two=True, angle=0.0, ratio=N)
    assert after.values["load_inertia"] - before.values["load_inertia"] == pytest.approx(change, abs=1e-6)
    assert abs(after.weight) - abs(before.weight) == pytest.approx(moment, abs=1e-5)


# -- the split ----------------------------------------------------------------------------------------------------


def test_shapley_adds_up_gives_nothing_to_idlers_and_treats_equals_equally() -> None:
    def error(mended: frozenset[str]) -> float:
        return float(np.hypot(np.hypot("a" not in mended, "b" not in mended), 0.3) + 2.0 * ("c" not in mended))

    split = shapley(["a", "b", "c", "idle"], error)
    assert sum(split.values()) == pytest.approx(error(frozenset()) - error(frozenset("abc")))
    assert split["idle"] == 0.0
    assert split["a"] == pytest.approx(split["b"])


def test_the_right_model_has_nothing_to_change(tmp_path: Path, plain: Campaign) -> None:
    found = study(plain, written(tmp_path, nested()))
    assert found.kept == ()
    assert unified_diff(found) == ""
    assert len(changes_csv(found).splitlines()) == 1
    assert found.remaining == found.error < 0.02
    assert "Nothing to change" in simulation_sections({"simulation": simulation_json(found)})[0].text[0]


PLANTED = {
    "parameters": (nested(stiffness=160000.0), "stiffness"),
    "numerics": (nested().replace('"5e-4" integrator="RK4"', '"4e-3"'), "numerics"),
    "contradicted": (
        nested(held=' frictionloss="40" solreffriction="1e-4 1" solimpfriction="0.9999 0.9999"'),
        "motor_friction",
    ),
}


@pytest.mark.parametrize("share", sorted(PLANTED))
def test_a_planted_mistake_gets_the_largest_share_and_its_patch_mends_it(
    share: str, tmp_path: Path, plain: Campaign
) -> None:
    text, key = PLANTED[share]
    found = study(plain, written(tmp_path, text))
    assert max(found.shares, key=lambda k: found.shares[k]) == share
    assert sum(found.shares.values()) + found.remaining == pytest.approx(found.error, abs=1e-12)
    assert [k.change.key for k in found.kept] == [key]
    assert found.remaining < 0.02 < found.error
    assert found.patched == pytest.approx(found.remaining)
    assert found.kept[0].gain_alone == pytest.approx(found.error - found.remaining)


def test_friction_that_was_left_out_is_put_into_the_file(tmp_path: Path) -> None:
    rubbing = PLANTED["contradicted"][0].replace("5e-4", "2e-4")
    campaign = recorded(written(tmp_path, rubbing, "truth.xml"), JOINT)
    found = study(campaign, written(tmp_path, nested()), coulomb(40.0))
    assert max(found.shares, key=lambda k: found.shares[k]) == "left-out"
    assert found.remaining < 0.02 < found.error
    assert any(row.attribute == "frictionloss" and row.new == "40" for k in found.kept for row in k.lines)


@pytest.mark.skipif(shutil.which("patch") is None, reason="no patch program")
def test_patch_p1_applies_loads_and_reproduces_the_improvement(tmp_path: Path, plain: Campaign) -> None:
    path = written(tmp_path, nested(stiffness=170000.0, held=' frictionloss="25"'))
    found = study(plain, path)
    assert {k.change.key for k in found.kept} >= {"stiffness", "motor_friction"}
    diff = unified_diff(found)
    subprocess.run(["patch", "-p1"], input=diff.encode(), cwd=tmp_path, check=True, capture_output=True)
    assert path.read_bytes() == found.texts[0]
    assert "<!-- my robot: hands off -->" in path.read_text()
    again = study(plain, path)
    assert again.error == pytest.approx(found.patched, rel=1e-6)
    assert again.kept == ()


def test_a_rigid_model_gets_a_spring_behind_its_own_joint(tmp_path: Path, plain: Campaign) -> None:
    joint = OwnJoint(link="arm", actuator="m", torque="motor")
    found = study(plain, written(tmp_path, RIGID), joint=joint)
    assert "elasticity" in [k.change.key for k in found.kept]
    assert found.shares["left-out"] > 0.5 * found.error
    assert found.remaining < 0.05


# -- native elements ----------------------------------------------------------------------------------------------


def wanted(*effects: dict[str, Any]) -> Wanted:
    _, model = diagnosed(effects)
    return Wanted(base=model["base"], intervals={}, effects=effects, merged=frozenset(), single=False, vertical=False,
                  spring=True, ratio=N, efficiency=0.7)  # fmt: skip


def entry(name: str, location: str, variant: str = "", **parameters: float) -> dict[str, Any]:
    return {"effect": name, "location": location, "variant": variant, "parameters": parameters}


@pytest.mark.parametrize("form", ["nested", "geared"])
@pytest.mark.parametrize(
    ("effect", "law"),
    [
        (entry("backlash", "transmission", gap=2e-3), lambda d: K * np.sign(d) * max(abs(d) - 1e-3, 0.0)),
        (entry("stiffness-nonlinearity", "transmission", cubic=3e10, quadratic=0.0), lambda d: K * d + 3e10 * d**3),
        (entry("stiffness-nonlinearity", "transmission", "piecewise", soft_share=0.4, transition_angle=2e-3),
         lambda d: 0.6 * K * d + 0.4 * K * np.sign(d) * max(abs(d) - 2e-3, 0.0)),
    ],
)  # fmt: skip
def test_a_native_effect_has_its_closed_form(tmp_path: Path, form: str, effect: dict[str, Any], law: Any) -> None:
    text, joint = (nested(), JOINT) if form == "nested" else (GEARED, GEARED_JOINT)
    path = written(tmp_path, text)
    content = read_content(load_own(path), joint, two=True, angle=0.0, ratio=N)
    draft = Draft(read_sources(path))
    changes, notes = proposals(content, wanted(effect), draft)
    next(c for c in changes if c.share == "left-out").edit(draft)
    model = load_own(place(read_sources(path), draft.texts(), tmp_path / "out")).compile()
    data = mujoco.MjData(model)
    rotor = model.joint(str(joint.rotor)).qposadr[0]
    for wind_up in (-4e-3, -1e-3, 5e-4, 3e-3):
        data.qpos[:] = 0.0
        data.qpos[rotor] = wind_up * joint.rotor_ratio
        if form == "nested":  # the arm stays: the reducer takes it back
            data.qpos[model.joint(joint.link).qposadr[0]] = -wind_up
        mujoco.mj_forward(model, data)
        pull = data.qfrc_passive[model.joint(joint.link).dofadr[0]]  # on the load: + T_S
        assert pull == pytest.approx(law(wind_up), rel=1e-5, abs=1e-6)
    assert notes == []


def test_an_effect_without_an_element_is_said_to_be_in_effects_json(tmp_path: Path) -> None:
    path = written(tmp_path, nested())
    content = read_content(load_own(path), JOINT, two=True, angle=0.0, ratio=N)
    _, notes = proposals(content, wanted(entry("delay", "acquisition", delay=0.002)), Draft(read_sources(path)))
    assert len(notes) == 1
    assert "effects.json" in notes[0]


# -- the map ------------------------------------------------------------------------------------------------------

MAP = 'format = "jointscope-map/1"\nmodel = "robot.xml"\n[[joint]]\ncampaign = ""\n'


@pytest.mark.parametrize(
    ("lines", "complaint"),
    [
        ('link = "elbow"\n', r"joint\[0\].link = 'elbow': is not in robot.xml; it has: arm, rotor"),
        ('rotor = "rotor"\n', r"joint\[0\].link: is missing"),
        ('link = "arm"\nrotor = "rotor"\nrotor_ratio = 100\nactuator = "m"\ntorque = "motor"\n',
         r"joint\[0\].rotor_ratio = 100: no spring of robot.xml acts .* rotor_ratio = 141"),
        ('link = "arm"\nrotor = "rotor"\nrotor_ratio = 141\nactuator = "m"\ntorque = "output"\n',
         r"joint\[0\].torque = 'output': robot.xml then gives 1.392e\+04 N m"),
        ('link = "arm"\nspeed = 3\n', r"joint\[0\].speed = 3: unknown key"),
    ],
)  # fmt: skip
def test_a_wrong_map_is_one_clear_line(tmp_path: Path, plain: Campaign, lines: str, complaint: str) -> None:
    path = written(tmp_path, GEARED)
    with pytest.raises(InputError, match=complaint) as caught:
        own_joint(path, written(tmp_path, MAP + lines, "map.toml"), plain)
    assert "\n" not in str(caught.value)


def test_the_guessed_map_is_the_right_one(tmp_path: Path, plain: Campaign) -> None:
    assert own_joint(written(tmp_path, nested()), None, plain) == replace(JOINT, sensor_site=None)
    guessed = own_joint(written(tmp_path, GEARED, "g.xml"), None, plain)
    assert guessed.rotor_ratio == pytest.approx(N, rel=1e-6)
    assert (guessed.link, guessed.rotor, guessed.torque) == ("arm", "rotor", "motor")
