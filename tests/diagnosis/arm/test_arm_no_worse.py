"""What foretells held-out runs of an arm worse than the base is not named either."""

from __future__ import annotations

import math
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

sys.path.insert(0, str(Path(__file__).parent))
import planar  # type: ignore[import-not-found]

from jointscope.diagnosis import no_worse
from jointscope.diagnosis.adequacy import Adequacy, Block
from jointscope.diagnosis.arm import pipeline
from jointscope.diagnosis.arm.effects import arm_catalogue
from jointscope.diagnosis.arm.prepare import prepare_arm
from jointscope.diagnosis.arm.problem import ArmProblem
from jointscope.diagnosis.effects import payloads, with_run_weights
from jointscope.diagnosis.effects.spec import ActiveEffect
from jointscope.diagnosis.verdict import Decision

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
    monkeypatch.setattr(pipeline, "explore", lambda *_: (SimpleNamespace(trials=()), []))
    monkeypatch.setattr(pipeline, "answered", lambda j: deciding(j, ActiveEffect(spec, tuple(values))))
    monkeypatch.setattr(no_worse, "better_somewhere", lambda *_: True)
    monkeypatch.setattr(no_worse, "like_nothing", lambda *_: ())
    with ThreadPoolExecutor(1) as pool:
        decision = pipeline.diagnose_arm(twice, pool).decision
    assert decision.verdict == verdict
    assert decision.chosen.names == (() if factor else (f"backlash@{spec.location}",))


@pytest.mark.parametrize(
    ("trial", "effect", "asked"),
    [
        ("payload", "backlash", True),
        ("backlash", "backlash", False),  # nothing suggests that some runs carry more than others
        ("payload", "payload", False),  # who carries it has been asked
    ],
)
def test_who_carries_is_asked_beside_what_was_found(twice, deciding, monkeypatch, trial, effect, asked):
    """A motion's own inertia tells nothing beside friction that the base lacks; beside the friction it tells all."""
    laws = {s.name: s for s in (*arm_catalogue(twice), with_run_weights(payloads(twice)[0], (0.0, 1.0), twice))}
    found = laws[effect]
    values = tuple(p.null for p in found.parameters)
    looks = []
    monkeypatch.setattr(
        pipeline, "explore", lambda *_: (SimpleNamespace(trials=(SimpleNamespace(spec=laws[trial]),)), [])
    )
    monkeypatch.setattr(pipeline, "answered", lambda j: deciding(j, ActiveEffect(found, values)))
    monkeypatch.setattr(
        pipeline, "second_look", lambda _, chosen, __, specs, ___: looks.append((chosen.names, specs)) or []
    )
    with ThreadPoolExecutor(1) as pool:
        pipeline.diagnose_arm(twice, pool)
    assert looks == ([((f"{effect}@{found.location}",), ())] if asked else [])


def test_an_arm_is_diagnosed_to_its_end_by_laws_that_its_model_knows(twice):
    """Searched in earnest: no law of the single joint's own is tried on the arm."""
    known = {f"{s.name}@{s.location}" for s in arm_catalogue(twice)}
    with ThreadPoolExecutor(1) as pool:
        found = pipeline.diagnose_arm(twice, pool)
    tried = {name for j in found.judgement.judged for name in j.names}
    assert tried and tried <= known


@pytest.mark.parametrize(
    ("common", "kappa", "verdict"),
    [
        (0.004, 0.0, "none"),  # as little as an arm's file is right to
        (0.0, 0.05, "none"),
        (0.0, 0.4, "unknown"),  # no two runs are alike, and what is left grows with the signal
        (0.03, 0.0, "unknown"),
    ],
)
def test_none_is_what_an_arm_s_file_is_right_to_and_no_more(common, kappa, verdict):
    key = ("speed-motion", False, "linear-acceleration", "arm", "tangential", 0.5, 1000.0)
    judgement = SimpleNamespace(
        base=SimpleNamespace(predictions=()),
        noise=SimpleNamespace(blocks={key: SimpleNamespace(grown=kappa, marginal=3.0, sigma=1.0)}),
        objective=SimpleNamespace(prepared=()),
    )
    fit = Adequacy((Block(key, 1000, 0.3**2, 0.3**2, common**2, common**2, 0.0),), math.nan, common, common)
    asked = Decision("unknown", judgement.base, 0.9, (), "outside-catalogue", (), fit)
    assert pipeline._within_geometry(judgement, asked).verdict == verdict
