r"""The rig while effects are written into it: the base's numbers, what they became, and the MjSpec at the end.

All at the joint output, as in a diagnosis' ``model.json``: q_s = motor angle / n, Delta = q_s - q. In MJCF the joint
``reducer`` is x = q - q_s = -Delta, so its polynomial stiffness -(a x + b x^2 + c x^3) is the transmission's torque
K Delta + k_2 Delta^2 + k_3 Delta^3 for a = K, b = -k_2, c = k_3.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import mujoco

from jointscope.errors import InputError
from jointscope.models.parameters import STANDARD_GRAVITY, Joint, Rig
from jointscope.models.rig import brake, rig_spec

STUCK = (1e-4, 1.0)  # solreffriction: a stuck contact forgets its speed within one step
EXACT = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # solimpfriction: creeps by 1e-4 of what the default lets creep
SPRING = "reducer spring"  # fixed tendons that stand in for the reducer joint's own spring
SOFT = "reducer low-torque spring"
IN_SPACE = "arm in space"  # tendon whose length is the arm's angle against the ground, where the mount moves
_FAR = 1e3  # rad or m; beyond every travel

Parameters = Mapping[str, float]
MOTOR_AT_MOST = 0.95  # share of a single inertia that a nameplate's motor may have of it


@dataclass
class Building:
    """A model under construction.

    Attributes:
        spec: Bodies, actuators and sensors; springs, masses and dry friction are written by :meth:`finish`.
        single, translational, vertical: Kind of rig.
        ratio: n [-].
        inertia: J_L [kg m^2 or kg].
        motor_share: Of a single inertia the stated motor's part over the rest [-].
        percussion: Radius of the arm's centre of percussion by the maker's mass and centre of mass [m].
        taken: Part of J_L that further modes carry [kg m^2 or kg].
        stiffness, quadratic, cubic: K, k_2, k_3.
        damping: c [N m s/rad].
        gap, centre: Total play and the middle of it [rad].
        gap_damping: Share of c that acts inside the play [-].
        gap_sheds, gap_round, gap_fade: Whether its flanks don't pull; depth over which they give way [rad]; power to which
            their damping does.
        gap_corner: Half width of the bends in place of its corners, below zero that of bends that end sooner [rad].
        gap_impact: Damping per elastic torque [s/rad].
        soft, soft_angle, soft_smooth: Stiffness missing within +-angle [N m/rad], [rad]; whether it fades without a corner.
        power: Stiffness that grows with a power of the stretch [N m/rad], where it is that [rad], the power [-].
        weight: Moment of the arm's weight and its direction, M exp(i phi), in -M cos(q + phi) [N m]; [N] where it slides.
        friction: Dry torque and its constant part against positive motion, at ``motor`` and ``load`` [N m].
        laws: What MJCF has no element for.
        native: What it has, with the elements.
    """

    spec: mujoco.MjSpec
    single: bool
    translational: bool
    vertical: bool
    ratio: float
    inertia: float
    stiffness: float
    damping: float
    weight: complex
    motor_share: float = 0.0
    percussion: float = 1.0
    taken: float = 0.0
    quadratic: float = 0.0
    cubic: float = 0.0
    gap: float = 0.0
    centre: float = 0.0
    gap_damping: float = 1.0
    gap_sheds: bool = False
    gap_round: float = 0.0
    gap_fade: float = 0.0
    gap_corner: float = 0.0
    gap_impact: float = 0.0
    soft: float = 0.0
    soft_angle: float = 0.0
    soft_smooth: bool = False
    power: tuple[float, float, float] = (0.0, 1.0, 2.0)
    friction: dict[str, tuple[float, float]] = field(default_factory=dict)
    laws: list[dict[str, Any]] = field(default_factory=list)
    native: list[dict[str, Any]] = field(default_factory=list)

    @property
    def resonance(self) -> float:
        """The arm's on the held motor [rad/s]."""
        return math.sqrt(self.stiffness / self.inertia)

    def law(self, kind: str, **numbers: Any) -> None:  # noqa: ANN401 - JSON is any
        """Add something that replay must do."""
        self.laws.append({"kind": kind, **numbers})

    def rub(self, location: str, torque: float, bias: float = 0.0) -> None:
        """Add dry friction at ``location``: at least a trace of it, so that its constraint exists."""
        location = "load" if self.single else location
        level, constant = self.friction.get(location, (0.0, 0.0))
        self.friction[location] = (level + torque, constant + bias)

    def add_joint(self, body: mujoco.MjsBody, name: str) -> mujoco.MjsJoint:
        """A further coordinate of the rig's kind, measured by a sensor of its speed."""
        kind = self.spec.joint("reducer")
        joint = body.add_joint(name=name, type=kind.type, axis=list(kind.axis))
        self.spec.add_sensor(
            name=f"{name} speed",
            type=mujoco.mjtSensor.mjSENS_JOINTVEL,
            objtype=mujoco.mjtObj.mjOBJ_JOINT,
            objname=name,
        )
        return joint

    def spring_numbers(self) -> dict[str, float]:
        """The transmission's torque law as the native elements have it, for laws that act on that torque."""
        return {
            "stiffness": self.stiffness,
            "damping": self.damping,
            "quadratic": self.quadratic,
            "cubic": self.cubic,
            "gap": self.gap,
            "centre": self.centre,
            "gap_damping": self.gap_damping,
            "gap_sheds": float(self.gap_sheds),
            "gap_round": self.gap_round,
            "gap_fade": self.gap_fade,
            "gap_corner": self.gap_corner,
            "gap_impact": self.gap_impact,
            "soft_stiffness": self.soft,
            "soft_angle": self.soft_angle,
            "soft_smooth": float(self.soft_smooth),
            "power_stiffness": self.power[0],
            "power_angle": self.power[1],
            "power_exponent": self.power[2],
        }

    def finish(self) -> mujoco.MjSpec:
        """Write what was collected; a single inertia loses its motor."""
        if self.spec.joint("base") is not None:
            ground = self.spec.add_tendon(name=IN_SPACE)
            for joint in ("base", "motor", "reducer"):
                ground.wrap_joint(joint, 1.0)
            if self.single:
                self.spec.actuator("motor").target = IN_SPACE
        self._write_spring()
        self._write_arm()
        for location, (torque, bias) in self.friction.items():
            self._write_friction(location, torque, bias)
        if self.gap > 0.0 and self.gap_damping < 1.0:
            self.law("gap-damping")
        if self.soft_smooth:
            self.law("soft-middle")
        if self.power[0] != 0.0:
            self.law("power-spring")
        if not self.single:
            return self.spec
        fixed = brake(self.spec, 0.0)
        fixed.comment = "joint 'reducer' is the load's own coordinate"
        return fixed

    def _write_spring(self) -> None:
        reducer, half = self.spec.joint("reducer"), 0.5 * self.gap
        cornered = 0.0 if self.soft_smooth else self.soft
        polynomial = (self.stiffness - cornered, -self.quadratic, self.cubic)
        if self.gap == 0.0:
            reducer.stiffness[:] = polynomial
        else:
            reducer.stiffness[:] = (0.0, 0.0, 0.0)
            spring = self.spec.add_tendon(name=SPRING)
            spring.wrap_joint("reducer", 1.0)
            spring.stiffness[:] = polynomial
            spring.springlength = [-self.centre - half, -self.centre + half]
        if cornered != 0.0:
            reach = half + self.soft_angle
            soft = self.spec.add_tendon(name=SOFT)
            soft.wrap_joint("reducer", 1.0)
            soft.stiffness[0] = self.soft
            soft.springlength = [-self.centre - reach, -self.centre + reach]

    def _write_arm(self) -> None:
        arm, own = self.spec.body("arm"), self.inertia - self.taken
        if self.translational:
            arm.mass, arm.ipos, arm.inertia = own, [0.0, 0.0, 0.0], [own, own, own]
            if self.weight.real != 0.0:
                moving = self.spec.tendon(IN_SPACE) is not None
                constant_force(self.spec, "weight", IN_SPACE if moving else "arm", -self.weight.real)
            return
        moment, phase = abs(self.weight), math.atan2(self.weight.imag, self.weight.real)
        if not self.vertical and moment > 0.0:  # gravity points out of the plane, but something pulls
            self.law("weight", moment=moment, phase=phase)
            moment = 0.0
        static = moment / STANDARD_GRAVITY  # m r [kg m]
        radius = min(0.5, 0.5 * own / static) if static > 0.0 else 0.0
        arm.mass = static / radius if radius > 0.0 else 1.0
        arm.ipos = [radius * math.cos(phase), 0.0, radius * math.sin(phase)]
        about = own - arm.mass * radius**2
        arm.inertia = [0.1 * about, about, about]

    def _write_friction(self, location: str, torque: float, bias: float) -> None:
        element = self.spec.joint("motor") if location == "motor" else self.spec.tendon("arm")
        element.frictionloss = max(torque, 1e-9)
        element.solref_friction, element.solimp_friction = list(STUCK), list(EXACT)
        if bias != 0.0:
            constant_force(
                self.spec, f"friction asymmetry {location}", "motor" if location == "motor" else "arm", -bias
            )

    def add_stop(self, side: float, angle: float, stiffness: float) -> None:
        """A one-sided spring on q beyond ``angle`` in the direction ``side``."""
        name = "end-stop" + (" upper" if side > 0.0 else " lower")
        stop = self.spec.add_tendon(name=name)
        stop.wrap_joint("motor", 1.0)
        stop.wrap_joint("reducer", 1.0)
        stop.stiffness[0] = stiffness
        stop.springlength = [-_FAR, angle] if side > 0.0 else [angle, _FAR]


