r"""Your own MJCF beside a campaign: which joint is which (``map.toml``), and whether their numbers can belong together.

.. code-block:: toml

    format = "jointscope-map/1"
    model  = "robot.xml"              # MJCF, beside this file

    [[joint]]
    campaign    = "elbow_joint"       # the joint's name in the campaign; "" for a single-joint rig
    link        = "elbow_elastic"     # hinge behind the spring; of a rigid joint, the joint itself
    rotor       = "elbow_joint"       # hinge before the spring; absent for a rigid joint
    actuator    = "elbow_motor"       # absent where nothing drives it
    torque      = "motor"             # the actuator's control is N m on the motor shaft; "output": at the joint output
    sensor_site = "imu"               # absent where there is none
    rotor_ratio = 1.0                 # turns of the rotor's coordinate per output turn; n where it spins at motor speed
    control     = "torque"            # what the actuator is told: torque, or the commanded velocity or position
    sign        = 1                   # model angle = sign * campaign angle + zero_offset; torques turn likewise
    zero_offset = 0.0                 # rad

    [hold]                            # every further joint of the model that the bench held still, and where [rad or m]
    wrist_joint = 0.0
"""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Literal

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.atomic import write_text
from jointscope.errors import InputError, RefusedError
from jointscope.models.arm.build import ElasticArm
from jointscope.models.arm.reference import Reference, arm_reference
from jointscope.models.parameters import STANDARD_GRAVITY
from jointscope.recordings.campaign import Campaign, Nameplate, Run

Real = NDArray[np.float64]

FORMAT = "jointscope-map/1"
_CLOSE = 0.03  # relative: nearer to one than this is agreement, nearer to a factor than this names it
_ROUGH = 0.35  # relative: within this of one no mistake of unit or side is suspected


@dataclass(frozen=True, kw_only=True)
class JointMap:
    """One joint of the campaign and what stands for it in the model; fields as in the module's docstring."""

    campaign: str
    link: str
    rotor: str | None = None
    actuator: str | None = None
    torque: Literal["motor", "output"] = "output"
    sensor_site: str | None = None
    rotor_ratio: float = 1.0
    control: Literal["torque", "velocity", "position"] = "torque"
    sign: int = 1
    zero_offset: float = 0.0

    def model_angle(self, angle: float) -> float:
        """The model's angle [rad] for the campaign's."""
        return self.sign * angle + self.zero_offset


@dataclass(frozen=True, kw_only=True)
class ModelMap:
    """A model and its joints.

    Attributes:
        model: The file.
        joints: In the campaign's order.
        hold: Angle at which each further joint was held, by name [rad or m].
        file: The map it was read from, for messages; ``None`` where it was guessed.
    """

    model: Path
    joints: tuple[JointMap, ...]
    hold: Mapping[str, float] = field(default_factory=dict)
    file: Path | None = None


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """One figure of one joint.

    Attributes:
        joint: The campaign's name.
        figure: What is compared.
        unit: Of all three.
        mujoco, pinocchio: The model's value by either engine; ``None`` where only one can say.
        nameplate: The campaign's, ``None`` where it is silent.
        verdict: Empty where they agree or nothing can be said; else the likely mistake in words.
    """

    joint: str
    figure: str
    unit: str
    mujoco: float
    pinocchio: float | None
    nameplate: float | None
    verdict: str


