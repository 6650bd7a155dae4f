r"""A link's mass properties changed in the file: the inertia about the joint's axis, and the moment of its weight.

A change d of the inertia about axis a is spread as d (1 - u u'), u the arm's direction: what mass along the arm would
give, so that the tensor stays one of a body. Where the principal axes don't allow it, it is spread as d 1.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.errors import RefusedError
from jointscope.experiments.own_model.content import Content
from jointscope.experiments.own_model.wanted import Wanted
from jointscope.experiments.own_model.xml_document import Draft, Tag

Real = NDArray[np.float64]

_TURNED = ("quat", "axisangle", "euler", "xyaxes", "zaxis")
_SAME = 1e-9


@dataclass(frozen=True, eq=False)
class MassProperties:
    """A body's, in its own frame.

    Attributes:
        mass: [kg].
        centre: Of mass [m], shape (3,).
        inertia: About the centre of mass [kg m^2], shape (3, 3).
        principal: Rotation from the principal axes, shape (3, 3).
    """

    mass: float
    centre: Real
    inertia: Real
    principal: Real


def mass_properties(model: mujoco.MjModel, joint: str) -> MassProperties:
    """Of the body that a joint moves."""
    body = int(model.jnt_bodyid[model.joint(joint).id])
    turn = np.zeros(9)
    mujoco.mju_quat2Mat(turn, model.body_iquat[body])
    axes = turn.reshape(3, 3)
    inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T
    return MassProperties(float(model.body_mass[body]), model.body_ipos[body].copy(), inertia, axes)


def heavier_by(content: Content, wanted: Wanted) -> float:
    """What the moment of the link's weight lacks [N m]; 0 where weight does not act on the joint."""
    model = content.system.model
    turns = model.jnt_type[model.joint(content.joint.link).id] == int(mujoco.mjtJoint.mjJNT_HINGE)
    return abs(wanted.weight) - abs(content.weight) if wanted.vertical and turns else 0.0


def put_mass(draft: Draft, content: Content, change: float, moment: float = 0.0) -> None:
    """Change the load's inertia about the joint, and the moment of its weight.

    Args:
        draft: Of the model's text.
        content: The model.
        change: Added to the inertia [kg m^2], or to the mass of a link that slides [kg].
        moment: Added to the weight's moment [N m], along the arm: the centre of mass moves, the mass stays.

    Raises:
        RefusedError: No body has such properties.
    """
    model, link = content.system.model, content.joint.link
    now = mass_properties(model, link)
    if model.jnt_type[model.joint(link).id] == int(mujoco.mjtJoint.mjJNT_SLIDE):
        _write_mass(draft, content, now, now.mass + change)
        return
    along = _arm(content, now)
    anchor = model.jnt_pos[model.joint(link).id]
    radius = float(along @ (now.centre - anchor))
    gravity = float(np.linalg.norm(model.opt.gravity))
    static = now.mass * radius + (moment / gravity if moment else 0.0)
    mass, reach = now.mass, static / now.mass
    own = change - mass * (reach**2 - radius**2)
    values = _spread(now, along, own)
    if not _possible(values) and static > 0.0:  # as much weight needs a shorter arm, so a heavier one
        axis = np.asarray(model.jnt_axis[model.joint(link).id], dtype=float)
        about = float(axis @ now.inertia @ axis) + now.mass * radius**2 + change
        reach = 0.9 * about / static
        mass = static / reach
        slender = 0.1 * about * (np.eye(3) - 0.9 * np.outer(along, along))
        values = np.diag(now.principal.T @ slender @ now.principal)
    if not _possible(values):
        raise RefusedError(
            f"link {link}: no body of {now.mass:.4g} kg has the inertia that the recording asks for"
        )
    _write(draft, content, now, mass, now.centre + (reach - radius) * along, values)


def _spread(now: MassProperties, along: Real, change: float) -> Real:
    """Principal moments with ``change`` more about every axis across the arm, or about all where these are turned."""
    planar = now.principal.T @ (now.inertia + change * (np.eye(3) - np.outer(along, along))) @ now.principal
    if np.abs(planar - np.diag(np.diag(planar))).max() > _SAME * np.abs(planar).max():
        planar = now.principal.T @ (now.inertia + change * np.eye(3)) @ now.principal
    return np.asarray(np.diag(planar))


def _possible(values: Real) -> bool:
    """Whether a body can have these principal moments."""
    return bool(np.all(values > 0.0) and 2.0 * values.max() <= values.sum() * (1.0 + 1e-9))


def _arm(content: Content, now: MassProperties) -> Real:
    """Direction of the arm in the body's frame: from the axis to the centre of mass, a unit vector."""
    model = content.system.model
    joint = model.joint(content.joint.link).id
    axis = np.asarray(model.jnt_axis[joint], dtype=float)
    across = now.centre - model.jnt_pos[joint]
    across = across - axis * float(axis @ across)
    if np.linalg.norm(across) < 1e-9:
        across = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    return np.asarray(across / np.linalg.norm(across), dtype=np.float64)


