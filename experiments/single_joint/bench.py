"""The paper's bench, simulated twice from one seed: as its sensors record it, and as it truly moved."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from jointscope.models.paper import paper_rig
from jointscope.models.parameters import Rig
from jointscope.recordings.campaign import Campaign, Run
from jointscope.sim.chain import Chain, noiseless
from jointscope.sim.measurement import Device
from jointscope.sim.measurement_log import LogKind, TorqueLog
from jointscope.sim.plan import HammerPlan, MotionPlan, SingleJointPlan, SweepPlan
from jointscope.sim.single_joint import simulate_single_joint


@dataclass(frozen=True, kw_only=True, eq=False)
class Bench:
    """One seed's campaigns.

    Attributes:
        rig: The truth.
        recorded: Through sensors, converters and logs.
        truth: The same takes through ideal sensors, sweeps and motions only.
        logs: The sweep whose torque log is distorted, by kind; ``band-limited`` is the undistorted one.
    """

    rig: Rig
    recorded: Campaign
    truth: Campaign
    logs: dict[LogKind, Run]


def bench(seed: int, *, quick: bool) -> Bench:
    """Simulate: 20 hits (10 in the quick form), one sweep and one motion at each of two levels (one in the quick form)."""
    rig = paper_rig()
    plan = SingleJointPlan(
        hammer=HammerPlan(hits=5 if quick else 10),
        sweep=SweepPlan(repeats=1, levels=(0.9,) if quick else (0.3, 0.9)),
        motion=MotionPlan(repeats=1, travels=(2.0 * np.pi / 3.0,) if quick else (np.pi / 3.0, 2.0 * np.pi / 3.0)),
    )
    recorded = simulate_single_joint(rig, plan, np.random.default_rng(seed))
    # the truth draws from the same children of the seed, hits included, so that it is the same takes
    truth = simulate_single_joint(rig, replace(plan, chain=noiseless()), np.random.default_rng(seed))
    strongest = SweepPlan(repeats=1, levels=(0.9,))
    logs: dict[LogKind, Run] = {}
    kinds: tuple[tuple[LogKind, float], ...] = (("band-limited", 500.0), ("hold", 1000.0), ("average", 500.0))
    for kind, file_rate in kinds:  # a held value stands twice in a 1 kHz export of a 500 Hz log
        log = TorqueLog(kind=kind, rate=None if kind == "band-limited" else 500.0)
        chain = replace(Chain(), torque_log=log, plc=Device(sampling_rate=file_rate))
        alone = SingleJointPlan(hammer=None, sweep=strongest, motion=None, chain=chain)
        logs[kind] = simulate_single_joint(rig, alone, np.random.default_rng(seed)).runs[0]
    return Bench(rig=rig, recorded=recorded, truth=truth, logs=logs)