def read_map(path: Path) -> ModelMap:
    """Read a ``map.toml``.

    Raises:
        InputError: The file is absent or breaks the format; the message names the key.
    """
    path = Path(path)
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            path, None, "no such file", fix="write one with: jointscope model map robot.xml CAMPAIGN"
        ) from None
    except tomllib.TOMLDecodeError as problem:
        raise InputError(path, None, f"not TOML: {problem}") from None
    if content.get("format") != FORMAT:
        raise InputError(path, "format", f"must be {FORMAT!r}", value=content.get("format"))
    known = {entry.name for entry in fields(JointMap)}
    for index, row in enumerate(content.get("joint", [])):
        for key in row:
            if key not in known:
                raise InputError(path, f"joint[{index}].{key}", "unknown key", value=row[key])
        for key in ("campaign", "link"):
            if key not in row:
                raise InputError(path, f"joint[{index}].{key}", "is missing")
        if row.get("sign", 1) not in (1, -1):
            raise InputError(path, f"joint[{index}].sign", "must be 1 or -1", value=row["sign"])
        if row.get("torque", "output") not in ("motor", "output"):
            raise InputError(path, f"joint[{index}].torque", "must be motor or output", value=row["torque"])
        if row.get("control", "torque") not in ("torque", "velocity", "position"):
            raise InputError(
                path, f"joint[{index}].control", "must be torque, velocity or position", value=row["control"]
            )
        for key in ("rotor_ratio", "zero_offset"):
            if not isinstance(row.get(key, 1.0), (int, float)) or (
                key == "rotor_ratio" and row.get(key, 1.0) == 0
            ):
                raise InputError(path, f"joint[{index}].{key}", "must be a number other than 0", value=row[key])
    for name, angle in content.get("hold", {}).items():
        if not isinstance(angle, (int, float)):
            raise InputError(path, f"hold.{name}", "must be an angle in rad", value=angle)
    if "model" not in content or not content.get("joint"):
        raise InputError(path, "model" if "model" not in content else "joint", "is missing")
    return ModelMap(
        model=(path.parent / content["model"]).resolve(), joints=tuple(JointMap(**row) for row in content["joint"]),
        hold={name: float(angle) for name, angle in content.get("hold", {}).items()}, file=path,
    )  # fmt: skip


def write_map(path: Path, found: ModelMap, comparisons: Sequence[Comparison]) -> None:
    """Write ``found`` to ``path`` with what each line means and what the comparison found."""
    path = Path(path)
    import os

    model = os.path.relpath(found.model.resolve(), path.resolve().parent)
    lines = [f"format = {json.dumps(FORMAT)}", f"model  = {json.dumps(model)}  # MJCF, beside this file"]
    notes = {
        "campaign": "the joint's name in the campaign", "link": "hinge behind the spring (a rigid joint: itself)",
        "rotor": "hinge before the spring", "actuator": "what drives it",
        "torque": "its control is N m on the motor shaft (motor) or at the joint output (output)",
        "sensor_site": "accelerometer", "rotor_ratio": "turns of the rotor's coordinate per output turn",
        "control": "what the actuator is told: torque, velocity or position",
        "sign": "model angle = sign * campaign angle + zero_offset", "zero_offset": "rad",
    }  # fmt: skip
    for joint in found.joints:
        lines += ["", "[[joint]]"]
        for name, note in notes.items():
            value = getattr(joint, name)
            if value is not None:
                lines.append(f"{name:<11} = {json.dumps(value)}  # {note}")
        for c in comparisons:
            if c.joint == joint.campaign:
                given = "silent" if c.nameplate is None else f"{c.nameplate:.6g}"
                lines.append(
                    f"# {c.figure}: model {c.mujoco:.6g}, campaign {given} {c.unit}. {c.verdict}".rstrip()
                )
    if found.hold:
        lines += ["", "[hold]  # joints that the bench held still; take out those that may move"]
        lines += [f"{json.dumps(name)} = {angle!r}  # rad or m" for name, angle in found.hold.items()]
    write_text(path, "\n".join(lines) + "\n")


