"""What is recorded in a single-joint campaign: frozen settings, every one with the paper's experiment as its default."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from jointscope.errors import JointscopeError
from jointscope.models.paper import paper
from jointscope.sim.chain import Chain
from jointscope.sim.drive import SpeedDrive
from jointscope.sim.pulse import Hardness
from jointscope.sim.stepping import TIMESTEP


class PlanError(JointscopeError):
    """A campaign can't be recorded as planned."""


@dataclass(frozen=True, kw_only=True)
class HammerPlan:
    """Hits on the arm with the motor braked; no two are alike.

    Attributes:
        hits: At each level.
        levels: Mean peak force [N].
        hardness: Of the tip; it sets the mean contact time (``pulse.CONTACT_TIMES``).
        arm_angle: [rad].
        duration: Of each record [s].
        pre_trigger: Before the hit [s]; its place between two samples is random.
        level_scatter: Relative standard deviation of the peak.
        contact_scatter: Relative standard deviation of the contact time.
        position_scatter: Standard deviation of the place along the arm [m].
        gain_scatter: Relative standard deviation of the torque per recorded force (hits off the normal).
        timing_scatter: Standard deviation of a hit's skew between force and acceleration [s].
        double_hit_probability: That the hammer rebounds onto the arm.
    """

    hits: int = 10
    levels: tuple[float, ...] = (120.0, 360.0)
    hardness: Hardness = "medium"
    arm_angle: float = 0.0
    duration: float = 2.0
    pre_trigger: float = 0.05
    level_scatter: float = 0.15
    contact_scatter: float = 0.05
    position_scatter: float = 0.001
    gain_scatter: float = 0.002
    timing_scatter: float = 5e-6
    double_hit_probability: float = 0.03


@dataclass(frozen=True, kw_only=True)
class SweepPlan:
    """Swept torque in torque control, about the equilibrium that a constant holding torque keeps.

    Attributes:
        repeats: At each level.
        levels: Torque amplitude on the motor shaft [N m].
        first_frequency: [Hz].
        last_frequency: [Hz].
        sweep_time: [s].
        arm_angle: At the start [rad]; hanging, so that gravity brings the arm back.
        lead: Rest before [s].
        trail: After [s].
    """

    repeats: int = 2
    levels: tuple[float, ...] = (0.3, 0.9)
    first_frequency: float = 4.0
    last_frequency: float = 80.0
    sweep_time: float = 3.0
    arm_angle: float = -math.pi / 3.0
    lead: float = 0.1
    trail: float = 0.4


@dataclass(frozen=True, kw_only=True)
class MotionPlan:
    """There and back in speed control, at triangular speed.

    Attributes:
        repeats: Of each travel.
        travels: At the joint output [rad].
        motion_time: There and back [s].
        arm_angle: At the start [rad].
        drive: The speed loop.
        lead: Rest before [s].
        trail: After [s].
    """

    repeats: int = 2
    travels: tuple[float, ...] = (math.pi / 3.0, 2.0 * math.pi / 3.0)
    motion_time: float = 4.8
    arm_angle: float = 0.0
    drive: SpeedDrive = field(default_factory=SpeedDrive)
    lead: float = 0.1
    trail: float = 0.4


@dataclass(frozen=True, kw_only=True)
class RoughFigures:
    """What a nameplate says besides the exact items: starting values and comparisons, independent of the truth.

    Attributes:
        motor_damping: b_m [N m s/rad].
        load_damping: b_l [N m s/rad].
        stiffness_reference: [N m/rad].
        inertia_reference: [kg m^2].
        damping_reference: [N m s/rad].
    """

    motor_damping: float | None = 2.0
    load_damping: float | None = 2.0
    stiffness_reference: float | None = field(default_factory=lambda: paper().table1.reducer_stiffness)
    inertia_reference: float | None = field(default_factory=lambda: paper().table2_reference.inertia)
    damping_reference: float | None = field(default_factory=lambda: paper().table2_reference.damping)


@dataclass(frozen=True, kw_only=True)
class SingleJointPlan:
    """A whole campaign.

    Attributes:
        hammer: ``None`` leaves the hits out.
        sweep: ``None`` leaves the sweeps out.
        motion: ``None`` leaves the motions out.
        chain: Sensors and devices.
        rough: The inexact part of the nameplate.
        timestep: Of the simulation [s].
        title: Of the campaign.
        notes: Of the campaign.
    """

    hammer: HammerPlan | None = field(default_factory=HammerPlan)
    sweep: SweepPlan | None = field(default_factory=SweepPlan)
    motion: MotionPlan | None = field(default_factory=MotionPlan)
    chain: Chain = field(default_factory=Chain)
    rough: RoughFigures = field(default_factory=RoughFigures)
    timestep: float = TIMESTEP
    title: str = "Single-joint bench, simulated"
    notes: str = ""

    def __post_init__(self) -> None:
        if self.hammer is None and self.sweep is None and self.motion is None:
            raise PlanError("SingleJointPlan: holds no experiment; give at least one of hammer, sweep, motion")
        if not 0.0 < self.timestep <= 1e-3:
            raise PlanError(f"SingleJointPlan.timestep = {self.timestep}: must be positive and at most 1e-3 s")
        for name, count, levels in self._counts():
            if count < 1 or not levels:
                raise PlanError(
                    f"SingleJointPlan.{name}: {count} takes at levels {levels}: needs at least one of each"
                )

    def _counts(self) -> list[tuple[str, int, tuple[float, ...]]]:
        counts = []
        if self.hammer is not None:
            counts.append(("hammer", self.hammer.hits, self.hammer.levels))
        if self.sweep is not None:
            counts.append(("sweep", self.sweep.repeats, self.sweep.levels))
        if self.motion is not None:
            counts.append(("motion", self.motion.repeats, self.motion.travels))
        return counts
