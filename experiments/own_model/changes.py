"""What to change in a model's file, line by line: its numbers, what it left out, and what it holds that wasn't recorded.

Every :class:`Change` edits the text on its own, so that any subset of them is a file that can be stepped and scored.
Nothing is decided here: ``study`` keeps the changes that the recordings ask for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal

import mujoco
import numpy as np

from jointscope.errors import RefusedError
from jointscope.experiments.own_model.content import Carrier, Content, Place
from jointscope.experiments.own_model.inertia import put_mass
from jointscope.experiments.own_model.xml_document import Draft, Tag
from jointscope.models.effects.building import EXACT, STUCK
from jointscope.models.effects.transmission import SLIP_LEVELS
from jointscope.sim.own_model import OwnJoint

Share = Literal["numerics", "parameters", "left-out", "contradicted"]
Interval = tuple[float, float] | None

SHARES: tuple[Share, ...] = ("numerics", "parameters", "left-out", "contradicted")
_NEGLIGIBLE = 1e-9
_FAR = 1e3  # rad or m
_VANISHED = 0.05  # of the model's value: a fitted one below it says that the model holds what isn't there
_FRICTION = ("coulomb-friction", "stribeck-friction", "load-dependent-friction")


@dataclass(frozen=True, eq=False)
class Change:
    """One change of the file.

    Attributes:
        key: What it is about.
        share: Which part of the error it is to mend.
        reason: One sentence.
        edit: Makes it, in a draft that may hold others already.
        interval: 95 % interval of the new value, at the element; ``None`` where it is exact or no number.
        sigmas: By how many standard errors the old value is off; infinite where that says nothing.
        joint: The map's joint once the change is made, where it makes another one.
    """

    key: str
    share: Share
    reason: str
    edit: Callable[[Draft], None]
    interval: Interval = None
    sigmas: float = math.inf
    joint: OwnJoint | None = None


@dataclass(frozen=True)
class Wanted:
    """What the recordings ask for.

    Attributes:
        base: Base parameters at the joint output, by name.
        intervals: 95 % of those that were fitted.
        effects: Entries of ``model.json``, with the ``intervals`` of their parameters where known.
        merged: Parameters that stand for a sum, by the name under which they were fitted.
        single, vertical: Kind of rig.
        spring: Whether the load sits on a spring (always so with a motor side).
        ratio, efficiency: n and eta.
    """

    base: Mapping[str, float]
    intervals: Mapping[str, tuple[float, float]]
    effects: tuple[Mapping[str, Any], ...]
    merged: frozenset[str]
    single: bool
    vertical: bool
    spring: bool
    ratio: float
    efficiency: float

    def find(self, *names: str, location: str | None = None) -> Mapping[str, Any] | None:
        """The first effect of one of these names."""
        return next((e for e in self.effects if e["effect"] in names and location in (None, e["location"])), None)


def proposals(content: Content, wanted: Wanted, draft: Draft) -> tuple[list[Change], list[str]]:
    """Every change that may be needed, and what no line of the file can say.

    Args:
        content: The model.
        wanted: What the recordings say.
        draft: An empty draft; it tells which elements are written out.
    """
    notes: list[str] = []
    found: list[Change] = []
    if content.rigid:
        if draft.sources.urdf:
            notes.append("a URDF has no spring: the joint's elasticity is in augmented.xml only")
        else:
            found.append(_elasticity(content, wanted))
    found += _parameters(content, wanted, draft, notes)
    found += _frictions(content, wanted, draft, notes)
    found += _contradicted(content, wanted, draft)
    if not content.rigid and not draft.sources.urdf:
        found += _left_out(content, wanted, notes)
    elif wanted.effects:
        done = {"coulomb-friction"}
        notes += [f"{e['effect']}@{e['location']}: see augmented.xml and effects.json" for e in wanted.effects
                  if e["effect"] not in done]  # fmt: skip
    return [c for c in found if _writable(c, draft, notes)], notes


def _writable(change: Change, draft: Draft, notes: list[str]) -> bool:
    """Whether the elements are written out in the file."""
    try:
        change.edit(Draft(draft.sources))
    except RefusedError as problem:
        notes.append(f"{change.key}: {problem}")
        return False
    return True


def _number(value: float) -> str:
    return f"{value + 0.0:.7g}"


def _tag(draft: Draft, carrier: Carrier) -> Tag:
    return draft.sources.element(carrier.kind, carrier.name)


def _put(draft: Draft, carrier: Carrier, attribute: str, value: float, position: int = 0) -> None:
    """Set one coefficient of a carrier's attribute, the others as they are."""
    own = getattr(carrier, attribute)
    tag = _tag(draft, carrier)
    if draft.sources.urdf:
        tag, attribute = _urdf_dynamics(draft, tag, attribute)
    text = draft.get(tag, attribute)
    if text is None:
        held = own if isinstance(own, tuple) else (own,)
        while len(held) > 1 and held[-1] == 0.0:
            held = held[:-1]
        old = " ".join(_number(v) for v in held)
    tokens = (text if text is not None else old).split()
    tokens += ["0"] * (position + 1 - len(tokens))
    if float(tokens[position]) != value:
        tokens[position] = _number(value)
    draft.put(tag, attribute, " ".join(tokens), old=None if text is not None else old)