def guess_map(model: Path, campaign: Campaign) -> ModelMap:
    """Match the campaign's joints to the model's hinges by structure and name.

    A spring-loaded hinge (or slide, on a rig that slides) that follows another one on the same axis is a reducer and its
    rotor, and so are two joints that a fixed tendon with stiffness ties together. Names decide where the campaign has
    several joints; else the one that an actuator drives, and order. Further joints without a spring are held.

    Raises:
        InputError: The model can't be read, or has fewer joints than the campaign.
    """
    spec, compiled = _compiled(model)
    pairs = _pairs(compiled, slides=campaign.rig.motion == "translational")
    wanted = campaign.joints or ("",)
    if len(pairs) < len(wanted):
        kind = "slides" if campaign.rig.motion == "translational" else "hinges"
        raise InputError(
            model,
            None,
            f"has {len(pairs)} named {kind}, the campaign needs {len(wanted)}",
            fix="name them in map.toml",
        )
    if not campaign.joints:  # a bench with one joint: the one that is driven, an elastic one first
        driven = {a.target for a in spec.actuators}
        pairs.sort(key=lambda pair: (not driven & {pair[0], pair[1]}, pair[0] is None))
    taken: list[int] = []
    joints = []
    for name in wanted:
        same = [k for k, pair in enumerate(pairs) if k not in taken and name and name in pair]
        k = same[0] if same else next(k for k in range(len(pairs)) if k not in taken)
        taken.append(k)
        rotor, link, turns = pairs[k]
        joints.append(_described(spec, compiled, campaign, name, rotor, link, turns))
    used = {n for joint in joints for n in (joint.rotor, joint.link)}
    hold = {} if campaign.joints else _held(compiled, used)
    return ModelMap(model=Path(model).resolve(), joints=tuple(joints), hold=hold)


def _held(model: mujoco.MjModel, used: set[str | None]) -> dict[str, float]:
    """Joints beside the one under test that nothing springs back, at the model's own zero."""
    straight = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))
    return {
        model.joint(j).name: float(model.qpos0[model.jnt_qposadr[j]]) if model.jnt_type[j] in straight else 0.0
        for j in range(model.njnt)
        if model.joint(j).name
        and model.joint(j).name not in used
        and float(np.ravel(model.jnt_stiffness[j])[0]) == 0.0
    }


def mapped_arm(found: ModelMap) -> ElasticArm:
    """The model as an elastic arm under the campaign's joint order.

    Raises:
        RefusedError: A joint is rigid in the model.
    """
    spec, _ = _compiled(found.model)
    rigid = [joint.link for joint in found.joints if joint.rotor is None]
    if rigid:
        raise RefusedError(
            f"{found.model.name}: joint {rigid[0]} is rigid; give it a reducer with: jointscope arm build TABLE --out FILE"
        )
    return ElasticArm(
        spec, found.model.read_text(encoding="utf-8"), tuple(str(j.rotor) for j in found.joints),
        tuple(j.link for j in found.joints),
    )  # fmt: skip


def compare(found: ModelMap, campaign: Campaign) -> tuple[Comparison, ...]:
    """Inertia, gravity torque, reflected armature and stiffness of each joint: both engines beside the nameplate."""
    spec, compiled = _compiled(found.model)
    arm = ElasticArm(
        spec, found.model.read_text(encoding="utf-8"), tuple(j.rotor or j.link for j in found.joints),
        tuple(j.link for j in found.joints),
    )  # fmt: skip
    reference: Reference | None = None
    if all(
        joint.rotor_ratio == 1.0 for joint in found.joints
    ):  # Pinocchio takes one tree, so no rotor beside the link
        try:
            reference = arm_reference(arm)
        except (RefusedError, InputError, ValueError, RuntimeError):
            reference = None
    rows: list[Comparison] = []
    for k, joint in enumerate(found.joints):
        own = next((r for r in campaign.runs if not joint.campaign or r.joint == joint.campaign), None)
        ours = own is not None
        run = own if own is not None else next(iter(campaign.runs), None)
        posture = model_posture(found, run) if run is not None else {}
        inertia, gravity = _by_mujoco(compiled, found.joints, posture)
        by_pin = (
            None if reference is None else (reference.locked_inertia(posture)[k], reference.gravity(posture)[k])
        )
        plate = campaign.rig if ours else Nameplate(topology=campaign.rig.topology, motion=campaign.rig.motion)
        rows += _rows(joint, compiled, plate, run, float(inertia[k]), float(gravity[k]), by_pin)
    return tuple(rows)


