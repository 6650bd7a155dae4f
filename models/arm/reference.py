r"""Pinocchio's view of an arm: inertias, gravity torque and gravity stiffness at any posture of the links.

The model is read by Pinocchio itself, from the same MJCF that MuJoCo steps or from the robot's own URDF, so the two
engines check each other. With the rotor at zero and the reducer at q, the block of the reducers is the rigid arm.
"""

from __future__ import annotations

import functools
import tempfile
import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
import pinocchio as pin
from numpy.typing import NDArray

from jointscope.errors import InputError, JointscopeError
from jointscope.models.arm.build import ElasticArm
from jointscope.models.arm.holding import Probe
from jointscope.models.arm.table import Payload
from jointscope.models.parameters import STANDARD_GRAVITY

Real = NDArray[np.float64]

MOUNT = ("mount_turn", "mount_slide")  # what the whole arm does on its mount


@dataclass(frozen=True, eq=False)
class Reference:
    """An arm as Pinocchio has it.

    Attributes:
        model: Pinocchio's model.
        joints: Link joints, base to tip.
        dofs: Their degrees of freedom in ``model``, shape (n,).
    """

    model: pin.Model
    joints: tuple[str, ...]
    dofs: NDArray[np.int_]

    def mass_matrix(self, posture: Mapping[str, float]) -> Real:
        """M(q) of the links, rotors left out [kg m^2], shape (n, n)."""
        data = self.model.createData()
        full = np.asarray(pin.crba(self.model, data, self._configuration(posture)))
        rigid = full - np.diag(np.asarray(self.model.armature))
        return rigid[np.ix_(self.dofs, self.dofs)]

    def gravity(self, posture: Mapping[str, float]) -> Real:
        """Torque that holds each link against gravity [N m], shape (n,)."""
        data = self.model.createData()
        torque = pin.computeGeneralizedGravity(self.model, data, self._configuration(posture))
        return np.asarray(torque)[self.dofs]

    def gravity_stiffness(self, posture: Mapping[str, float]) -> Real:
        """d(gravity)/dq [N m/rad], shape (n, n), symmetric; added to the reducers' stiffness (paper, Equation 14)."""
        data = self.model.createData()
        slope = pin.computeGeneralizedGravityDerivatives(self.model, data, self._configuration(posture))
        return np.asarray(slope)[np.ix_(self.dofs, self.dofs)]

    def locked_inertia(self, posture: Mapping[str, float]) -> Real:
        """Load inertia about each joint with every other joint locked [kg m^2], shape (n,): the diagonal of M."""
        return np.diag(self.mass_matrix(posture)).copy()

    def unlocked_inertia(self, posture: Mapping[str, float]) -> Real:
        """Load inertia about each joint with the joints beyond it free to move [kg m^2], shape (n,).

        What a joint feels far above the resonances of those beyond it: the Schur complement of M.
        """
        M = self.mass_matrix(posture)
        return np.array([1.0 / np.linalg.inv(M[k:, k:])[0, 0] for k in range(M.shape[0])])

    def shares(self, posture: Mapping[str, float]) -> Real:
        """What each link's own inertia gives to M(q) [kg m^2], shape (n, n, n), link first; their sum is M."""
        found = []
        for alone in self._alone:
            full = np.asarray(pin.crba(alone, alone.createData(), self._configuration(posture)))
            rigid = full - np.diag(np.asarray(self.model.armature))
            found.append(rigid[np.ix_(self.dofs, self.dofs)])
        return np.array(found)

    def weights(self, posture: Mapping[str, float]) -> Real:
        """What holds each link's own weight [N m], shape (n, n), link first; their sum is :meth:`gravity`."""
        q = self._configuration(posture)
        found = [pin.computeGeneralizedGravity(alone, alone.createData(), q) for alone in self._alone]
        return np.array([np.asarray(torque)[self.dofs] for torque in found])

    @functools.cached_property
    def _alone(self) -> tuple[pin.Model, ...]:
        """The arm with the inertia of one link only, link by link."""
        found = []
        for dof in self.dofs:
            alone = self.model.copy()
            for k in range(1, alone.njoints):
                joint = alone.joints[k]
                if not joint.idx_v <= dof < joint.idx_v + joint.nv:
                    alone.inertias[k] = pin.Inertia.Zero()
            found.append(alone)
        return tuple(found)

    def rows(self, posture: Mapping[str, float], probe: Probe) -> tuple[Real, Real]:
        """How a point moves along its axis with the links.

        Returns:
            Motion along the axis per link angle [m/rad], and what an accelerometer there reads of gravity per link
            angle, because it tilts [m/s^2 per rad]; shape (n,) each.
        """
        data = self.model.createData()
        q = self._configuration(posture)
        if probe.body == "world":
            return np.zeros(self.dofs.size), np.zeros(self.dofs.size)
        if not self.model.existFrame(probe.body):
            raise JointscopeError(f"{probe.name}: Pinocchio's model has no body {probe.body!r}")
        frame = self.model.getFrameId(probe.body)
        pin.computeJointJacobians(self.model, data, q)
        pin.updateFramePlacements(self.model, data)
        jacobian = np.asarray(pin.getFrameJacobian(self.model, data, frame, pin.LOCAL_WORLD_ALIGNED))[:, self.dofs]
        rotation = np.asarray(data.oMf[frame].rotation)
        axis, arm = rotation @ probe.direction, rotation @ np.asarray(probe.point)
        motion = axis @ jacobian[:3] + np.cross(arm, axis) @ jacobian[3:]
        tilt = -np.cross(axis, np.asarray(self.model.gravity.linear)) @ jacobian[3:]
        return motion, tilt

    def _configuration(self, posture: Mapping[str, float]) -> Real:
        angles = np.zeros(self.model.nv)
        angles[self.dofs] = [float(posture.get(name, 0.0)) for name in self.joints]
        return np.asarray(pin.integrate(self.model, pin.neutral(self.model), angles))

    def axes(self, posture: Mapping[str, float]) -> Real:
        """Axes of the link joints in the world's directions, shape (n, 3); zero of a joint that slides."""
        data = self.model.createData()
        pin.computeJointJacobians(self.model, data, self._configuration(posture))
        return np.asarray(data.J)[3:, self.dofs].T.copy()