def _urdf_dynamics(draft: Draft, joint: Tag, attribute: str) -> tuple[Tag, str]:
    names = {"damping": "damping", "frictionloss": "friction"}
    if attribute not in names:
        raise RefusedError(f"a URDF has no {attribute}")
    found = next((t for t in draft.sources.select("dynamics") if t.parent is joint), None)
    if found is None:
        raise RefusedError(f"joint {joint.name} has no <dynamics> in the URDF")
    return found, names[attribute]


def _arm_tendon(draft: Draft, content: Content, attributes: str) -> None:
    """A fixed tendon whose coordinate is the arm's angle."""
    _tendon(draft, f"{content.joint.link}_arm", attributes, _coefficients(content, "arm"))


def _coefficients(content: Content, which: Literal["arm", "motor"]) -> list[tuple[str, float]]:
    function = content.system.arm if which == "arm" else content.system.motor
    model = content.system.model
    return [(model.joint(int(model.dof_jntid[k])).name, float(function[k])) for k in np.flatnonzero(function)]


def _tendon(draft: Draft, name: str, attributes: str, over: list[tuple[str, float]]) -> None:
    inside = "\n".join(f'  <joint joint="{joint}" coef="{_number(c)}"/>' for joint, c in over)
    _into_section(draft, "tendon", f'<fixed name="{name}" {attributes}>\n{inside}\n</fixed>', f"fixed {name}")


def _into_section(draft: Draft, kind: str, text: str, element: str) -> None:
    section = next((t for t in draft.sources.select(kind) if not t.closes_itself
                    and t.parent is draft.sources.tags[0]), None)  # fmt: skip
    if section is None:
        inside = "\n".join("  " + line for line in text.splitlines())
        draft.add(draft.sources.tags[0], f"<{kind}>\n{inside}\n</{kind}>", element=element)
    else:
        draft.add(section, text, element=element)


def _elasticity(content: Content, wanted: Wanted) -> Change:
    """A second joint on the same body and axis: the user's own becomes the motor's."""
    link = content.joint.link
    model = content.system.model
    own = model.joint(link)
    name = f"{link}_elastic"
    axis, place = " ".join(_number(v) for v in own.axis), " ".join(_number(v) for v in own.pos)
    slide = ' type="slide"' if model.jnt_type[own.id] == int(mujoco.mjtJoint.mjJNT_SLIDE) else ' type="hinge"'

    def edit(draft: Draft) -> None:
        text = (
            f'<joint name="{name}"{slide} axis="{axis}" pos="{place}" stiffness="{_number(wanted.base["stiffness"])}" '
            f'damping="{_number(wanted.base["damping"])}" armature="0" frictionloss="0" limited="false"/>'
        )
        draft.add(draft.sources.element("joint", link), text, element=f"joint {name}", after=True)

    return Change(
        "elasticity", "left-out", f"joint {link} is rigid in the model; the recording shows its reducer's spring", edit,
        wanted.intervals.get("stiffness"), joint=replace(content.joint, rotor=link, link=name),
    )  # fmt: skip


