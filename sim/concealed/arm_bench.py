"""The arm of a case before anything is concealed in it: which joints give, posture, what is recorded, what the lab knows.

Everything here is drawn alike for cases with and without an effect.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from jointscope.models.arm.holding import Probe
from jointscope.models.arm.table import ArmTable, Payload
from jointscope.sim.arm.plan import ELBOW, JOINT, six_axis_table

WRIST = "wrist_1_joint"
NEIGHBOURS = (ELBOW, WRIST)


@dataclass(frozen=True, kw_only=True)
class Spot:
    """Where the arm is hit: joint whose link it is, point and direction."""

    joint: str
    probe: Probe


@dataclass(frozen=True, kw_only=True)
class ArmBench:
    """One case's arm and what is recorded of it.

    Attributes:
        truth: The arm as it is; joints without a row don't give.
        lab: The arm as the lab believes it: rough reducers, exact geometry.
        hidden: A joint that gives although the lab believes it rigid, or ``None``.
        posture: Link angles of hits and sweeps [rad].
        spots: Where it is hit.
        sensors: Accelerometers with their joints.
        hit_levels: Mean peak forces [N].
        sweep_levels: Amplitudes on the motor shaft [N m].
        travels: Of the motions [rad].
        repeats: Of each hit, sweep and motion.
        noise: Of acceleration [m/s^2], force [N] and logged torque [N m], rms.
        drive_noise: Torque noise of the drive [N m rms on the motor shaft].
        payload: Of the arm [kg].
    """

    truth: ArmTable
    lab: ArmTable
    hidden: str | None
    posture: dict[str, float]
    spots: tuple[Spot, ...]
    sensors: tuple[Spot, ...]
    hit_levels: tuple[float, ...]
    sweep_levels: tuple[float, ...]
    travels: tuple[float, ...]
    repeats: tuple[int, int, int]
    noise: tuple[float, float, float]
    drive_noise: float
    timestep: float = 2e-4


def _log(rng: np.random.Generator, low: float, high: float) -> float:
    return float(math.exp(rng.uniform(math.log(low), math.log(high))))


def _probe(name: str, body: str, height: float) -> Probe:
    return Probe(name=name, body=body, point=(0.0, 0.0, round(height, 3)), axis=(1.0, 0.0, 0.0))


def draw_arm_bench(rng: np.random.Generator, hidden: str | None = None) -> ArmBench:
    """A six-axis arm with two or three joints that give; ``hidden`` gives besides, unknown to the lab."""
    whole = six_axis_table()
    rows = {row.name: row for row in whole.joints}
    posture = dict(whole.posture)
    posture[JOINT] = round(-0.5 * math.pi + float(rng.uniform(-0.35, 0.35)), 4)
    posture[ELBOW] = round(float(rng.choice([-1.0, 1.0]) * rng.uniform(0.2, 1.1)), 4)
    posture[WRIST] = round(float(rng.uniform(-0.8, 0.8)), 4)
    payload = Payload(mass=round(float(rng.uniform(1.0, 8.0)), 2), com=(0.0, 0.12, 0.0), body="wrist_3_link")
    giving = [JOINT] + [name for name in NEIGHBOURS if rng.random() < 0.6]
    if hidden is not None and hidden in giving:
        giving.remove(hidden)
    made = {}
    for name in (*giving, *(() if hidden is None else (hidden,))):
        row = rows[name]
        K = row.stiffness * _log(rng, 0.6, 1.5)
        made[name] = replace(
            row, stiffness=K, damping=row.damping * (K / row.stiffness) ** 0.5 * _log(rng, 0.7, 2.0)
        )
    truth = replace(
        whole, joints=tuple(made[n] for n in rows if n in made), mass_scale=round(float(rng.uniform(0.85, 1.15)), 3),
        payload=payload, posture=posture, computed={},
    )  # fmt: skip
    rough = tuple(
        replace(
            made[n], stiffness=float(f"{made[n].stiffness * _log(rng, 0.75, 1.33):.3g}"),
            damping=float(f"{made[n].damping * _log(rng, 0.5, 2.0):.3g}"),
        )
        for n in rows
        if n in giving
    )  # fmt: skip
    height = float(rng.uniform(0.4, 0.55))
    reach = float(rng.uniform(0.35, 0.5))
    return ArmBench(
        truth=truth,
        lab=replace(truth, joints=rough),
        hidden=hidden,
        posture=posture,
        spots=(
            Spot(joint=JOINT, probe=_probe("hammer_a", "upper_arm_link", height - 0.05)),
            Spot(joint=ELBOW, probe=_probe("hammer_b", "forearm_link", reach - 0.05)),
        ),
        sensors=(
            Spot(joint=JOINT, probe=_probe("acc_1", "upper_arm_link", height)),
            Spot(joint=ELBOW, probe=_probe("acc_2", "forearm_link", reach)),
        ),
        hit_levels=(round(_log(rng, 60.0, 120.0)), round(_log(rng, 250.0, 450.0))),
        sweep_levels=(round(_log(rng, 0.15, 0.3), 3), round(_log(rng, 0.6, 1.0), 3)),
        travels=(round(float(rng.uniform(0.4, 0.6)), 3), round(float(rng.uniform(0.8, 1.2)), 3)),
        repeats=(2, 2, 2),
        noise=(_log(rng, 0.01, 0.05), _log(rng, 0.1, 0.5), _log(rng, 0.001, 0.004)),
        drive_noise=_log(rng, 0.005, 0.03),
    )
