"""model.json: what is written is read back, and what is broken is refused by key."""

import json
from pathlib import Path

import numpy as np
import pytest

from jointscope.errors import InputError, RefusedError
from jointscope.identification.model_file import BaseModel, Term, read_model, write_model
from jointscope.recordings.campaign import Nameplate

VALUES = {
    "stiffness": 2e5, "damping": 60.0, "load_inertia": 3.0, "motor_inertia": 2e-4, "reducer_inertia": 2e-4,
    "reduction_ratio": 141.0,
}  # fmt: skip


def model(**changes: object) -> BaseModel:
    content = {
        "rig": Nameplate(topology="two-inertia", motion="rotational", arm_mass=12.0),
        "joint": VALUES,
        "parameters": ("stiffness", "load_inertia"),
        "covariance": np.array([[4.0, 0.1], [0.1, 1.0]]),
        "terms": (Term(inertia=3.0, damping=60.0, stiffness=2e5),),
    }
    return BaseModel(**{**content, **changes})


def test_a_round_trip_changes_nothing(tmp_path: Path) -> None:
    write_model(tmp_path / "m.json", model())
    again = read_model(tmp_path / "m.json")
    assert (again.rig, dict(again.joint), again.parameters, again.terms) == (
        model().rig, VALUES, ("stiffness", "load_inertia"), model().terms,
    )  # fmt: skip
    np.testing.assert_array_equal(again.covariance, model().covariance)
    assert again.as_joint().stiffness == 2e5


def test_a_joint_with_unknown_values_says_which() -> None:
    with pytest.raises(RefusedError, match="motor_inertia"):
        model(joint={k: v for k, v in VALUES.items() if k != "motor_inertia"}).as_joint()


def test_draws_have_the_covariance() -> None:
    draws = model().draw(np.random.default_rng(0), 20000)
    np.testing.assert_allclose(np.cov(draws.T), model().covariance, atol=0.1)


@pytest.mark.parametrize(
    "changes",
    [{"parameters": ("stiffness",)}, {"joint": {"spring": 1.0}}, {"parameters": ("stiffness", "efficiency")}],
)
def test_contradictions_are_refused(changes: dict[str, object]) -> None:
    with pytest.raises(ValueError):
        model(**changes)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"format": "other/1"}, "format"),
        ({"joint": {"spring": 1.0}}, "joint.spring"),
        ({"rig": {"colour": 1}}, "rig.colour"),
    ],
)
def test_broken_files_are_refused_by_key(tmp_path: Path, change: dict[str, object], key: str) -> None:
    path = tmp_path / "m.json"
    write_model(path, model())
    path.write_text(json.dumps({**json.loads(path.read_text()), **change}))
    with pytest.raises(InputError) as problem:
        read_model(path)
    assert problem.value.key == key


def test_an_absent_or_garbled_file_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="no such file"):
        read_model(tmp_path / "none.json")
    (tmp_path / "bad.json").write_text("{")
    with pytest.raises(InputError, match="not JSON"):
        read_model(tmp_path / "bad.json")