def _sigmas(old: float, new: float, interval: Interval) -> float:
    """How far off the old value is; infinite where the new one is exact."""
    if interval is None or not interval[1] > interval[0]:
        return math.inf
    return abs(old - new) * 3.92 / (interval[1] - interval[0])


def _scaled(interval: Interval, old: float, shift: float, power: float) -> Interval:
    """An interval at the joint as one of the element's attribute."""
    if interval is None:
        return None
    low, high = sorted(((interval[0] - shift) / power + old, (interval[1] - shift) / power + old))
    return low, high


def _parameters(content: Content, wanted: Wanted, draft: Draft, notes: list[str]) -> Iterator[Change]:
    """Stiffness, damping, inertia, gear and weight."""
    targets = _targets(content, wanted)
    for name, (place, attribute, new) in targets.items():
        old = content.values[name]
        interval = wanted.intervals.get(name)
        if not math.isfinite(new) or abs(new - old) <= 1e-4 * abs(old) + _NEGLIGIBLE:
            continue
        carrier = next(
            iter(sorted(content.at(place), key=lambda c: -_coefficient(c, attribute) * c.lever**2)), None
        )
        yield _value_change(content, draft, name, attribute, carrier, old, new, interval)
    inertia = _mass_change(content, wanted)
    if inertia is not None:
        yield inertia
    gear = _gear_change(content, wanted, draft, notes)
    if gear is not None:
        yield gear


def _coefficient(carrier: Carrier, attribute: str) -> float:
    value = getattr(carrier, attribute)
    return float(value[0] if isinstance(value, tuple) else value)


def _targets(content: Content, wanted: Wanted) -> dict[str, tuple[Place, str, float]]:
    """Value wanted and where it is carried, by name."""
    base = wanted.base
    if wanted.single:
        damping = base["load_damping"] + (base["damping"] if wanted.spring else 0.0)
        rows: dict[str, tuple[Place, str, float]] = {"load_damping": ("load", "damping", damping)}
        if wanted.spring:
            rows["stiffness"] = ("load", "stiffness", base["stiffness"])
        return rows
    if content.rigid:
        return {
            "motor_damping": ("load", "damping", base["motor_damping"] + base["load_damping"]),
            "motor_inertia": ("load", "armature", base["motor_inertia"]),
        }
    load = content.values["load_damping"] if "damping" in wanted.merged else base["load_damping"]
    return {
        "stiffness": ("transmission", "stiffness", base["stiffness"]),
        "damping": ("transmission", "damping", base["damping"] + base["load_damping"] - load),
        "motor_damping": ("motor", "damping", base["motor_damping"]),
        "load_damping": ("load", "damping", load),
        "motor_inertia": ("motor", "armature", base["motor_inertia"]),
    }


def _value_change(
    content: Content, draft: Draft, name: str, attribute: str, carrier: Carrier | None, old: float, new: float,
    interval: Interval,
) -> Change:  # fmt: skip
    label = name.replace("_", " ")
    vanished = attribute == "damping" and new < _VANISHED * old
    share: Share = "contradicted" if vanished else "parameters"
    reason = f"{label}: the model has {old:.5g}, the recording {new:.5g} at the joint output"
    if carrier is None:  # nothing in the model carries it: the arm's own coordinate needs a tendon

        def add(draft: Draft) -> None:
            _arm_tendon(draft, content, f'{attribute}="{_number(new)}"')

        return Change(name, share, reason, add, interval, _sigmas(old, new, interval))
    power = carrier.lever**2
    value = max(0.0, _coefficient(carrier, attribute) + (new - old) / power)

    def edit(draft: Draft) -> None:
        _put(draft, carrier, attribute, value)

    return Change(name, share, reason, edit, _scaled(interval, _coefficient(carrier, attribute), old, power),
                  _sigmas(old, new, interval))  # fmt: skip