def arm_reference(arm: ElasticArm) -> Reference:
    """Pinocchio's reading of the elastic arm's own MJCF."""
    compiled = arm.spec.compile()
    model = _read(_bare(arm.xml), compiled, 0)
    dofs = np.array([int(compiled.joint(name).dofadr[0]) for name in arm.reducers])
    return Reference(model, arm.rotors, dofs)


def mounted_reference(arm: ElasticArm, turn: Real, slide: Real) -> Reference:
    """The same on a mount that turns about ``turn`` through the origin and slides along ``slide``, its last two joints."""
    compiled = arm.spec.compile()
    model = _read(_on_mount(_bare(arm.xml), turn, slide), compiled, len(MOUNT))
    dofs = [int(compiled.joint(name).dofadr[0]) + len(MOUNT) for name in arm.reducers]
    return Reference(model, (*arm.rotors, *MOUNT), np.array([*dofs, 1, 0]))


def _on_mount(mjcf: str, turn: Real, slide: Real) -> str:
    root = ElementTree.fromstring(mjcf)
    world = root.find("worldbody")
    if world is None:
        raise JointscopeError("the arm's model has no worldbody")
    bodies = world.findall("body")
    inside = world
    for name, kind, axis in ((MOUNT[1], "slide", slide), (MOUNT[0], "hinge", turn)):
        inside = ElementTree.SubElement(inside, "body", name=f"{name}_body")
        ElementTree.SubElement(inside, "inertial", pos="0 0 0", mass="1e-9", diaginertia="1e-9 1e-9 1e-9")
        line = " ".join(repr(float(x)) for x in axis)
        ElementTree.SubElement(inside, "joint", name=name, type=kind, axis=line, armature="0")
    for body in bodies:
        world.remove(body)
        inside.append(body)
    return ElementTree.tostring(root, encoding="unicode")


