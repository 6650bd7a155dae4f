"""A case before anything is concealed in it: rig, runs, devices and noise."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from jointscope.models.parameters import Rig
from jointscope.sim.concealed import rigs
from jointscope.sim.concealed.law import Draw, Setting
from jointscope.sim.concealed.measurement import Noise
from jointscope.sim.concealed.rehearsal import Plan

SET_SHARES = {"H": 0.27, "S": 0.06, "M": 0.07, "HS": 0.28, "HSM": 0.32}


@dataclass(frozen=True, eq=False)
class Bench:
    """A case before anything is concealed in it.

    Attributes:
        hard: Whether noise is coloured, level dependent and with outliers, hits scatter more, and the nameplate's rough
            values are far off; as often with an effect as without.
    """

    rig: Rig
    plan: Plan
    noise: Noise
    experiments: str
    topology: Literal["two-inertia", "single-dof"]
    hard: bool
    motion: Literal["rotational", "translational"]

    @property
    def setting(self) -> Setting:
        """The case's scales."""
        assert self.plan.setting is not None
        return self.plan.setting


def draw_bench(rng: np.random.Generator, draw: Draw, *, experiments: str | None = None) -> Bench:
    """Rig, runs, devices and noise of a case."""
    names = list(SET_SHARES)
    chosen = names[int(rng.choice(len(names), p=list(SET_SHARES.values())))]
    experiments = experiments or chosen
    vertical, single, hard = rng.random() < 0.65, rng.random() < 0.3, bool(rng.random() < 1 / 3)
    slides = bool(rng.random() < 0.3) and bool(single) and experiments == "H"
    rig = rigs.draw_carriage(rng, draw) if slides else rigs.draw_rig(rng, draw, vertical=bool(vertical))
    kinds = rigs.SETS[experiments]
    plan = rigs.draw_plan(rng, draw, rig, kinds)
    if single and experiments == "H":  # no motor to look at
        plan = replace(plan, devices=replace(plan.devices, motor_encoder=False))
    plan = rigs.settle_scales(rig, plan, kinds)
    noise = rigs.draw_noise(rng, draw, plan, hard=hard)
    plan = rigs.scatter_hits(rng, plan, noise)
    topology: Literal["two-inertia", "single-dof"] = (
        "single-dof" if single and experiments == "H" else "two-inertia"
    )
    return Bench(rig, plan, noise, experiments, topology, hard, "translational" if slides else "rotational")