def _mass_change(content: Content, wanted: Wanted) -> Change | None:
    """Inertia about the joint and moment of the weight, which one body carries."""
    old, new = content.values["load_inertia"], wanted.base["load_inertia"]
    gravity = wanted.find("gravity")
    moment = complex(wanted.base["gravity_moment"])
    if gravity is not None:
        p = gravity["parameters"]
        moment += p["moment"] * complex(math.cos(p.get("phase") or 0.0), math.sin(p.get("phase") or 0.0))
    heavier = 0.0
    if wanted.vertical and content.system.model.jnt_type[content.system.model.joint(content.joint.link).id] == 3:
        heavier = abs(moment) - abs(content.weight)
    if abs(new - old) <= 1e-4 * old and abs(heavier) <= 1e-3 * abs(moment):
        return None
    interval = wanted.intervals.get("load_inertia")
    reason = f"load inertia: the model has {old:.5g}, the recording {new:.5g}"
    if interval is not None:
        reason += f" (95 %: {interval[0]:.5g} to {interval[1]:.5g})"
    if abs(heavier) > 1e-3 * abs(moment):
        reason += f"; moment of the weight {abs(content.weight):.5g} and {abs(moment):.5g} N m"

    def edit(draft: Draft) -> None:
        put_mass(draft, content, new - old, heavier)

    sigmas = max(_sigmas(old, new, interval), math.inf if abs(heavier) > 0.01 * abs(moment) else 0.0)
    share: Share = (
        "left-out" if gravity is not None and abs(content.weight) < _VANISHED * abs(moment) else "parameters"
    )
    return Change("load_inertia", share, reason, edit, None, sigmas)  # the interval is not one attribute's


def _gear_change(content: Content, wanted: Wanted, draft: Draft, notes: list[str]) -> Change | None:
    """Torque on q_s per N m of the motor."""
    has = content.values["torque_gain"]
    if not math.isfinite(has) or has == 0.0 or content.joint.actuator is None:
        return None
    asked = wanted.base["efficiency"] * wanted.base["torque_scale"] * wanted.ratio
    gain = wanted.find("torque-gain")
    if gain is not None:
        asked *= gain["parameters"]["gain"]
    held = has if content.joint.torque == "motor" else has * wanted.efficiency
    if abs(asked / held - 1.0) < 1e-4:
        return None
    name, factor = content.joint.actuator, asked / held
    tag = next(
        (t for t in draft.sources.tags if t.name == name and t.parent is not None and t.parent.kind == "actuator"),
        None,
    )
    if tag is None:
        notes.append(f"actuator {name} is not written out in the file, so its gear is not changed")
        return None
    first = float(content.system.model.actuator(name).gear[0])

    def edit(draft: Draft) -> None:
        tokens = (draft.get(tag, "gear") or _number(first)).split()
        tokens[0] = _number(float(tokens[0]) * factor)
        draft.put(tag, "gear", " ".join(tokens), old=_number(first))

    return Change("torque_gain", "parameters",
                  f"torque at the output per N m of the motor: the model has {held:.5g}, the rig {asked:.5g}", edit)  # fmt: skip


