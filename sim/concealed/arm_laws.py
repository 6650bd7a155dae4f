"""What can be concealed in an arm, in MuJoCo's own elements, and how strong.

Dry friction is MuJoCo's friction constraint on the rotor; play a tendon over the reducer whose spring has a dead band;
hardening the polynomial of the reducer's spring; a falling (Stribeck) friction a smooth law applied from outside at
every step. A hidden joint is one that gives in the truth and is rigid in the lab's model.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.models.arm.build import ElasticArm
from jointscope.models.arm.holding import HeldArm, Rest

Real = NDArray[np.float64]
BAND = "_band"
FRICTION_SOLREF = (2.0, 1.0)  # in steps: as hard as the solver is stable
FRICTION_SOLIMP = (0.9999, 0.9999, 0.001, 0.5, 2.0)


@dataclass(frozen=True, kw_only=True)
class ArmEffect:
    """One concealed effect.

    Attributes:
        effect, location, joint: Its names.
        law: Whose equation.
        values: By parameter, at the joint output.
    """

    effect: str
    location: str
    joint: str
    law: str
    values: Mapping[str, float]


def with_elements(arm: ElasticArm, effects: tuple[ArmEffect, ...]) -> ElasticArm:
    """The arm with the elements of ``effects`` in its MJCF; play and hardening are set once it is held."""
    spec = arm.spec.copy()
    for e in effects:
        if e.law == "friction-constraint":
            rotor = spec.joint(e.joint)
            rotor.frictionloss = e.values["torque"]
        if e.effect == "backlash":
            reducer = arm.reducers[arm.index(e.joint)]
            band = spec.add_tendon(name=e.joint + BAND)
            band.wrap_joint(reducer, 1.0)
    spec.compile()
    return ElasticArm(spec, spec.to_xml(), arm.rotors, arm.reducers)


def set_up(held: HeldArm, rest: Rest, effects: tuple[ArmEffect, ...]) -> None:
    """Give the held model its play and hardening, placed so that it rests where ``rest`` says."""
    model = held.model
    model.dof_solref[:] = (FRICTION_SOLREF[0] * model.opt.timestep, FRICTION_SOLREF[1])
    model.dof_solimp[:] = FRICTION_SOLIMP
    for e in effects:
        k = held.arm.index(e.joint)
        if held.reducer[k] < 0 or e.location != "transmission":
            continue
        hinge = int(model.dof_jntid[held.reducer[k]])
        at = float(rest.qpos[model.jnt_qposadr[hinge]])
        K, torque = float(model.jnt_stiffness[hinge]), float(rest.torque[k])
        if e.effect == "backlash":
            model.jnt_stiffness[hinge] = 0.0
            band = int(model.tendon(e.joint + BAND).id)
            model.tendon_stiffness[band] = K
            free = at + torque / K  # of the spring that bears at rest
            gap = e.values["gap"]
            low, high = (free, free + gap) if torque > 0.0 else (free - gap, free)
            if abs(torque) < 1e-3:
                low, high = at - 0.5 * gap, at + 0.5 * gap
            model.tendon_lengthspring[band] = (low, high)
        elif e.effect == "stiffness-nonlinearity":
            cubic = e.values["cubic"]
            model.jnt_stiffnesspoly[hinge, 1] = cubic
            roots = np.roots([cubic, 0.0, K, -torque])
            wind_up = float(roots[np.argmin(np.abs(roots - torque / K))].real)
            model.qpos_spring[model.jnt_qposadr[hinge]] = at + wind_up


@dataclass(frozen=True, eq=False)
class FallingFriction:
    """-(T_c + (T_b - T_c)/(1 + (v/v_s)^2)) v/sqrt(v^2 + v_0^2) on one rotor [N m]: a smooth law of another form."""

    dof: int
    torque: float
    breakaway: float
    speed: float
    width: float

    def __call__(self, data: mujoco.MjData) -> None:
        """Apply it at the present speed."""
        v = float(data.qvel[self.dof])
        size = self.torque + (self.breakaway - self.torque) / (1.0 + (v / self.speed) ** 2)
        data.qfrc_applied[self.dof] = -size * v / float(np.hypot(v, self.width))


def falling_friction(held: HeldArm, effects: tuple[ArmEffect, ...]) -> FallingFriction | None:
    """The law that has to be applied from outside, if any of ``effects`` does and its rotor moves."""
    for e in effects:
        dof = int(held.rotor[held.arm.index(e.joint)]) if e.law == "falling" else -1
        if dof >= 0:
            h, inertia = held.model.opt.timestep, float(held.model.dof_armature[dof])
            width = max(1e-3, 1.5 * e.values["breakaway"] * h / inertia)
            return FallingFriction(
                dof, e.values["torque"], e.values["breakaway"], e.values["stribeck_velocity"], width
            )
    return None
