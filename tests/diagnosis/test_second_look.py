"""On top of what was decided every law is scored once more, under the noise that it leaves: what is there is found."""

from concurrent.futures import ThreadPoolExecutor

import pytest

from jointscope.diagnosis.adjudicate import judge
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.candidates import candidates_for
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.search import Effort, Hypothesis, fit_child, screen_on
from jointscope.diagnosis.second_look import second_look
from jointscope.diagnosis.split import split_runs

NOISE = 2e-3  # of each channel's rms
LAG = ("drive-lag", "first-order", (8e-4,))
FRICTION = ("coulomb-friction", "plain", None)  # of the size that this rig would have
PLACES = {"drive-lag": "motor", "coulomb-friction": "load"}


def active(problem, name, variant, values):
    known = (name, variant, PLACES[name])
    spec = next(s for s in catalogue(problem) if (s.name, s.variant, s.location) == known)
    return ActiveEffect(spec, values or (spec.scale(problem)[0],))


@pytest.fixture
def looked(problem, recorded):
    """Names that the second look finds on top of ``decided``, where the data hold ``concealed``."""

    def look(decided, concealed):
        own = recorded(problem, NOISE, effects=tuple(active(problem, *c) for c in concealed))
        split = split_runs(own)
        with ThreadPoolExecutor(2) as pool:
            stage = refit_base(own, predict_outputs, split.estimate, pool)
            known = []
            for law in decided:
                first = active(own, *law)
                known.append(
                    Hypothesis((first.spec,), fit_child(stage.objective, stage.fit, [first], Effort()), 0.0)
                )
            judgement = judge(stage, known, split.held_out)
            named = {law[0] for law in (*decided, *concealed)}
            specs = [s for s in catalogue(own) if s.name in {*named, "stiffness-nonlinearity"}]
            before = screen_on(stage.objective, stage.fit, candidates_for(own, specs), Effort())
            chosen = next(j for j in judgement.judged if len(j.names) == len(decided))
            return {names for h in second_look(judgement, chosen, before, specs, Effort()) for names in [h.names]}

    return look


def test_what_stands_beside_the_decided_effect_is_found(looked):
    found = looked([LAG], [LAG, FRICTION])
    assert any({"drive-lag@motor"} < set(names) and any("coulomb" in n for n in names) for names in found)


def test_nothing_is_found_where_nothing_is_left(looked):
    assert looked([LAG], [LAG]) == set()
    assert looked([], []) == set()


def test_the_base_alone_is_looked_at_too(looked):
    assert ("drive-lag@motor",) in looked([], [LAG])
