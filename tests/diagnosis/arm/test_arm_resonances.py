"""A joint that the model has rigid is found at its own frequency, from wherever the base was refitted to; and no other."""

from __future__ import annotations

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import planar  # type: ignore[import-not-found]

from jointscope.diagnosis.arm.effects import arm_catalogue
from jointscope.diagnosis.arm.pipeline import EFFORT
from jointscope.diagnosis.arm.predict import predict_outputs
from jointscope.diagnosis.arm.prepare import prepare_arm
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.candidates import candidates_for, residuals_of
from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.resonances import resonances, resonances_beside
from jointscope.diagnosis.rounds import opened
from jointscope.diagnosis.search import Hypothesis, fit_child, profile_loss

BRAKED = {"a": "brake", "b": "brake"}
RIGID = (
    planar.MJCF.replace('<joint name="b_elastic" axis="0 1 0" stiffness="9000" damping="8"/>', "")
    .replace('<joint name="b" axis="0 1 0" armature="5" damping="1"/>', '<joint name="b" axis="0 1 0"/>')
    .replace('<numeric name="b_reduction_ratio" data="100"/>', "")
    .replace(planar.MJCF[planar.MJCF.index('<general name="b_drive"') : planar.MJCF.index("</actuator>")], "")
)
M_BB = 0.08 + 5.0 * 0.2**2  # kg m^2 of the forearm about joint b


def plainly(arena, candidates):
    return arena.base, resonances(arena.objective, arena.base.fit, candidates)


def found(folder, simulated, stated, ask=plainly, reads=1.0):
    """What ``ask`` finds on two hits of ``simulated``, diagnosed with the model ``stated``; accelerometers read ``reads``."""
    times, trajectory, _, _ = planar.stepped(planar.planar_arm(folder, simulated), BRAKED, 1.2)
    run = planar.hit_run(times, trajectory, BRAKED)
    rng = np.random.default_rng(11)

    def noisy(c):
        return (
            c
            if c.role == "input"
            else replace(c, samples=reads * c.samples + 0.02 * rng.standard_normal(c.samples.size))
        )

    runs = tuple(
        replace(
            run, id=str(k), streams=tuple(replace(s, channels=tuple(map(noisy, s.channels))) for s in run.streams)
        )
        for k in range(2)
    )
    (folder / "arm.xml").write_text(stated, encoding="utf-8")
    problem = prepare_arm(planar.campaign_of(folder, runs))
    with ThreadPoolExecutor(1) as pool:
        stage = refit_base(problem, predict_outputs, (0, 1), pool)
        candidates = candidates_for(
            problem, arm_catalogue(problem), residuals_of(stage.objective, stage.predictions)
        )
        arena = opened(stage, candidates, EFFORT)
        return ask(arena, candidates)


@pytest.mark.parametrize("K", [4000.0, 25000.0])
def test_a_joint_that_the_model_has_rigid_is_found_at_its_frequency(tmp_path, K):
    stated = RIGID.replace('stiffness="40000"', 'stiffness="46000"')
    base, modes = found(tmp_path, planar.MJCF.replace('stiffness="9000"', f'stiffness="{K}"'), stated)
    best = min(modes, key=lambda h: h.loss)
    assert best.names == ("neighbour-flexibility@neighbour:b",) and best.fit.chi2 < 0.5 * base.fit.chi2
    theta, (mode,) = best.fit.coordinates.unpack(best.fit.x)
    assert mode.values[0] == pytest.approx(np.sqrt(K / M_BB) / (2.0 * np.pi), rel=0.01)
    assert dict(zip(best.fit.coordinates.free, theta[best.fit.coordinates.free], strict=True))[0] == pytest.approx(
        40000.0, rel=0.01
    )


def test_a_joint_that_is_rigid_is_not_found(tmp_path):
    base, modes = found(tmp_path, planar.MJCF.replace('stiffness="9000"', 'stiffness="4e7"'), RIGID)
    assert all(base.loss - h.loss < 10.0 for h in modes)


def test_it_is_found_beside_a_leading_set_that_leaves_much_and_once(tmp_path):
    """Accelerometers that read a tenth low lead; beside them the joint is found, and beside both nothing is sought."""

    def beside(arena, candidates):
        gain = next(c for c in candidates if (c.spec.name, c.spec.variant) == ("sensor-gain", "factor"))
        fit = fit_child(arena.objective, arena.base.fit, [ActiveEffect(gain.spec, (0.9,))], EFFORT)
        assert fit is not None
        leader = Hypothesis((gain.spec,), fit, profile_loss(arena.objective, fit.w))
        first = resonances_beside(arena.objective, leader, candidates)
        best = min(first, key=lambda h: h.loss)
        return leader, best, resonances_beside(arena.objective, best, candidates)

    leader, best, again = found(tmp_path, planar.MJCF, RIGID, beside, reads=0.9)
    assert best.names == ("neighbour-flexibility@neighbour:b", "sensor-gain@acquisition")
    assert best.fit.chi2 < 0.2 * leader.fit.chi2 and again == []
    _, (gain, mode) = best.fit.coordinates.unpack(best.fit.x)
    assert mode.values[0] == pytest.approx(np.sqrt(9000.0 / M_BB) / (2.0 * np.pi), rel=0.02)
    assert gain.values[0] == pytest.approx(0.9, rel=0.02)
