"""How large an inertia can be by what the nameplate says."""

from __future__ import annotations

import math
from dataclasses import dataclass

from jointscope.recordings.campaign import Nameplate


@dataclass(frozen=True)
class InertiaRange:
    """What the nameplate leaves possible [kg m^2]: least, likely and most; no upper bound where it is silent."""

    least: float
    likely: float
    most: float

    @property
    def known(self) -> bool:
        """Whether an inertia outside is a contradiction."""
        return math.isfinite(self.most)

    def __str__(self) -> str:
        return f"{self.least:.3g} to {self.most:.3g} kg m^2 is possible"


def whole_inertia(rig: Nameplate) -> InertiaRange:
    """Of motor and arm together, at the output."""
    J_M = 0.0
    if rig.motor_inertia is not None and rig.reduction_ratio is not None:
        J_M = (rig.motor_inertia + (rig.reducer_inertia or 0.0)) * rig.reduction_ratio**2
    arm = arm_inertia(rig)
    if J_M > 0.0 and arm.known:
        return InertiaRange(J_M + arm.least, J_M + arm.likely, J_M + arm.most)
    if J_M > 0.0:
        return InertiaRange(J_M, 2.0 * J_M, 30.0 * J_M)
    return InertiaRange(arm.least, 1.0, math.inf)


def arm_inertia(rig: Nameplate) -> InertiaRange:
    """Of the arm alone: with its centre of mass at r at least m r^2, hardly more than three times that."""
    if rig.inertia_reference is not None:
        return InertiaRange(0.8 * rig.inertia_reference, rig.inertia_reference, 1.25 * rig.inertia_reference)
    if rig.arm_mass is not None and rig.arm_com_radius:
        least = rig.arm_mass * rig.arm_com_radius**2
        return InertiaRange(least, 1.2 * least, 3.0 * least)
    return InertiaRange(0.0, 1.0, math.inf)
