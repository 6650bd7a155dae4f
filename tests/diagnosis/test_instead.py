"""A loss factor in place of viscous damping: as much is lost at the joint's own resonance as before."""

import math

import pytest

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.effects import catalogue


def test_the_joints_own_resonance_loses_as_much(problem, truth):
    K, c, J = (float(truth[BASE_INDEX[name]]) for name in ("stiffness", "damping", "load_inertia"))
    w = math.sqrt(K / J)
    laws = [s for s in catalogue(problem) if s.name == "structural-damping"]
    assert laws and all(law.instead is not None for law in laws)
    for theta, (loss_factor,) in laws[0].instead(truth):
        assert 0.0 < theta[BASE_INDEX["damping"]] < c
        assert K * loss_factor + w * theta[BASE_INDEX["damping"]] == pytest.approx(w * c)
        assert theta[BASE_INDEX["stiffness"]] == K


def test_a_base_without_a_spring_gives_nothing(problem, truth):
    law = next(s for s in catalogue(problem) if s.name == "structural-damping")
    rigid = truth.copy()
    rigid[BASE_INDEX["stiffness"]] = 0.0
    assert law.instead(rigid) == ()