def model_posture(found: ModelMap, run: Run) -> dict[str, float]:
    """Angles of the run's posture under the model's rotor (or joint) names [rad]."""
    posture = {}
    for joint in found.joints:
        name = joint.rotor or joint.link
        if joint.campaign in run.posture:
            posture[name] = joint.model_angle(run.posture[joint.campaign])
        elif len(found.joints) == 1:
            posture[name] = joint.model_angle(run.arm_angle)
    return posture


def suspect(ratio: float, n: float | None) -> str:
    """What mistake a ratio model/campaign looks like; empty where it is near one, or like nothing known."""
    if not math.isfinite(ratio) or ratio == 0.0 or abs(ratio - 1.0) <= _CLOSE:
        return ""
    sign = "the sign is turned round; " if ratio < 0.0 else ""
    size = abs(ratio)
    if abs(size - 1.0) <= _CLOSE:
        return "factor -1: the sign is turned round (axis, sign, or zero_offset by half a turn)"
    factors: list[tuple[float, str]] = [
        (2.0 * math.pi, "2 pi: turns for radians"), (180.0 / math.pi, "180/pi: degrees for radians"),
        (math.sqrt(2.0), "sqrt 2: rms for peak"),
    ]  # fmt: skip
    if n is not None and n > 1.0:
        factors = [(n, f"n = {n:g}: one side of the reducer for the other"),
                   (n * n, f"n^2 = {n * n:g}: inertia on the other side of the reducer"), *factors]  # fmt: skip
    for factor, meaning in factors:
        for candidate, name in ((factor, meaning), (1.0 / factor, "1 over " + meaning)):
            if abs(size / candidate - 1.0) <= _CLOSE:
                return f"{sign}factor {name}"
    return (
        f"{sign}differs by a factor {size:.3g}, none of the usual ones" if sign or abs(size - 1.0) > _ROUGH else ""
    )


def _compiled(path: Path) -> tuple[mujoco.MjSpec, mujoco.MjModel]:
    path = Path(path)
    if not path.is_file():
        raise InputError(path, None, "no such model")
    try:
        spec = mujoco.MjSpec.from_file(str(path))
        return spec, spec.compile()
    except ValueError as problem:
        raise InputError(path, None, f"not an MJCF that MuJoCo can read: {problem}") from None


def _pairs(model: mujoco.MjModel, *, slides: bool = False) -> list[tuple[str | None, str, float]]:
    """(rotor or None, link, rotor turns per output turn) of every named joint of the kind, base to tip."""
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    kind = mujoco.mjtJoint.mjJNT_SLIDE if slides else mujoco.mjtJoint.mjJNT_HINGE
    hinges = [j for j in range(model.njnt) if model.jnt_type[j] == int(kind) and model.joint(j).name]
    rotor_of = {j: (i, turns) for i, j, turns in _tied(model, hinges)}
    for j in hinges:
        before = [
            i
            for i in hinges
            if i < j and model.jnt_bodyid[i] in (model.jnt_bodyid[j], model.body_parentid[model.jnt_bodyid[j]])
        ]
        stiff = float(np.ravel(model.jnt_stiffness[j])[0])
        for i in reversed(before):
            offset = data.xanchor[j] - data.xanchor[i]
            same_axis = abs(float(data.xaxis[i] @ data.xaxis[j])) > 1.0 - 1e-6
            on_line = slides or np.linalg.norm(np.cross(offset, data.xaxis[i])) < 1e-6
            if stiff > 0.0 and same_axis and on_line and j not in rotor_of:
                rotor_of[j] = (i, 1.0)
                break
    rotors = {i for i, _ in rotor_of.values()}
    pairs: list[tuple[str | None, str, float]] = []
    for j in hinges:
        if j in rotor_of:
            i, turns = rotor_of[j]
            pairs.append((model.joint(i).name, model.joint(j).name, turns))
        elif j not in rotors:
            pairs.append((None, model.joint(j).name, 1.0))
    return pairs


