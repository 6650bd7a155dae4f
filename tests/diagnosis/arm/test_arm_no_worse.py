"""What foretells held-out runs of an arm worse than the base is not named either."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))
import planar  # type: ignore[import-not-found]

from jointscope.diagnosis.arm import pipeline
from jointscope.diagnosis.arm.effects import arm_catalogue
from jointscope.diagnosis.arm.prepare import prepare_arm
from jointscope.diagnosis.arm.problem import ArmProblem
from jointscope.diagnosis.effects.spec import ActiveEffect

BRAKED = {"a": "brake", "b": "brake"}


@pytest.fixture(scope="module")
def twice(tmp_path_factory: pytest.TempPathFactory) -> ArmProblem:
    """The same hit on both of two takes; one is held out."""
    folder = tmp_path_factory.mktemp("twice")
    times, trajectory, _, _ = planar.stepped(planar.planar_arm(folder), BRAKED, 1.2)
    run = planar.hit_run(times, trajectory, BRAKED)
    return prepare_arm(planar.campaign_of(folder, (run, replace(run, id="i"))))


@pytest.mark.parametrize(("factor", "verdict"), [(2.0, "unknown"), (0.0, "effects")])
def test_an_effect_that_foretells_worse_is_not_named(twice, deciding, monkeypatch, factor, verdict):
    spec = next(s for s in arm_catalogue(twice) if s.name == "backlash")
    values = list(spec.starts(twice)[0])
    values.insert(spec.amplitude, spec.parameters[spec.amplitude].null + factor * spec.scale(twice)[2])
    monkeypatch.setattr(pipeline, "explore", lambda *_: (None, []))
    monkeypatch.setattr(pipeline, "answered", lambda j: deciding(j, ActiveEffect(spec, tuple(values))))
    with ThreadPoolExecutor(1) as pool:
        decision = pipeline.diagnose_arm(twice, pool).decision
    assert decision.verdict == verdict
    assert decision.chosen.names == (() if factor else (f"backlash@{spec.location}",))


def test_an_arm_is_diagnosed_to_its_end_by_laws_that_its_model_knows(twice):
    """Searched in earnest: no law of the single joint's own is tried on the arm."""
    known = {f"{s.name}@{s.location}" for s in arm_catalogue(twice)}
    with ThreadPoolExecutor(1) as pool:
        found = pipeline.diagnose_arm(twice, pool)
    tried = {name for j in found.judgement.judged for name in j.names}
    assert tried and tried <= known
