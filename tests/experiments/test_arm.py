"""The six-axis reproduction: its plans, its recordings of a real robot, and, slowly, all of it."""

import numpy as np
import pytest

from jointscope.experiments.six_axis.plans import driven_plan, joints_plan
from jointscope.experiments.six_axis.report import PAPER_27
from jointscope.experiments.six_axis.windup import data_directory, kr300_windup
from jointscope.models.arm.solve import PAPER_TABLE_4


def test_printed_equation_27_gives_printed_table_4():
    """(25) on (27), dividing by b11: within the rounding of the printed coefficients."""
    for term, target in zip(PAPER_27, PAPER_TABLE_4, strict=True):
        assert term.inertia == pytest.approx(target.inertia, rel=7e-3)
        assert term.damping == pytest.approx(target.damping, rel=7e-3)
        assert term.stiffness == pytest.approx(target.stiffness, rel=7e-3)


def test_joints_are_hit_at_two_points_in_two_postures():
    spots = joints_plan().spots
    assert len({spot.hit for spot in spots}) == 2
    assert len({tuple(sorted(spot.posture.items())) for spot in spots}) == 2


def test_joint_two_is_driven_at_two_levels_of_each_kind():
    plan = driven_plan()
    assert plan.sweep is not None
    assert plan.motion is not None
    assert len(plan.sweep.levels) == len(plan.motion.travels) == 2
    assert (plan.sweep.first_frequency, plan.sweep.last_frequency) == (4.0, 80.0)
    assert plan.chain.electrical.pole_pairs == 5
    assert plan.chain.electrical.torque_constant == 0.458


@pytest.mark.skipif(data_directory() is None, reason="JOINTSCOPE_DATA is not set and ../shared/data is absent")
def test_the_kr300_s_windup_follows_its_speed():
    axes = kr300_windup(0)["axes"]
    for axis in axes:
        fit = axis["fit"]
        assert 2.6e-3 < fit.skew.value < 3.0e-3  # the same on three axes of different stiffness
        assert fit.skew_share > 0.95
        assert fit.plain_explained < 0.7
        assert fit.explained > 0.99
    assert axes[0]["fit"].stiffness.low <= 4.58e6
    assert axes[1]["fit"].stiffness.low <= 7.52e6 <= axes[1]["fit"].stiffness.high


@pytest.mark.slow
def test_everything_holds(tmp_path):
    from jointscope.experiments.six_axis import reproduce_six_axis

    assert reproduce_six_axis(tmp_path / "six", seed=1) == 0
    assert (tmp_path / "six" / "figure-23-motion-level2-01.png").is_file()


@pytest.mark.slow
def test_intervals_of_single_joints_cover():
    from jointscope.experiments.six_axis.recovery import recover, summary

    table = summary(recover(range(20), workers=2))
    for name, figures in table.items():
        if name.endswith(" K"):
            assert figures["worst"] < 0.03
        assert figures["coverage"] >= 0.8
        assert np.isfinite(figures["scatter"])
