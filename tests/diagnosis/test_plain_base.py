"""What a mismatch is shown against is the base as it foretells best, however the judged one was bent to fit."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest

from jointscope.diagnosis.adjudicate import evidence, judge
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.locate import Places
from jointscope.diagnosis.pipeline import Diagnosis
from jointscope.diagnosis.plain_base import with_plain_base
from jointscope.diagnosis.polish import viewed
from jointscope.diagnosis.predict import free_prediction, predict_outputs
from jointscope.diagnosis.search import Hypothesis
from jointscope.diagnosis.split import split_runs
from jointscope.diagnosis.verdict import decide


@pytest.mark.parametrize("bent", [0.0, 0.05])
def test_a_base_that_was_bent_gives_way_to_its_plain_refit(problem, recorded, bent):
    """By nothing, it stays the very one; by 5 % in its first parameter, the plain one is shown, ranked and handed on."""
    noisy = recorded(problem, 0.01)
    with ThreadPoolExecutor(1) as pool:
        split = split_runs(noisy)
        stage = refit_base(noisy, predict_outputs, split.estimate, pool)
        judgement = judge(stage, (), split.held_out)
        x = stage.fit.x.copy()
        x[0] += bent
        objective = judgement.objective
        base = evidence(viewed(objective, Hypothesis((), replace(stage.fit, x=x), 0.0)), objective, judgement.held)
        judgement = replace(judgement, judged=(base,))
        decision = decide(judgement)
        nowhere = Places((), {}, None)
        before = Diagnosis(noisy, split, stage, None, judgement, replace(decision, chosen=base), nowhere, None)
        after = with_plain_base(before, free_prediction)
    assert (after is before) is (bent == 0.0)
    if bent:
        plain = after.judgement.base
        assert plain.fit.x == pytest.approx(stage.fit.x)
        assert after.decision.chosen is plain is after.decision.ranking[0].judged
        assert plain.chi2 < base.chi2
