"""What inference works on for an arm: runs with their plants, and base parameters joint by joint."""

from __future__ import annotations

from dataclasses import dataclass
from typing import cast

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.arm.geometry import ArmFacts
from jointscope.diagnosis.arm.plant import Links, Plant
from jointscope.diagnosis.problem import Own, PreparedRun, Problem

Vector = NDArray[np.float64]

PER_JOINT = (
    "stiffness",
    "damping",
    "rotor_inertia",
    "motor_damping",
    "drive_stiffness",
    "drive_damping",
    "link_inertia",
    "link_mass",
    "load_damping",
)  # theta holds each of these for every joint, then COMMON
COMMON = ("torque_offset", "load_inertia", "efficiency", "torque_scale")
# the last three are fixed: by them the noise of a torque log is told from the sensors' own, as for a single joint


def parameter(name: str, joint: str) -> str:
    """Name of a joint's own parameter in theta."""
    return f"{name}:{joint}"


@dataclass(frozen=True, eq=False, kw_only=True)
class ArmRun(PreparedRun):
    """One run of an arm; the inherited drive arrays hold force [N] and n eta T_e [N m] as recorded.

    Attributes:
        plant: Its table.
        kinds: ``kernel.BRAKED``, ``HELD``, ``DRIVEN`` or ``FREE`` per joint, shape (n,).
        locked: Which joints the run says are rigid, shape (n,).
        driven: Place of the joint whose torque was logged, or -1.
        path, path_rate: Recorded angle of its rotor at the output from the start [rad], or the integral of its recorded
            speed, and its rate, at half steps.
        commanded, commanded_rate: The same from the speed command.
        tie: Inertia that the tie to the path acts on [kg m^2].
        probes: Which reading of the plant each output is, -1 for the motor's angle or speed.
        sensors: Where each accelerometer sits, as long as ``plant.motion``.
    """

    plant: Plant
    kinds: NDArray[np.int64]
    locked: NDArray[np.bool_]
    driven: int
    path: Vector
    path_rate: Vector
    commanded: Vector
    commanded_rate: Vector
    tie: float
    probes: tuple[int, ...]
    sensors: tuple[str, ...]


@dataclass(frozen=True, eq=False, kw_only=True)
class ArmProblem(Problem):
    """Everything that inference needs of an arm.

    Attributes:
        facts: As the campaign states it, K and c started from the recordings.
        stated: As the campaign states it.
        seen: Which joints these recordings move noticeably, shape (n,); the others are taken as rigid throughout.
        visibility: Relative change of what the sensors read where a joint is made rigid [-], shape (n,).
        softening: The same where a joint that is rigid in the model is given the stiffness of a typical reducer.
        rotor_speed: Peak speed of each rotor under the base [rad/s], shape (n,).
        wind_up: Peak dynamic wind-up of each reducer [rad], shape (n,).
        torque: Peak dynamic torque of each reducer [N m], shape (n,).
        locked_inertia: M_jj at the first run's posture [kg m^2], shape (n,).
        carried: Whose ``link_mass`` each link goes by, shape (n,); -1: as the file has it.
    """

    facts: ArmFacts
    stated: ArmFacts
    seen: NDArray[np.bool_]
    visibility: Vector
    rotor_speed: Vector
    wind_up: Vector
    torque: Vector
    locked_inertia: Vector
    carried: NDArray[np.int_]

    @property
    def arm_runs(self) -> tuple[ArmRun, ...]:
        """The runs as what they are."""
        return cast("tuple[ArmRun, ...]", self.runs)

    @property
    def own(self) -> Own:
        """Which parameters are the tested joint's own."""
        j = self.facts.tested
        stiffness, damping, inertia = (
            parameter(kind, self.facts.joints[j]) for kind in ("stiffness", "damping", "link_inertia")
        )
        return Own(stiffness, damping, inertia, float(self.locked_inertia[j]))

    def mask(self, run: ArmRun) -> NDArray[np.bool_]:
        """Joints whose reducers are springs in ``run`` under the base, shape (n,)."""
        return np.asarray(self.facts.elastic & self.seen & ~run.locked)

    def place(self, name: str, joint: int) -> int:
        """Position in theta of a joint's own parameter."""
        return PER_JOINT.index(name) * len(self.facts.joints) + joint

    def links(self, theta: Vector) -> Links:
        """In which the links' inertia is another than the file says."""
        n = len(self.carried)
        more = theta[self.place("link_inertia", 0) :][:n] - 1.0
        masses = theta[self.place("link_mass", 0) :][:n][np.maximum(self.carried, 0)]
        return Links(tuple(more * self.locked_inertia), tuple(np.where(self.carried < 0, 1.0, masses)))

    @property
    def offset_place(self) -> int:
        """Position in theta of the torque's offset."""
        return len(PER_JOINT) * len(self.facts.joints)