def _tied(model: mujoco.MjModel, among: Sequence[int]) -> list[tuple[int, int, float]]:
    """(rotor, link, rotor turns per link turn) of joints in separate bodies that one sprung fixed tendon ties together."""
    found = []
    for t in range(model.ntendon):
        first, count = int(model.tendon_adr[t]), int(model.tendon_num[t])
        wraps = [(int(model.wrap_objid[k]), float(model.wrap_prm[k])) for k in range(first, first + count)]
        joints_only = all(model.wrap_type[first : first + count] == int(mujoco.mjtWrap.mjWRAP_JOINT))
        if (
            count != 2
            or not joints_only
            or not model.tendon_stiffness[t] > 0.0
            or any(j not in among for j, _ in wraps)
        ):
            continue
        (rotor, fast), (link, slow) = sorted(wraps, key=lambda wrap: abs(wrap[1]))
        if model.body_parentid[model.jnt_bodyid[link]] != model.jnt_bodyid[rotor] and fast != 0.0:
            found.append((rotor, link, -slow / fast))
    return found


def _described(
    spec: mujoco.MjSpec, model: mujoco.MjModel, campaign: Campaign, name: str, rotor: str | None, link: str,
    turns: float,
) -> JointMap:  # fmt: skip
    driven = rotor or link
    actuator = next((a for a in spec.actuators if a.target == driven), None)
    n = campaign.rig.reduction_ratio or 1.0
    gear = abs(float(actuator.gear[0]) * turns) if actuator is not None else 1.0
    side: Literal["motor", "output"] = "motor" if n > 1.5 and gear > math.sqrt(n) else "output"
    below = _subtree(model, int(model.jnt_bodyid[model.joint(link).id]))
    site = next(
        (
            s.name
            for s in spec.sites
            if model.site_bodyid[model.site(s.name).id] in below and _has_sensor(spec, s.name)
        ),
        None,
    )
    found = JointMap(
        campaign=name, link=link, rotor=rotor, actuator=None if actuator is None else actuator.name, torque=side,
        sensor_site=site, rotor_ratio=turns, control=_control(model, actuator),
    )  # fmt: skip
    if name or campaign.rig.plane == "horizontal" or campaign.rig.motion == "translational":
        return found
    sign, offset = _horizontal(model, found)
    return replace(found, sign=sign, zero_offset=offset)


def _control(
    model: mujoco.MjModel, actuator: mujoco.MjsActuator | None
) -> Literal["torque", "velocity", "position"]:
    """What an actuator's control is: by its bias, -kp on the angle (a position servo) or -kv on the speed alone."""
    if actuator is None:
        return "torque"
    bias = model.actuator_biasprm[model.actuator(actuator.name).id]
    if bias[1] < 0.0:
        return "position"
    gain = float(model.actuator_gainprm[model.actuator(actuator.name).id][0])
    return "velocity" if bias[2] < 0.0 and gain == -float(bias[2]) else "torque"


def _has_sensor(spec: mujoco.MjSpec, site: str) -> bool:
    return any(s.objname == site for s in spec.sensors)


def _subtree(model: mujoco.MjModel, body: int) -> set[int]:
    inside = {body}
    for other in range(body + 1, model.nbody):
        if int(model.body_parentid[other]) in inside:
            inside.add(other)
    return inside


