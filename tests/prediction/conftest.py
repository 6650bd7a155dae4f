"""In-memory campaigns of the paper's rig: inputs as arrays, outputs declared or computed by the test."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jointscope.identification.model_file import BaseModel, joint_values
from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream

RIG = Nameplate(
    topology="two-inertia",
    motion="rotational",
    plane="vertical",
    reduction_ratio=141.0,
    motor_inertia=2.1e-4,
    reducer_inertia=2.48e-4,
    motor_damping=2.0,
    load_damping=2.0,
    arm_mass=12.0,
    arm_com_radius=0.4,
    efficiency=0.7,
)


class Bench:
    """Builders for the pieces of a campaign."""

    rig = RIG

    @staticmethod
    def model(rig: Nameplate = RIG, **joint: float) -> BaseModel:
        values = {"stiffness": 193_665.0, "damping": 59.76, "load_inertia": 3.02, **joint}
        return BaseModel(rig=rig, joint=joint_values(rig, **values))

    @staticmethod
    def horizontal(**changes: object) -> Nameplate:
        return replace(RIG, plane="horizontal", **changes)

    @staticmethod
    def channel(quantity, location, role, samples=None, column="", unit="1", **extra):
        return Channel(
            column=column or f"{quantity}-{location}",
            quantity=quantity,
            unit=unit,
            location=location,
            role=role,
            samples=samples,
            **extra,
        )

    @staticmethod
    def stream(rate, *channels, start=0.0, length=None, **extra):
        recorded = [c.samples.size for c in channels if c.samples is not None]
        count = length if length is not None else (recorded[0] if recorded else 0)
        return Stream(file="a.csv", sampling_rate=rate, start=start, length=count, channels=channels, **extra)

    @staticmethod
    def run(experiment, *streams, id="run", **extra):
        return Run(id=id, experiment=experiment, streams=streams, **extra)

    @staticmethod
    def campaign(*runs, rig=RIG):
        return Campaign(path=Path("campaign"), rig=rig, runs=runs)


@pytest.fixture
def bench():
    return Bench


@pytest.fixture
def rng():
    return np.random.default_rng(7)
