"""A joint that became rigid where its stiffness has no gradient is found soft again; a stiff one stays."""

import math
from dataclasses import replace

import pytest

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.eased import RIGID, eased
from jointscope.diagnosis.search import Hypothesis

STIFF = BASE_INDEX["stiffness"]


def at(problem, fitted, factor):
    """Sweeps alone, in which a stiffness far above the band has no gradient."""
    problem = replace(problem, runs=tuple(run for run in problem.runs if run.run.experiment != "hammer"))
    objective, fits = fitted(problem)
    theta = problem.base.start.copy()
    theta[STIFF] *= factor
    return objective, Hypothesis((), fits(theta), math.inf)


def test_a_rigid_joint_becomes_as_soft_as_it_is(problem, recorded, fitted):
    objective, rigid = at(recorded(problem, 0.01), fitted, 40.0)
    (found,) = eased(objective, [rigid])
    assert found.fit.chi2 < rigid.fit.chi2
    theta, _ = found.fit.coordinates.unpack(found.fit.x)
    assert theta[STIFF] == pytest.approx(problem.base.start[STIFF], rel=0.02)


def test_a_joint_about_as_stiff_as_stated_is_left_alone(problem, recorded, fitted):
    objective, fit = at(recorded(problem, 0.01), fitted, 0.2 * RIGID)
    assert eased(objective, [fit]) == []