def constant_force(spec: mujoco.MjSpec, name: str, target: str, value: float) -> None:
    """An actuator without control that pulls with ``value`` [N m or N] on joint ``motor`` or the tendon ``target``."""
    at_motor = target == "motor"
    actuator = spec.add_actuator(
        name=name,
        trntype=mujoco.mjtTrn.mjTRN_JOINT if at_motor else mujoco.mjtTrn.mjTRN_TENDON,
        target=target,
    )
    actuator.gainprm[0] = 0.0
    actuator.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    actuator.biasprm[0] = value


def begin(model: Mapping[str, Any], base: Mapping[str, float]) -> Building:
    """The base rig.

    Args:
        model: Content of a diagnosis' ``model.json``; its ``rig`` is read.
        base: Base parameters at the joint output, by name.

    Raises:
        InputError: The rig is an arm of several joints, or a base parameter is missing.
    """
    plate = model["rig"]
    if plate["topology"] == "arm":
        raise InputError("model.json", "rig.topology", "must be a single joint", value="arm")
    single, translational = plate["topology"] == "single-dof", plate["motion"] == "translational"
    n = float(plate.get("reduction_ratio") or 1.0)
    try:
        joint = Joint(
            stiffness=max(base["stiffness"], 1e-9),
            damping=base["damping"],
            load_inertia=base["load_inertia"],
            motor_inertia=1.0 if single else base["motor_inertia"] / n**2,
            reducer_inertia=0.0,
            reduction_ratio=n,
            motor_damping=0.0 if single else base["motor_damping"],
            load_damping=base["load_damping"],
            efficiency=abs(base["efficiency"] * base["torque_scale"]) or 1.0,
        )
    except KeyError as problem:
        raise InputError(
            "model.json", f"base.{problem.args[0]}", "is missing; diagnose the campaign again"
        ) from None
    vertical = plate.get("plane", "vertical") == "vertical" and not translational
    rig = Rig(
        joint=joint,
        arm_mass=1e-6,
        arm_com_radius=0.0,
        hammer_radius=1.0,
        accelerometer_radius=1.0,
        gravity=STANDARD_GRAVITY if vertical else 0.0,
    )
    spec = rig_spec(rig)
    spec.modelname = "single-inertia rig" if single else "two-inertia rig"
    spec.actuator("motor").gear[0] = n * base["efficiency"] * base["torque_scale"]
    building = Building(
        spec=spec,
        single=single,
        translational=translational,
        vertical=vertical,
        ratio=n,
        inertia=joint.load_inertia,
        motor_share=_motor_share(plate, n, joint.load_inertia) if single else 0.0,
        stiffness=joint.stiffness if base["stiffness"] > 0.0 else 0.0,
        damping=joint.damping,
        weight=complex(base["gravity_moment"]),
    )
    if plate.get("arm_mass") and plate.get("arm_com_radius"):
        building.percussion = joint.load_inertia / (plate["arm_mass"] * plate["arm_com_radius"])
    if translational:
        for name in ("motor", "reducer"):
            spec.joint(name).type, spec.joint(name).axis = mujoco.mjtJoint.mjJNT_SLIDE, [1.0, 0.0, 0.0]
    if single:  # the motor is rigid with the load
        spec.actuator("motor").trntype = mujoco.mjtTrn.mjTRN_TENDON
        spec.actuator("motor").target = "arm"
    return building


def _motor_share(plate: Mapping[str, Any], n: float, total: float) -> float:
    """What the nameplate has of the motor and its reducer, at the output, over the rest of the ``total`` inertia [-]."""
    stated = ((plate.get("motor_inertia") or 0.0) + (plate.get("reducer_inertia") or 0.0)) * n * n
    return stated / (total - stated) if stated < MOTOR_AT_MOST * total else 0.0