def _frictions(content: Content, wanted: Wanted, draft: Draft, notes: list[str]) -> Iterator[Change]:
    """Dry friction at motor and load: added, corrected, or taken away."""
    places: tuple[Place, ...] = ("load",) if wanted.single or content.rigid else ("motor", "load")
    for place in places:
        location = None if wanted.single or content.rigid else place
        entry = wanted.find(*_FRICTION[:2], location=location)
        varying = wanted.find("load-dependent-friction")
        old = content.values["motor_friction" if content.rigid else f"{place}_friction"]
        new = float(entry["parameters"]["torque"]) if entry is not None else 0.0
        if entry is None and varying is not None:
            continue
        if abs(new - old) <= 1e-4 * max(old, new):
            continue
        carriers = sorted(content.at(place), key=lambda c: -c.frictionloss * abs(c.lever))
        carrier = carriers[0] if carriers else None
        interval = None if entry is None else _interval(entry, "torque")
        share: Share = "contradicted" if new == 0.0 else "left-out" if old == 0.0 else "parameters"
        reason = f"dry friction at the {place}: the model has {old:.5g}, the recording {new:.5g}"
        asymmetry = 0.0 if entry is None else float(entry["parameters"].get("asymmetry") or 0.0)
        yield Change(f"{place}_friction", share, reason, _friction_edit(content, place, carrier, old, new, asymmetry),
                     interval, _sigmas(old, new, interval))  # fmt: skip
        if entry is not None and entry["effect"] == "stribeck-friction":
            notes.append(
                "stribeck-friction: the file holds its sliding part; the breakaway is a law in effects.json"
            )


def _friction_edit(
    content: Content, place: Place, carrier: Carrier | None, old: float, new: float, asymmetry: float
) -> Callable[[Draft], None]:
    exact = f"{STUCK[0]:g} {STUCK[1]:g}", " ".join(f"{v:g}" for v in EXACT)

    def edit(draft: Draft) -> None:
        if carrier is None:
            _arm_tendon(
                draft,
                content,
                f'frictionloss="{_number(new)}" solreffriction="{exact[0]}" solimpfriction="{exact[1]}"',
            )
        else:
            _put(draft, carrier, "frictionloss", max(0.0, carrier.frictionloss + (new - old) / abs(carrier.lever)))
            if old == 0.0 and not draft.sources.urdf:
                draft.put(_tag(draft, carrier), "solreffriction", exact[0])
                draft.put(_tag(draft, carrier), "solimpfriction", exact[1])
        if abs(asymmetry * new) > 0.02 * max(new, _NEGLIGIBLE) and not draft.sources.urdf:
            over = _coefficients(content, "motor" if place == "motor" else "arm")
            joint, lever = over[0]
            _into_section(
                draft, "actuator",
                f'<general name="{joint}_friction_asymmetry" joint="{joint}" gainprm="0" biastype="affine" '
                f'biasprm="{_number(-asymmetry * new * lever)}"/>', f"general {joint}_friction_asymmetry",
            )  # fmt: skip

    return edit


def _interval(entry: Mapping[str, Any], name: str) -> Interval:
    found = entry.get("intervals", {}).get(name)
    return None if found is None or None in found else (float(found[0]), float(found[1]))


def _contradicted(content: Content, wanted: Wanted, draft: Draft) -> Iterator[Change]:
    """What the model holds beside the joint that the diagnosis knows; each is kept unless its removal helps."""
    spring_at: Place = "load" if wanted.single and wanted.spring else "transmission"
    for carrier in content.carriers:
        label = f"{carrier.kind} {carrier.name}"
        if carrier.place == "transmission" and carrier.frictionloss > 0.0:
            yield _zero(carrier, "frictionloss", f"dry friction between motor and load ({label})")
        if carrier.place != spring_at and carrier.stiffness[0] > 0.0 and not carrier.yields and (
            carrier.place != "load" or wanted.find("end-stop") is None):  # fmt: skip
            yield _zero(carrier, "stiffness", f"a spring to the ground at the {carrier.place} ({label})")
        if carrier.yields and wanted.find("hysteresis") is None:
            yield _zero(carrier, "stiffness", f"a spring that gives way ({label})")
        nonlinear = wanted.find("stiffness-nonlinearity") is not None and carrier.place == spring_at
        if any(carrier.stiffness[1:]) and not nonlinear:
            yield _linear(carrier, "stiffness", f"a spring that is not linear ({label})")
        drag = wanted.find("quadratic-damping") is not None and carrier.place == "load"
        if any(carrier.damping[1:]) and not drag:
            yield _linear(carrier, "damping", f"damping that grows with speed ({label})")
        if carrier.limited and wanted.find("end-stop") is None and not draft.sources.urdf:
            yield _unlimited(carrier)
    if not draft.sources.urdf:
        yield from _actuator(content, draft)


