"""What is recorded for section 4 of the paper, and for what it leaves open."""

from __future__ import annotations

from dataclasses import replace

from jointscope.sim.arm.plan import (
    ELBOW,
    HIT_FOREARM,
    HIT_UPPER_ARM,
    JOINT,
    ArmMotion,
    ArmPlan,
    ArmSweep,
    HammerSpot,
    six_axis_table,
)
from jointscope.sim.plan import HammerPlan

RELATIVE_NOISE = (0.01, 0.005)  # of acceleration and force, shares of each hit's peak


def hammer_plan() -> ArmPlan:
    """20 hits on the second joint's link, every rotor braked (section 4.2)."""
    return ArmPlan(sweep=None, motion=None, relative_noise=RELATIVE_NOISE, title="Six-axis arm, hits on joint 2")


def joints_plan(hits: int = 5) -> ArmPlan:
    """Hits at two points in two postures: what single joints are identified from."""
    posture = dict(six_axis_table().posture)
    other = {**posture, JOINT: posture[JOINT] - 0.6, ELBOW: posture[ELBOW] - 0.6}
    hammer = HammerPlan(hits=hits, levels=(120.0,), duration=4.0, double_hit_probability=0.0)
    spots = tuple(
        HammerSpot(
            name=f"{where.name}-posture{number}", hit=where, joint=joint, radius=radius, posture=at, hammer=hammer
        )
        for number, at in enumerate((posture, other), start=1)
        for where, joint, radius in ((HIT_UPPER_ARM, JOINT, 0.50), (HIT_FOREARM, ELBOW, 0.45))
    )
    return replace(hammer_plan(), spots=spots, title="Six-axis arm, hits at two points in two postures")


def driven_plan() -> ArmPlan:
    """Joint 2 swept 4-80 Hz at two levels, and moving alone under its drive over two travels (section 4.3)."""
    return ArmPlan(spots=(), sweep=ArmSweep(), motion=ArmMotion(), title="Six-axis arm, joint 2 driven")
