"""A user's own file: read as text, understood as a joint, stepped unchanged."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jointscope.errors import InputError
from jointscope.experiments.own_model.content import read_content
from jointscope.experiments.own_model.files import unified_diff
from jointscope.experiments.own_model.inertia import put_mass
from jointscope.experiments.own_model.mapping import own_joint
from jointscope.experiments.own_model.scoring import outputs_of
from jointscope.experiments.own_model.xml_document import Draft, read_sources
from jointscope.recordings.campaign import Campaign
from jointscope.sim.effects.description import physics_of
from jointscope.sim.own_model import OwnJoint, load_own
from jointscope.sim.own_stepping import own_run

sys.path.insert(0, str(Path(__file__).parent))
from own_file import (  # type: ignore[import-not-found]
    B_L,
    B_M,
    GEARED,
    GEARED_JOINT,
    J_L,
    J_M,
    JOINT,
    RIGID,
    SHAFTED,
    SHAFTED_JOINT,
    C,
    K,
    N,
    nested,
    recorded,
    study,
    written,
)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    folder = tmp_path_factory.mktemp("truth")
    return recorded(written(folder, nested().replace("5e-4", "2e-4")), JOINT)


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
    shafted = written(tmp_path, SHAFTED, "s.xml")
    third = read_content(load_own(shafted), SHAFTED_JOINT, two=True, angle=0.1, ratio=N)
    assert one.values == pytest.approx(truth, rel=1e-6)
    assert other.values == pytest.approx(truth, rel=1e-6)
    assert third.values == pytest.approx(truth, rel=1e-6)


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


def test_a_shaft_that_an_equality_gears_records_nearly_the_same_and_stands_on_the_brake(
    tmp_path: Path, plain: Campaign
) -> None:
    """MuJoCo's equality is soft: it gives a little under the motor's torque."""
    one = load_own(written(tmp_path, nested().replace("5e-4", "2e-4")))
    other = load_own(written(tmp_path, SHAFTED, "s.xml"))
    for run in plain.runs:
        a, b = own_run(plain, run, one, JOINT), own_run(plain, run, other, SHAFTED_JOINT)
        for x, y in zip(outputs_of(a), outputs_of(b), strict=True):
            np.testing.assert_allclose(x.samples, y.samples, atol=5e-3 * np.abs(x.samples).max())


def test_a_payload_loads_an_own_arm_about_its_axis_whatever_its_frame(tmp_path: Path, plain: Campaign) -> None:
    """Stepped by the law of effects.json, and with as much written into the file."""
    law = {"kind": "payload", "inertia": 0.6, "runs": {run.id: 1.0 for run in plain.runs}}
    text = nested().replace('"shoulder_spring"', '"reducer"').replace('"shoulder"', '"motor"')
    description = {
        "laws": [law],
        "rig": {"reduction_ratio": N, "plane": "horizontal", "motion": "rotational", "topology": "two-inertia"},
        "spring": {"stiffness": K, "damping": C},
    }
    joint = replace(JOINT, link="reducer", rotor="motor")
    loaded = load_own(written(tmp_path, text.replace('"0.001 0.02 0.02"', '"0.601 0.62 0.62"'), "loaded.xml"))
    for run in plain.runs[:2]:
        physics = physics_of(description)(run)
        a = own_run(plain, run, load_own(written(tmp_path, text)), joint, physics=physics)
        b = own_run(plain, run, loaded, joint)
        for x, y in zip(outputs_of(a), outputs_of(b), strict=True):
            np.testing.assert_allclose(x.samples, y.samples, atol=1e-6 * np.abs(x.samples).max())


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