def _zero(carrier: Carrier, attribute: str, what: str) -> Change:
    def edit(draft: Draft) -> None:
        for position in range(3 if isinstance(getattr(carrier, attribute), tuple) else 1):
            if position == 0 or getattr(carrier, attribute)[position] != 0.0:
                _put(draft, carrier, attribute, 0.0, position)

    return Change(
        f"{carrier.name}_{attribute}", "contradicted", f"the model holds {what}, the recording does not", edit
    )


def _linear(carrier: Carrier, attribute: str, what: str) -> Change:
    def edit(draft: Draft) -> None:
        for position in (1, 2):
            if getattr(carrier, attribute)[position] != 0.0:
                _put(draft, carrier, attribute, 0.0, position)

    return Change(
        f"{carrier.name}_{attribute}_terms",
        "contradicted",
        f"the model holds {what}, the recording does not",
        edit,
    )


def _unlimited(carrier: Carrier) -> Change:
    def edit(draft: Draft) -> None:
        draft.put(_tag(draft, carrier), "limited", "false")

    reason = f"the model stops {carrier.kind} {carrier.name} at its range, the recording goes on"
    return Change(f"{carrier.name}_range", "contradicted", reason, edit)


def _actuator(content: Content, draft: Draft) -> Iterator[Change]:
    """Limits, bias and inner dynamics of the motor's actuator."""
    name = content.joint.actuator
    if name is None or content.joint.control != "torque":
        return
    model = content.system.model
    number = int(model.actuator(name).id)
    tag = next(
        (t for t in draft.sources.tags if t.name == name and t.parent is not None and t.parent.kind == "actuator"),
        None,
    )
    if tag is None:
        return

    def setting(attribute: str, value: str, what: str) -> Change:
        def edit(draft: Draft) -> None:
            draft.put(tag, attribute, value)

        return Change(
            f"{name}_{attribute}", "contradicted", f"actuator {name} {what}, the recorded motor does not", edit
        )

    if model.actuator_ctrllimited[number]:
        yield setting("ctrllimited", "false", "clips its control")
    if model.actuator_forcelimited[number]:
        yield setting("forcelimited", "false", "limits its force")
    if tag.kind == "general" and np.any(model.actuator_biasprm[number]):
        yield setting("biastype", "none", "has a bias force")
    if tag.kind == "general" and model.actuator_dyntype[number] != int(mujoco.mjtDyn.mjDYN_NONE):
        yield setting("dyntype", "none", "filters its control")


def _left_out(content: Content, wanted: Wanted, notes: list[str]) -> Iterator[Change]:
    """Effects that MJCF has an element for; of the others a note."""
    spring: Place = "load" if wanted.single else "transmission"
    carrier = next(iter(sorted(content.at(spring), key=lambda c: -c.stiffness[0] * c.lever**2)), None)
    for entry in wanted.effects:
        name, p = entry["effect"], entry["parameters"]
        made: Callable[[Draft], None] | None = None
        main = next(iter(p), "")
        if name in ("coulomb-friction", "stribeck-friction", "gravity", "torque-gain"):
            continue  # with the parameters above
        if name == "backlash" and carrier is not None:
            made = _backlash(carrier, p)
        elif name == "stiffness-nonlinearity" and carrier is not None:
            made = _nonlinear(carrier, p, wanted)
        elif name == "hysteresis" and carrier is not None and entry.get("variant") == "maxwell-slip":
            made = _slipping(carrier, p)
        elif name == "quadratic-damping":
            made = _drag(content, p)
        elif name == "end-stop":
            made = _stop(content, entry)
        if made is None:
            notes.append(
                f"{name}@{entry['location']}: no element of MJCF puts it into this file; effects.json holds it"
            )
            continue
        reason = f"{name.replace('-', ' ')}: the recording shows it, the model has none"
        yield Change(f"{name}@{entry['location']}", "left-out", reason, made, _interval(entry, main))