def _horizontal(model: mujoco.MjModel, joint: JointMap) -> tuple[int, float]:
    """Sign and zero offset with which the model's arm is horizontal at campaign angle 0 and rises with it.

    The holding torque of an arm is R cos(q_model - q_0): with sign = 1 the arm is horizontal at q_0.
    """
    hold = []
    for angle in (0.0, 0.5 * math.pi):
        _, gravity = _by_mujoco(model, (joint,), {joint.rotor or joint.link: angle})
        hold.append(float(gravity[0]))
    if math.hypot(*hold) < 1e-9:
        return 1, 0.0
    phase = math.atan2(hold[1], hold[0])
    if abs(phase) <= 0.5 * math.pi:
        return 1, round(phase, 9) + 0.0
    return -1, round(math.remainder(phase + math.pi, 2.0 * math.pi), 9) + 0.0


def _by_mujoco(
    model: mujoco.MjModel, joints: Sequence[JointMap], posture: Mapping[str, float]
) -> tuple[Real, Real]:
    """Load inertia about each joint, the others locked [kg m^2], and holding torque [N m], links at ``posture``."""
    data = mujoco.MjData(model)
    for joint in joints:
        address = model.jnt_qposadr[model.joint(joint.link).id]
        data.qpos[address] = posture.get(joint.rotor or joint.link, 0.0)
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    dofs = np.array([int(model.joint(joint.link).dofadr[0]) for joint in joints])
    return np.diag(full)[dofs] - model.dof_armature[dofs], data.qfrc_bias[dofs].copy()


def _rows(
    joint: JointMap, model: mujoco.MjModel, rig: Nameplate, run: Run | None, inertia: float, gravity: float,
    by_pin: tuple[float, float] | None,
) -> list[Comparison]:  # fmt: skip
    n = rig.reduction_ratio
    reflected = None
    if rig.motor_inertia is not None and n is not None:
        reflected = (rig.motor_inertia + (rig.reducer_inertia or 0.0)) * n * n
    moment = None
    if rig.arm_mass is not None and rig.arm_com_radius is not None and run is not None:
        moment = rig.arm_mass * STANDARD_GRAVITY * rig.arm_com_radius * math.cos(run.arm_angle) * joint.sign
        moment = moment if rig.plane == "vertical" else 0.0
    dof = int(model.joint(joint.rotor or joint.link).dofadr[0])
    armature = float(model.dof_armature[dof]) * joint.rotor_ratio**2
    mass, force, spring = ("kg", "N", "N/m") if rig.motion == "translational" else ("kg m^2", "N m", "N m/rad")
    by_pin_inertia, by_pin_gravity = (None, None) if by_pin is None else (float(by_pin[0]), float(by_pin[1]))
    rows = [
        _row(joint, "load inertia", mass, inertia, by_pin_inertia, rig.inertia_reference, n),
        _row(joint, "holding torque", force, gravity, by_pin_gravity, moment, n),
        _row(joint, "reflected armature", mass, armature, None, reflected, n),
    ]
    if joint.rotor is not None:
        stiffness = float(np.ravel(model.jnt_stiffness[model.joint(joint.link).id])[0])
        if joint.rotor_ratio == 1.0:  # else a tendon's
            rows.append(_row(joint, "stiffness", spring, stiffness, None, rig.stiffness_reference, n))
    return rows


def _row(
    joint: JointMap, figure: str, unit: str, mujoco_: float, pinocchio: float | None, nameplate: float | None,
    n: float | None,
) -> Comparison:  # fmt: skip
    verdict = ""
    if nameplate is not None and abs(nameplate) > 1e-9:
        verdict = suspect(mujoco_ / nameplate, n)
    if pinocchio is not None and abs(pinocchio - mujoco_) > 1e-5 * max(abs(mujoco_), 1e-6):
        verdict = (verdict + "; " if verdict else "") + "MuJoCo and Pinocchio read this model differently"
    return Comparison(
        joint=joint.campaign, figure=figure, unit=unit, mujoco=mujoco_, pinocchio=pinocchio, nameplate=nameplate,
        verdict=verdict,
    )  # fmt: skip
