"""What is recorded of an arm: frozen settings, with the paper's section 4 as the default."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from importlib.resources import files
from pathlib import Path

from jointscope.models.arm.holding import Probe
from jointscope.models.arm.table import ArmTable, read_table
from jointscope.recordings.campaign import Location
from jointscope.sim.chain import Accelerometer, Chain, CurrentProbes
from jointscope.sim.measurement import Converter
from jointscope.sim.plan import HammerPlan

JOINT = "shoulder_lift_joint"
ELBOW = "elbow_joint"


@dataclass(frozen=True, kw_only=True)
class Sensor:
    """An accelerometer on the arm.

    Attributes:
        probe: Where and in which direction.
        location: ``arm``: on the link of the joint under test; ``neighbour``: on another link; ``base``.
        joint: Whose link it sits on, or ``None`` on the base.
        radius: From that joint's axis [m], where its direction is tangential to it.
    """

    probe: Probe
    location: Location
    joint: str | None = None
    radius: float | None = None


UPPER_ARM = Sensor(
    probe=Probe(name="acc_upper_arm", body="upper_arm_link", point=(0.0, 0.0, 0.55), axis=(1.0, 0.0, 0.0)),
    location="arm", joint=JOINT, radius=0.55,
)  # fmt: skip
FOREARM = Sensor(
    probe=Probe(name="acc_forearm", body="forearm_link", point=(0.0, 0.0, 0.5), axis=(1.0, 0.0, 0.0)),
    location="neighbour", joint=ELBOW,
)  # fmt: skip
BASE = Sensor(
    probe=Probe(name="acc_base", body="world", point=(0.0, 0.0, 0.0), axis=(0.0, 0.0, 1.0)), location="base"
)
HIT_UPPER_ARM = Probe(name="hit_upper_arm", body="upper_arm_link", point=(0.0, 0.0, 0.50), axis=(1.0, 0.0, 0.0))
HIT_FOREARM = Probe(name="hit_forearm", body="forearm_link", point=(0.0, 0.0, 0.45), axis=(1.0, 0.0, 0.0))


@dataclass(frozen=True, kw_only=True)
class HammerSpot:
    """Hits at one point of the arm in one posture, every rotor braked.

    Attributes:
        name: Begins the ids of its runs.
        hit: Point and direction.
        joint: Whose link is hit.
        radius: Of the point from that joint's axis [m].
        posture: Link angles [rad]; the plan's where ``None``.
        hammer: Hand, tip and number of hits.
    """

    name: str = "hammer"
    hit: Probe = HIT_UPPER_ARM
    joint: str = JOINT
    radius: float = 0.50
    posture: Mapping[str, float] | None = None
    hammer: HammerPlan = field(
        default_factory=lambda: HammerPlan(hits=20, levels=(120.0,), duration=4.0, double_hit_probability=0.0)
    )


@dataclass(frozen=True, kw_only=True)
class ArmSweep:
    """A torque sweep on top of the drive that holds the joint; the other joints are held by theirs.

    Attributes:
        levels: Amplitude on the motor shaft [N m].
        repeats: At each level.
        first_frequency, last_frequency: [Hz].
        sweep_time, lead, trail: [s].
    """

    levels: tuple[float, ...] = (0.3, 0.9)
    repeats: int = 1
    first_frequency: float = 4.0
    last_frequency: float = 80.0
    sweep_time: float = 6.0
    lead: float = 0.3
    trail: float = 0.7


@dataclass(frozen=True, kw_only=True)
class ArmMotion:
    """The joint moves there and back under its drive; the other joints are held by theirs.

    Attributes:
        travels: Of the joint [rad], signed as the joint's own angle.
        start_angle: Of the joint [rad].
        repeats: Of each travel.
        motion_time, lead, trail: [s].
    """

    travels: tuple[float, ...] = (-math.pi / 3.0, -2.0 * math.pi / 3.0)
    start_angle: float = 0.0
    repeats: int = 1
    motion_time: float = 4.8
    lead: float = 0.3
    trail: float = 0.7


def arm_chain() -> Chain:
    """DAQ at 1024 Hz, three phase currents at 10 kHz with 5 pole pairs and 0.458 N m/A (paper, Table 3), PLC."""
    return Chain(
        accelerometer=Accelerometer(low_cutoff=0.5, converter=Converter(full_scale=490.0, noise_rms=0.01)),
        currents=CurrentProbes(),
    )


def six_axis_table() -> ArmTable:
    """The solved arm that the package ships (``jointscope arm solve``): the simulation's truth."""
    return read_table(Path(str(files("jointscope.models.arm") / "six_axis.toml")))


def lab_table(truth: ArmTable, joints: tuple[str, ...] = (JOINT, ELBOW)) -> ArmTable:
    """What a lab knows beforehand: geometry, inertias and drives, but only rough reducers.

    The joints under test stand at a round catalogue figure (1e5 N m/rad, 50 N m s/rad), the others 10 % off in
    stiffness and 50 % in damping.
    """
    rows = tuple(
        replace(row, stiffness=1e5, damping=50.0)
        if row.name in joints
        else replace(row, stiffness=1.1 * row.stiffness, damping=1.5 * row.damping)
        for row in truth.joints
    )
    return replace(truth, joints=rows, computed={})


@dataclass(frozen=True, kw_only=True)
class ArmPlan:
    """A campaign of an arm.

    Attributes:
        truth: The arm that is simulated.
        lab: The arm as the lab believes it; its MJCF goes into the campaign.
        joint: That moves, or whose link is hit.
        upwards: +1 where a positive angle of that joint lifts its link, else -1: arm_angle = upwards q.
        spots: Where and in which postures it is hit.
        sweep, motion: ``None`` leaves them out.
        sensors: On every run.
        chain: Devices and converters.
        relative_noise: Noise of acceleration and force as shares of each hit's peak [-], instead of the converters'.
        drive_noise: Torque noise that the drive itself makes and its currents show [N m rms on the motor shaft].
        drive_noise_band: Upper edge of that noise [Hz].
        timestep: h [s].
    """

    truth: ArmTable = field(default_factory=six_axis_table)
    lab: ArmTable = field(default_factory=lambda: lab_table(six_axis_table()))
    joint: str = JOINT
    upwards: float = -1.0
    spots: tuple[HammerSpot, ...] = (HammerSpot(),)
    sweep: ArmSweep | None = field(default_factory=ArmSweep)
    motion: ArmMotion | None = field(default_factory=ArmMotion)
    sensors: tuple[Sensor, ...] = (UPPER_ARM, FOREARM, BASE)
    chain: Chain = field(default_factory=arm_chain)
    relative_noise: tuple[float, float] | None = None
    drive_noise: float = 0.03
    drive_noise_band: float = 300.0
    timestep: float = 1e-4
    title: str = "Six-axis arm, simulated"