def _over(carrier: Carrier, draft: Draft) -> list[tuple[str, float]]:
    """The carrier's own coordinate as a sum over joints."""
    if carrier.kind == "joint":
        return [(carrier.name, 1.0)]
    tag = _tag(draft, carrier)
    rows = [t for t in draft.sources.tags if t.parent is tag and t.kind == "joint"]
    return [(t.attributes["joint"][0], float(t.attributes["coef"][0])) for t in rows]


def _backlash(carrier: Carrier, p: Mapping[str, float]) -> Callable[[Draft], None]:
    half, centre = 0.5 * p["gap"] * abs(carrier.lever), 0.5 * p["gap"] * (p.get("centre") or 0.0) * carrier.lever
    length = f"{_number(centre - half)} {_number(centre + half)}"

    def edit(draft: Draft) -> None:
        tag = _tag(draft, carrier)
        if carrier.kind == "fixed":
            draft.put(tag, "springlength", length)
            return
        stiffness = draft.get(tag, "stiffness") or " ".join(_number(v) for v in carrier.stiffness)
        draft.put(tag, "stiffness", "0", old=stiffness)
        _tendon(
            draft,
            f"{carrier.name}_play",
            f'stiffness="{stiffness}" springlength="{length}"',
            _over(carrier, draft),
        )

    return edit


def _nonlinear(carrier: Carrier, p: Mapping[str, float], wanted: Wanted) -> Callable[[Draft], None]:
    def edit(draft: Draft) -> None:
        if p.get("soft_share") is not None:
            soft = p["soft_share"] * wanted.base["stiffness"] / carrier.lever**2
            reach = _number(p["transition_angle"] * abs(carrier.lever))
            now = float((draft.get(_tag(draft, carrier), "stiffness") or _number(carrier.stiffness[0])).split()[0])
            _put(draft, carrier, "stiffness", now - soft)
            _tendon(draft, f"{carrier.name}_low_torque", f'stiffness="{_number(soft)}" springlength="-{reach} {reach}"',
                    _over(carrier, draft))  # fmt: skip
            return
        if p.get("quadratic"):
            _put(draft, carrier, "stiffness", p["quadratic"] / carrier.lever**3, 1)
        _put(draft, carrier, "stiffness", p["cubic"] / carrier.lever**4, 2)

    return edit


def _slipping(carrier: Carrier, p: Mapping[str, float]) -> Callable[[Draft], None]:
    def edit(draft: Draft) -> None:
        angle = p["torque"] / p["stiffness"]
        each = p["stiffness"] / len(SLIP_LEVELS) / carrier.lever**2
        for number, level in enumerate(SLIP_LEVELS, 1):
            gives = _number(level * angle * abs(carrier.lever))
            _tendon(draft, f"{carrier.name}_slip_{number}", f'stiffness="{_number(each)}" springyield="{gives}"',
                    _over(carrier, draft))  # fmt: skip

    return edit


def _drag(content: Content, p: Mapping[str, float]) -> Callable[[Draft], None]:
    carrier = next(iter(content.at("load")), None)

    def edit(draft: Draft) -> None:
        if carrier is None:
            _tendon(
                draft,
                f"{content.joint.link}_drag",
                f'damping="0 {_number(p["coefficient"])}"',
                _coefficients(content, "arm"),
            )
        else:
            _put(draft, carrier, "damping", p["coefficient"] / abs(carrier.lever) ** 3, 1)

    return edit


def _stop(content: Content, entry: Mapping[str, Any]) -> Callable[[Draft], None]:
    p = entry["parameters"]
    upper = entry.get("variant") != "lower"
    zero = content.joint.sign * content.system.zero  # of the tendon's length, which is q + sign zero

    def edit(draft: Draft) -> None:
        edge = _number(p["angle"] + zero)
        length = f"-{_FAR:g} {edge}" if upper else f"{edge} {_FAR:g}"
        _tendon(draft, f"{content.joint.link}_stop", f'stiffness="{_number(p["stiffness"])}" springlength="{length}"',
                _coefficients(content, "arm"))  # fmt: skip

    return edit