def _inertial(draft: Draft, content: Content) -> tuple[Tag, Tag | None]:
    """The link's body and its ``<inertial>``."""
    sources = draft.sources
    if sources.urdf:
        child = next(
            t for t in sources.select("child") if t.parent is sources.element("joint", content.joint.link)
        )
        body = sources.element("link", child.attributes["link"][0])
    else:
        above = sources.element("joint", content.joint.link).parent
        assert above is not None
        body = above
    return body, next((t for t in sources.tags if t.kind == "inertial" and t.parent is body), None)


def _write(draft: Draft, content: Content, now: MassProperties, mass: float, centre: Real, values: Real) -> None:
    body, inertial = _inertial(draft, content)
    if draft.sources.urdf:
        _write_urdf(draft, inertial, now, mass, centre, values)
    elif inertial is None:
        _insert(draft, body, now, mass, centre, values)
    else:
        if mass != now.mass:
            draft.put(inertial, "mass", _numbers([mass]))
        if not np.allclose(centre, now.centre, rtol=0.0, atol=1e-12):
            draft.put(inertial, "pos", _numbers(centre))
        if np.allclose(values, content.system.model.body_inertia[_body(content)], rtol=1e-12):
            return
        if draft.get(inertial, "fullinertia") is not None:
            full = now.principal @ np.diag(values) @ now.principal.T
            draft.put(
                inertial,
                "fullinertia",
                _numbers([full[0, 0], full[1, 1], full[2, 2], full[0, 1], full[0, 2], full[1, 2]]),
            )
        else:
            own = _in_written_frame(inertial, now, values)
            draft.put(inertial, "diaginertia", _numbers(own))


def _in_written_frame(inertial: Tag, now: MassProperties, values: Real) -> Real:
    """The diagonal as the file's own axes have it; the compiler sorts the principal ones."""
    written = [float(v) for v in inertial.attributes["diaginertia"][0].split()]
    if len(written) == 1:
        written = written * 3
    before = np.diag(now.principal.T @ now.inertia @ now.principal)
    if any(key in inertial.attributes for key in _TURNED):
        order = np.argsort(np.argsort(written))
        return np.sort(values)[order] if np.allclose(np.sort(before), np.sort(written), rtol=1e-6) else values
    return np.asarray(np.diag(now.principal @ np.diag(values) @ now.principal.T))


def _write_urdf(
    draft: Draft, inertial: Tag | None, now: MassProperties, mass: float, centre: Real, values: Real
) -> None:
    if inertial is None:
        raise RefusedError("the link has no <inertial> in the URDF")
    inside = {t.kind: t for t in draft.sources.tags if t.parent is inertial}
    full = now.principal @ np.diag(values) @ now.principal.T
    if mass != now.mass:
        draft.put(inside["mass"], "value", _numbers([mass]))
    origin = inside.get("origin")
    if origin is not None and any(float(v) != 0.0 for v in (draft.get(origin, "rpy") or "0").split()):
        raise RefusedError("the link's inertial frame is turned (rpy) in the URDF; its numbers are not rewritten")
    if origin is not None and not np.allclose(centre, now.centre, rtol=0.0, atol=1e-12):
        draft.put(origin, "xyz", _numbers(centre))
    for key, (i, j) in {
        "ixx": (0, 0),
        "iyy": (1, 1),
        "izz": (2, 2),
        "ixy": (0, 1),
        "ixz": (0, 2),
        "iyz": (1, 2),
    }.items():
        if abs(full[i, j]) > _SAME * np.abs(full).max() or draft.get(inside["inertia"], key) is not None:
            value = 0.0 if abs(full[i, j]) <= _SAME * np.abs(full).max() else full[i, j]
            if abs(value - float(draft.get(inside["inertia"], key) or 0.0)) > _SAME * np.abs(full).max():
                draft.put(inside["inertia"], key, _numbers([value]))


def _write_mass(draft: Draft, content: Content, now: MassProperties, mass: float) -> None:
    if mass <= 0.0:
        raise RefusedError(f"link {content.joint.link}: its mass would be {mass:.4g} kg")
    body, inertial = _inertial(draft, content)
    if draft.sources.urdf:
        tag = next(t for t in draft.sources.tags if t.kind == "mass" and t.parent is inertial)
        draft.put(tag, "value", _numbers([mass]))
    elif inertial is not None:
        draft.put(inertial, "mass", _numbers([mass]))
    else:
        values = np.diag(now.principal.T @ now.inertia @ now.principal)
        _insert(draft, body, now, mass, now.centre, values * mass / now.mass)


def _insert(draft: Draft, body: Tag, now: MassProperties, mass: float, centre: Real, values: Real) -> None:
    quat = np.zeros(4)
    mujoco.mju_mat2Quat(quat, now.principal.ravel())
    text = (
        f'<inertial pos="{_numbers(centre)}" quat="{_numbers(quat)}" mass="{_numbers([mass])}" '
        f'diaginertia="{_numbers(values)}"/>'
    )
    draft.withdraw(body, "<inertial")
    draft.add(body, text, element=f"body {body.name}".strip())


def _body(content: Content) -> int:
    model = content.system.model
    return int(model.jnt_bodyid[model.joint(content.joint.link).id])


def _numbers(values: object) -> str:
    return " ".join(f"{float(v) + 0.0:.9g}" for v in np.atleast_1d(np.asarray(values, dtype=float)))
