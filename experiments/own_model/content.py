r"""What a model holds of the joint, in the campaign's own terms: values, and the elements that carry each of them.

With P = d(coordinates)/d(q_s, q), an element on a joint or fixed tendon of the model acts on p . (q_s, q), p its row of
P (for a tendon the sum over its joints). p parallel to (1, 0) is the motor's, (0, 1) the load's, (1, -1) the
transmission's; an attribute a there counts lambda^2 a, a dry force |lambda| a. So a nested reducer, a rotor at motor
speed behind a tendon, and a rigid joint are read alike, whatever their elements are called.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.errors import InputError
from jointscope.sim.own_model import OwnJoint, OwnSystem, geared, own_rest, own_system, turning

Real = NDArray[np.float64]

Place = Literal["motor", "load", "transmission"]
_PLACES: dict[Place, tuple[float, float]] = {"motor": (1.0, 0.0), "load": (0.0, 1.0), "transmission": (1.0, -1.0)}
_PARALLEL = 1e-6


@dataclass(frozen=True)
class Carrier:
    """A joint or tendon that acts on the joint under test.

    Attributes:
        kind: "joint" or "fixed" (its tag).
        name: Its name.
        place: Where it acts.
        lever: lambda, its coordinate per unit of the place's (q_s, q or q_s - q).
        stiffness, damping: Coefficients of its polynomials, lowest first [at the element].
        frictionloss, armature: [at the element].
        limited: Whether its travel is bounded.
        yields: Whether its spring gives way (``springyield``).
        play: Width of its spring's dead band (a two-valued ``springlength``) [at the element].
    """

    kind: Literal["joint", "fixed"]
    name: str
    place: Place
    lever: float
    stiffness: tuple[float, ...]
    damping: tuple[float, ...]
    frictionloss: float
    armature: float
    limited: bool
    yields: bool = False
    play: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class Content:
    """A model's joint.

    Attributes:
        joint: Which joint is which.
        system: As compiled, without a brake.
        carriers: Joints first.
        rigid: Whether the model has one coordinate where the rig has two.
        values: At the joint output by the names of the base parameters: stiffness, damping, load_inertia,
            motor_inertia, motor_damping, load_damping, motor_friction, load_friction, torque_gain (torque on q_s per
            N m of T_e). A rigid model's damping and friction are the motor's.
        weight: M exp(i phi) of the gravity torque -M cos(q + phi) [N m].
    """

    joint: OwnJoint
    system: OwnSystem
    carriers: tuple[Carrier, ...]
    rigid: bool
    values: dict[str, float]
    weight: complex

    def at(self, place: Place) -> tuple[Carrier, ...]:
        """Elements at a place."""
        return tuple(c for c in self.carriers if c.place == place)


def read_content(spec: mujoco.MjSpec, joint: OwnJoint, *, two: bool, angle: float, ratio: float) -> Content:
    """Read the joint out of a model.

    Args:
        spec: The model.
        joint: Which joint is which.
        two: Whether the rig has motor and load (``two-inertia``).
        angle: Arm angle at which the inertia is read [rad].
        ratio: n.

    Raises:
        InputError: The actuator acts between motor and load.
    """
    system = own_system(spec, joint)
    dofs, p = _rows(system, joint)
    carriers = tuple(_carriers(system.model, dofs, p))
    rigid = two and joint.rotor is None
    values = _values(system, carriers, dofs, p, joint, angle, rigid=rigid)
    values["torque_gain"] = _torque_gain(system, dofs, p, joint, ratio)
    return Content(joint=joint, system=system, carriers=carriers, rigid=rigid, values=values,
                   weight=_weight(system, joint))  # fmt: skip


def _rows(system: OwnSystem, joint: OwnJoint) -> tuple[list[int], Real]:
    """Degrees of freedom of (rotor, link) or of the link alone, what is geared to each, and P, a row each, shape (k, 2)."""
    model = system.model
    link = int(model.joint(joint.link).dofadr[0])
    if joint.rotor is None:
        names, dofs, p = [joint.link], [link], np.array([[0.0, 1.0 / system.arm[link]]])
    else:
        names, dofs = [joint.rotor, joint.link], [int(model.joint(joint.rotor).dofadr[0]), link]
        p = np.linalg.inv(np.array([system.motor[dofs], system.arm[dofs]]))
    for name, row in zip(names, p, strict=True):
        for other, ratio in geared(model, name).items():
            dof = int(model.joint(other).dofadr[0])
            if dof not in dofs:
                dofs, p = [*dofs, dof], np.vstack([p, ratio * row])
    return dofs, p


def _placed(row: Real) -> tuple[Place, float] | None:
    size = float(np.linalg.norm(row))
    for place, direction in _PLACES.items():
        along = np.asarray(direction) / np.linalg.norm(direction)
        if size > 0.0 and abs(abs(float(row @ along)) - size) < _PARALLEL * size:
            return place, float(row @ along) / float(np.linalg.norm(direction))
    return None


def _carriers(model: mujoco.MjModel, dofs: list[int], p: Real) -> Iterator[Carrier]:
    for dof, row in zip(dofs, p, strict=True):
        found = _placed(row)
        if found is None:
            continue
        j = int(model.dof_jntid[dof])
        yield Carrier(
            "joint", model.joint(j).name, *found, (float(model.jnt_stiffness[j]), *map(float, model.jnt_stiffnesspoly[j])),
            (float(model.dof_damping[dof]), *map(float, model.dof_dampingpoly[dof])), float(model.dof_frictionloss[dof]),
            float(model.dof_armature[dof]), bool(model.jnt_limited[j]),
        )  # fmt: skip
    for t in range(model.ntendon):
        first, count = int(model.tendon_adr[t]), int(model.tendon_num[t])
        if any(model.wrap_type[first : first + count] != int(mujoco.mjtWrap.mjWRAP_JOINT)):
            continue
        row, own = np.zeros(2), True
        for k in range(first, first + count):
            dof = int(model.jnt_dofadr[int(model.wrap_objid[k])])
            own = own and dof in dofs
            if own:
                row = row + float(model.wrap_prm[k]) * p[dofs.index(dof)]
        found = _placed(row) if own else None
        if found is None:
            continue
        yield Carrier(
            "fixed", model.tendon(t).name, *found, (float(model.tendon_stiffness[t]), *map(float, model.tendon_stiffnesspoly[t])),
            (float(model.tendon_damping[t]), *map(float, model.tendon_dampingpoly[t])), float(model.tendon_frictionloss[t]),
            float(model.tendon_armature[t]), bool(model.tendon_limited[t]), bool(model.tendon_springyield[t] > 0.0),
            float(model.tendon_lengthspring[t, 1] - model.tendon_lengthspring[t, 0]),
        )  # fmt: skip


def _values(
    system: OwnSystem, carriers: tuple[Carrier, ...], dofs: list[int], p: Real, joint: OwnJoint, angle: float, *,
    rigid: bool,
) -> dict[str, float]:  # fmt: skip
    data = mujoco.MjData(system.model)
    data.qpos[:] = own_rest(system, joint.sign, angle).x
    mujoco.mj_forward(system.model, data)
    full = np.zeros((system.model.nv, system.model.nv))
    mujoco.mj_fullM(system.model, data, full)
    mass = p.T @ full[np.ix_(dofs, dofs)] @ p

    def total(place: Place, what: str, power: int) -> float:
        found = 0.0
        for c in carriers:
            if c.place == place:
                value = getattr(c, what)
                found += abs(c.lever) ** power * (value[0] if isinstance(value, tuple) else value)
        return float(found)

    values = {
        "stiffness": total("transmission", "stiffness", 2), "damping": total("transmission", "damping", 2),
        "motor_inertia": float(mass[0, 0]), "load_inertia": float(mass[1, 1]),
        "motor_damping": total("motor", "damping", 2), "load_damping": total("load", "damping", 2),
        "motor_friction": total("motor", "frictionloss", 1), "load_friction": total("load", "frictionloss", 1),
    }  # fmt: skip
    if joint.rotor is None and not rigid:  # a single inertia on its own spring
        values["stiffness"] = total("load", "stiffness", 2)
    if rigid:
        armature = total("load", "armature", 2)
        values |= {
            "stiffness": math.inf, "motor_inertia": armature, "load_inertia": float(mass[1, 1]) - armature,
            "motor_damping": values["load_damping"], "load_damping": 0.0,
            "motor_friction": values["load_friction"], "load_friction": 0.0,
        }  # fmt: skip
    return values


def _torque_gain(system: OwnSystem, dofs: list[int], p: Real, joint: OwnJoint, ratio: float) -> float:
    """Torque on q_s per unit of the control [-], times what the control is per T_e but for the efficiency."""
    if joint.actuator is None or joint.control != "torque":
        return math.nan
    model = system.model
    data = mujoco.MjData(model)
    actuator = int(model.actuator(joint.actuator).id)
    mujoco.mj_forward(model, data)
    before = data.qfrc_actuator.copy()
    limited = model.actuator_ctrllimited[actuator]
    unit = min(1.0, float(model.actuator_ctrlrange[actuator][1])) if limited else 1.0
    if unit <= 0.0 or model.actuator_dyntype[actuator] != int(mujoco.mjtDyn.mjDYN_NONE):
        return math.nan
    data.ctrl[actuator] = unit
    mujoco.mj_forward(model, data)
    force = p.T @ (data.qfrc_actuator - before)[dofs] / unit
    if joint.rotor is not None and abs(force[1]) > 1e-6 * abs(force[0]):
        raise InputError(
            model.actuator(actuator).name,
            "actuator",
            "acts on the load too, so it is not the motor",
            fix="see map.toml",
        )
    gain = float(force[0] if joint.rotor is not None else force[1]) * turning(system)
    return gain if joint.torque == "motor" else gain * ratio


def _weight(system: OwnSystem, joint: OwnJoint) -> complex:
    """-M cos(q + phi) = -(Re cos q - Im sin q), from the bias forces at q = 0 and a quarter turn."""
    model, data = system.model, mujoco.MjData(system.model)
    link = int(model.joint(joint.link).dofadr[0])
    pull = []
    for angle in (0.0, 0.5 * math.pi):
        data.qpos[:] = 0.0
        lead = link if joint.rotor is None or system.arm[int(model.joint(joint.rotor).dofadr[0])] == 0.0 else int(
            model.joint(joint.rotor).dofadr[0])  # fmt: skip
        data.qpos[lead] = (angle + joint.sign * system.zero) / system.arm[lead]
        mujoco.mj_forward(model, data)
        pull.append(float(data.qfrc_bias[link] / system.arm[link]))
    return complex(pull[0], -pull[1])