def _read(mjcf: str, compiled: mujoco.MjModel, more: int) -> pin.Model:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "arm.xml"
        path.write_text(mjcf, encoding="utf-8")
        model = pin.buildModelFromMJCF(str(path))
    model.gravity.linear = np.array(compiled.opt.gravity)
    if model.nv != compiled.nv + more:
        raise JointscopeError(
            f"Pinocchio sees {model.nv - more} degrees of freedom where MuJoCo sees {compiled.nv}; "
            "give the model one root body and hinges only"
        )
    return model


def _bare(mjcf: str) -> str:
    """An MJCF reduced to what Pinocchio reads of it: bodies, inertials and joints, ``<frame>`` nodes resolved."""
    root = ElementTree.fromstring(mjcf)
    for section in [node for node in root if node.tag not in ("compiler", "option", "default", "worldbody")]:
        root.remove(section)
    for parent in list(root.iter()):
        while (frame := parent.find("frame")) is not None:
            place = _pose(frame)
            at = list(parent).index(frame)
            parent.remove(frame)
            for offset, child in enumerate(list(frame)):
                if child.tag in ("body", "frame"):
                    moved = place * _pose(child)
                    child.set("pos", " ".join(repr(float(x)) for x in moved.translation))
                    xyzw = pin.Quaternion(moved.rotation).coeffs()
                    child.set("quat", " ".join(repr(float(x)) for x in (xyzw[3], *xyzw[:3])))
                    parent.insert(at + offset, child)
        for node in [n for n in parent if n.tag in ("geom", "site", "camera", "light")]:
            parent.remove(node)
    return ElementTree.tostring(root, encoding="unicode")


def _pose(node: ElementTree.Element) -> pin.SE3:
    position = np.array([float(x) for x in node.get("pos", "0 0 0").split()])
    w, x, y, z = (float(v) for v in node.get("quat", "1 0 0 0").split())
    return pin.SE3(pin.Quaternion(w, x, y, z).normalized(), position)


def robot_reference(path: Path, lock: tuple[str, ...] = ()) -> Reference:
    """Pinocchio's reading of a rigid robot's URDF or MJCF, its own joints as links.

    Raises:
        InputError: Pinocchio can't read the file.
    """
    build = pin.buildModelFromUrdf if path.suffix.lower() == ".urdf" else pin.buildModelFromMJCF
    try:
        model = build(str(path))
    except (ValueError, RuntimeError) as problem:
        raise InputError(path, None, f"not a robot that Pinocchio can read: {problem}") from None
    if lock:
        ids = [model.getJointId(name) for name in lock]
        model = pin.buildReducedModel(model, ids, pin.neutral(model))
    model.gravity.linear = np.array([0.0, 0.0, -STANDARD_GRAVITY])
    joints = tuple(model.names[1:])
    dofs = np.array([model.joints[k].idx_v for k in range(1, model.njoints)])
    return Reference(model, joints, dofs)


def loaded(reference: Reference, mass_scale: float, payload: Payload | None) -> Reference:
    """The same arm with every link's mass and inertia times ``mass_scale``, and with ``payload`` on."""
    model = reference.model.copy()
    for k in range(1, model.njoints):
        link = model.inertias[k]
        model.inertias[k] = pin.Inertia(mass_scale * link.mass, link.lever, mass_scale * link.inertia)
    if payload is not None and payload.mass > 0.0:
        if payload.body is None:
            joint, placement = model.njoints - 1, pin.SE3.Identity()
        else:
            if not model.existFrame(payload.body):
                raise JointscopeError(f"payload: Pinocchio's model has no body {payload.body!r}")
            frame = model.frames[model.getFrameId(payload.body)]
            joint, placement = frame.parentJoint, frame.placement
        ball = pin.Inertia(payload.mass, np.asarray(payload.com), payload.inertia * np.eye(3))
        model.appendBodyToJoint(joint, ball, placement)
    return Reference(model, reference.joints, reference.dofs)
