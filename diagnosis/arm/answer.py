"""``diagnosis.json`` of an arm: the contract's keys, with the joint beside effect and location."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, cast

import numpy as np

from jointscope.diagnosis.answer import diagnosis_json, finite_or_none
from jointscope.diagnosis.arm.law import SEPARATOR, split_location
from jointscope.diagnosis.arm.predict import free_prediction
from jointscope.diagnosis.arm.problem import PER_JOINT, ArmProblem

if TYPE_CHECKING:
    from jointscope.diagnosis.pipeline import Diagnosis

UNITS = {
    "stiffness": "N m/rad", "damping": "N m s/rad", "rotor_inertia": "kg m^2", "motor_damping": "N m s/rad",
    "drive_stiffness": "N m/rad", "drive_damping": "N m s/rad", "link_inertia": "1", "link_mass": "1",
    "load_damping": "N m s/rad",
}  # fmt: skip
SHIFTED = 3.0  # sigma beyond which a stated value is said to have been off


def parted(name: str) -> tuple[str, str | None]:
    """``effect@place:joint`` as ``effect@place`` and the joint."""
    effect, _, location = name.partition("@")
    place, joint = split_location(location)
    return f"{effect}@{place}", joint


def arm_answer(diagnosis: Diagnosis) -> dict[str, Any]:
    """The whole answer as plain data."""
    problem = cast("ArmProblem", diagnosis.problem)
    answer = finite_or_none(diagnosis_json(diagnosis, free_prediction))
    assert isinstance(answer, dict)
    answer["effects"] = [_effect(entry) for entry in answer["effects"]]
    answer["ranking"] = [_ranked(entry) for entry in answer["ranking"]]
    if answer.get("where"):
        _place(answer["where"])
    if "candidates" in answer:
        parts = [[parted(name) for name in names] for names in answer["candidates"]]
        answer["candidates"] = [[name for name, _ in names] for names in parts]
        answer["candidate_joints"] = [[joint for _, joint in names] for names in parts]
    joints = _by_joint(answer["parameters"])
    tested = problem.facts.joints[problem.facts.tested]
    answer["parameters"] = {
        **joints.get(tested, {}),
        **{k: v for k, v in answer["parameters"].items() if SEPARATOR not in k},
    }
    answer["joints"] = {
        joint: {
            "parameters": joints.get(joint, {}),
            "moved_by_these_recordings": bool(problem.seen[j]),
            "elastic_in_the_stated_model": bool(problem.stated.elastic[j]),
        }
        for j, joint in enumerate(problem.facts.joints)
    }
    answer["joint"] = tested
    answer["parameter_shift"] = _shifts(problem, joints)
    return answer


def _effect(entry: dict[str, Any]) -> dict[str, Any]:
    place, joint = split_location(entry["location"])
    parameters = dict(entry["parameters"])
    ratio = parameters.pop("breakaway_ratio", None)
    if ratio is not None and "torque" in parameters:
        torque = parameters["torque"]
        parameters["breakaway"] = {
            "value": torque["value"] * ratio["value"],
            "unit": torque["unit"],
            "interval95": [
                None if a is None or b is None else a * b
                for a, b in zip(torque["interval95"], ratio["interval95"], strict=True)
            ],
        }
    return {**entry, "location": place, "joint": joint, "parameters": parameters}


def _ranked(entry: dict[str, Any]) -> dict[str, Any]:
    parts = [parted(name) for name in entry["effects"]]
    return {**entry, "effects": [name for name, _ in parts], "joints": [joint for _, joint in parts]}


def _place(where: dict[str, Any]) -> None:
    locations = where.get("locations") or ([where["location"]] if where.get("location") else [])
    parts = [split_location(location) for location in locations]
    where["location"] = parts[0][0] if parts else None
    where["locations"] = [place for place, _ in parts]
    where["joint"] = parts[0][1] if parts else None
    where["joints"] = [joint for _, joint in parts]


def _by_joint(parameters: dict[str, Any]) -> dict[str, dict[str, Any]]:
    found: dict[str, dict[str, Any]] = {}
    for key, value in parameters.items():
        kind, _, joint = key.partition(SEPARATOR)
        if joint:
            found.setdefault(joint, {})[kind] = {**value, "unit": UNITS[kind]}
    return found


def _shifts(problem: ArmProblem, joints: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Stated figures that the recordings contradict; the joint under test by the contract's key, others with their joint."""
    stated = problem.stated
    table = dict(zip(PER_JOINT[:2], (stated.stiffness, stated.damping), strict=True))
    found: dict[str, Any] = {}
    for j, joint in enumerate(stated.joints):
        for kind, values in table.items():
            fitted = joints.get(joint, {}).get(kind)
            if fitted is None or values[j] <= 0.0:
                continue
            low, high = fitted["interval95"]
            if low is None or high is None or not np.isfinite(high - low):
                continue
            sigma = (high - low) / 3.92
            if sigma > 0.0 and abs(fitted["value"] - values[j]) > SHIFTED * sigma:
                key = kind if j == stated.tested else f"{kind} of {joint}"
                found[key] = {"nameplate": float(values[j]), "fitted": fitted["value"], "sigma": sigma}
    return found
