"""A user's own file mended line by line: which mistake costs how much, and effects as elements that MuJoCo has."""

from __future__ import annotations

import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from jointscope.experiments.own_model.changes import proposals
from jointscope.experiments.own_model.content import read_content
from jointscope.experiments.own_model.files import changes_csv, unified_diff
from jointscope.experiments.own_model.sections import simulation_sections
from jointscope.experiments.own_model.shares import shapley
from jointscope.experiments.own_model.stepping import place
from jointscope.experiments.own_model.study import simulation_json
from jointscope.experiments.own_model.wanted import Wanted
from jointscope.experiments.own_model.xml_document import Draft, read_sources
from jointscope.recordings.campaign import Campaign
from jointscope.sim.own_model import OwnJoint, load_own

sys.path.insert(0, str(Path(__file__).parent))
from own_file import (  # type: ignore[import-not-found]
    GEARED,
    GEARED_JOINT,
    JOINT,
    RIGID,
    K,
    N,
    coulomb,
    diagnosed,
    nested,
    recorded,
    study,
    written,
)


@pytest.fixture(scope="module")
def plain(tmp_path_factory: pytest.TempPathFactory) -> Campaign:
    folder = tmp_path_factory.mktemp("truth")
    return recorded(written(folder, nested().replace("5e-4", "2e-4")), JOINT)


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


BAND = ' springlength="-0.001 0.001"'


def test_a_dead_band_that_the_rig_has_not_is_closed_about_its_middle(tmp_path: Path, plain: Campaign) -> None:
    text = GEARED.replace('stiffness="193665"', 'stiffness="193665"' + BAND)
    found = study(plain, written(tmp_path, text), joint=GEARED_JOINT)
    assert max(found.shares, key=lambda k: found.shares[k]) == "contradicted"
    assert [k.change.key for k in found.kept] == ["gear_springlength"]
    assert "a dead band of 0.002 at the joint's output" in found.kept[0].change.reason
    assert found.remaining < 0.02 < found.error


def test_play_of_another_width_is_a_wrong_value_and_no_physics_left_out(tmp_path: Path) -> None:
    text = GEARED.replace('stiffness="193665"', 'stiffness="193665"' + BAND)
    path = written(tmp_path, text)
    content = read_content(load_own(path), GEARED_JOINT, two=True, angle=0.0, ratio=N)
    changes, _ = proposals(content, wanted(entry("backlash", "transmission", gap=3e-3)), Draft(read_sources(path)))
    mended = next(c for c in changes if c.key == "backlash@transmission")
    assert mended.share == "parameters"
    assert "the model has 0.002, the recording 0.003" in mended.reason
    assert not [c for c in changes if c.share == "contradicted"]


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


INERTIAL = '<inertial pos="0.5 0 0" mass="12" diaginertia="0.001 0.02 0.02"/>'


@pytest.mark.parametrize("body", [INERTIAL, '<geom type="box" pos="0.5 0 0" size="0.1 0.02 0.02" mass="13"/>'])
@pytest.mark.parametrize("form", ["nested", "geared"])
def test_a_neighbour_takes_its_part_of_the_inertia_onto_its_own_spring(
    tmp_path: Path, form: str, body: str
) -> None:
    text, joint = (nested(), JOINT) if form == "nested" else (GEARED, GEARED_JOINT)
    path = written(tmp_path, text.replace(INERTIAL, body))
    content = read_content(load_own(path), joint, two=True, angle=0.0, ratio=N)
    part, frequency = 0.1, 26.0
    effect = entry("neighbour-flexibility", "neighbour", frequency=frequency, modal_share=part, damping=0.02)
    asked = wanted(effect)
    total = asked.base["load_inertia"]
    draft = Draft(read_sources(path))
    changes, notes = proposals(content, asked, draft)
    for change in changes:  # the inertia's own line too, where it is off
        if change.key in ("load_inertia", "neighbour-flexibility@neighbour"):
            change.edit(draft)
    assert notes == []
    model = load_own(place(read_sources(path), draft.texts(), tmp_path / "out")).compile()
    data, mass = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, mass)
    both = [int(model.joint(name).dofadr[0]) for name in (joint.link, f"{joint.link}_neighbour")]
    assert mass[np.ix_(both, both)] == pytest.approx(total * np.array([[1.0, part], [part, part]]), rel=1e-5)
    spring = model.joint(f"{joint.link}_neighbour")
    assert float(spring.stiffness[0]) == pytest.approx(part * total * (2.0 * np.pi * frequency) ** 2, rel=1e-5)
    assert float(spring.damping[0]) == pytest.approx(2.0 * 0.02 * part * total * 2.0 * np.pi * frequency, rel=1e-5)


def test_an_effect_that_was_not_named_is_not_said_to_be_shown(tmp_path: Path) -> None:
    path = written(tmp_path, GEARED)
    content = read_content(load_own(path), GEARED_JOINT, two=True, angle=0.0, ratio=N)
    open_one = {**entry("backlash", "transmission", gap=3e-3), "named": False}
    changes, _ = proposals(content, wanted(open_one), Draft(read_sources(path)))
    assert "not enough to name it" in next(c.reason for c in changes if c.share == "left-out")


def test_an_effect_without_an_element_is_said_to_be_in_effects_json(tmp_path: Path) -> None:
    path = written(tmp_path, nested())
    content = read_content(load_own(path), JOINT, two=True, angle=0.0, ratio=N)
    _, notes = proposals(content, wanted(entry("delay", "acquisition", delay=0.002)), Draft(read_sources(path)))
    assert len(notes) == 1
    assert "effects.json" in notes[0]
