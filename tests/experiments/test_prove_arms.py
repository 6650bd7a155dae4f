"""Scoring of arms: name, place and joint count; what nothing was concealed in must be answered so."""

from __future__ import annotations

from typing import Any

import pytest

from jointscope.experiments.prove.arms import arm_table, confusion, judge_arm, page
from jointscope.experiments.prove.diagnosing import Answer


def truth(*effects: dict[str, Any], share: float = 0.1) -> dict[str, Any]:
    return {"case": "c", "effects": list(effects), "strength": {"share": share} if effects else None}


def answer(verdict: str, *effects: dict[str, Any]) -> Answer:
    return Answer("c", "answered", 12.0, {"verdict": verdict, "effects": list(effects)})


def play(joint: str, gap: float = 1e-3) -> dict[str, Any]:
    return {
        "effect": "backlash", "location": "transmission", "joint": joint, "values": {"gap": 1e-3},
        "parameters": {"gap": {"value": gap}},
    }  # fmt: skip


def test_right_needs_the_joint() -> None:
    right = judge_arm(truth(play("elbow")), answer("effects", play("elbow", 1.1e-3)))
    wrong = judge_arm(truth(play("elbow")), answer("effects", play("wrist")))
    assert right.exact and right.joint and right.error == pytest.approx(0.1)
    assert not wrong.exact and not wrong.joint and wrong.error is None


def test_a_null_is_right_only_as_none() -> None:
    assert judge_arm(truth(), answer("none")).exact
    assert not judge_arm(truth(), answer("unknown")).exact
    assert not judge_arm(truth(), answer("effects", play("elbow"))).exact


def test_a_crash_is_wrong() -> None:
    assert not judge_arm(truth(), Answer("c", "crashed", 1.0, None)).exact


def test_faint_effects_are_counted_apart() -> None:
    judged = [
        judge_arm(truth(play("elbow"), share=0.001), answer("none")),
        judge_arm(truth(play("elbow")), answer("effects", play("elbow"))),
        judge_arm(truth(), answer("none")),
    ]
    rows = {row["name"]: row for row in arm_table(judged)}
    assert (
        rows["effects named with place and joint"]["hits"],
        rows["effects named with place and joint"]["cases"],
    ) == (1, 1)
    assert rows["faint effects named with place and joint"]["cases"] == 1
    assert confusion(judged) == {
        "backlash@transmission": {"none": 1, "backlash@transmission": 1}, "nothing": {"none": 1},
    }  # fmt: skip
    assert "backlash@transmission:elbow" in page(
        {"cases": 3, "seal": "s", "table": list(rows.values()), "confusion": confusion(judged)}, judged
    )
