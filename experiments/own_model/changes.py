"""What to change in a model's file, line by line: its numbers, what it left out, and what it holds that wasn't recorded.

Every :class:`Change` edits the text on its own, so that any subset of them is a file that can be stepped and scored.
Nothing is decided here: ``study`` keeps the changes that the recordings ask for.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace

import mujoco

from jointscope.errors import RefusedError
from jointscope.experiments.own_model.content import Carrier, Content, Place
from jointscope.experiments.own_model.contradicted import contradicted
from jointscope.experiments.own_model.edits import (
    coefficients,
    number,
    put,
    put_arm_tendon,
    put_into_section,
    tag_of,
)
from jointscope.experiments.own_model.inertia import heavier_by, put_mass
from jointscope.experiments.own_model.left_out import left_out
from jointscope.experiments.own_model.wanted import Change, Interval, Share, Wanted, interval_of
from jointscope.experiments.own_model.xml_document import Draft
from jointscope.models.effects.building import EXACT, STUCK

_NEGLIGIBLE = 1e-9
_VANISHED = 0.05  # of the model's value: a fitted one below it says that the model holds what isn't there
_FRICTION = ("coulomb-friction", "stribeck-friction", "load-dependent-friction")


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
    found += contradicted(content, wanted, draft)
    if not content.rigid and not draft.sources.urdf:
        found += left_out(content, wanted, notes)
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


def _elasticity(content: Content, wanted: Wanted) -> Change:
    """A second joint on the same body and axis: the user's own becomes the motor's."""
    link = content.joint.link
    model = content.system.model
    own = model.joint(link)
    name = f"{link}_elastic"
    axis, place = " ".join(number(v) for v in own.axis), " ".join(number(v) for v in own.pos)
    slide = ' type="slide"' if model.jnt_type[own.id] == int(mujoco.mjtJoint.mjJNT_SLIDE) else ' type="hinge"'

    def edit(draft: Draft) -> None:
        text = (
            f'<joint name="{name}"{slide} axis="{axis}" pos="{place}" stiffness="{number(wanted.base["stiffness"])}" '
            f'damping="{number(wanted.base["damping"])}" armature="0" frictionloss="0" limited="false"/>'
        )
        draft.add(draft.sources.element("joint", link), text, element=f"joint {name}", after=True)

    return Change(
        "elasticity", "left-out", f"joint {link} is rigid in the model; the recording shows its reducer's spring", edit,
        wanted.intervals.get("stiffness"), joint=replace(content.joint, rotor=link, link=name),
    )  # fmt: skip


def sigmas_off(old: float, new: float, interval: Interval) -> float:
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
            put_arm_tendon(draft, content, f'{attribute}="{number(new)}"')

        return Change(name, share, reason, add, interval, sigmas_off(old, new, interval))
    power = carrier.lever**2
    value = max(0.0, _coefficient(carrier, attribute) + (new - old) / power)

    def edit(draft: Draft) -> None:
        put(draft, carrier, attribute, value)

    return Change(name, share, reason, edit, _scaled(interval, _coefficient(carrier, attribute), old, power),
                  sigmas_off(old, new, interval))  # fmt: skip


def _mass_change(content: Content, wanted: Wanted) -> Change | None:
    """Inertia about the joint and moment of the weight, which one body carries."""
    old, new = content.values["load_inertia"], wanted.base["load_inertia"]
    gravity, moment = wanted.find("gravity"), wanted.weight
    heavier = heavier_by(content, wanted)
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

    sigmas = max(sigmas_off(old, new, interval), math.inf if abs(heavier) > 0.01 * abs(moment) else 0.0)
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
        tokens = (draft.get(tag, "gear") or number(first)).split()
        tokens[0] = number(float(tokens[0]) * factor)
        draft.put(tag, "gear", " ".join(tokens), old=number(first))

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
        interval = None if entry is None else interval_of(entry, "torque")
        share: Share = "contradicted" if new == 0.0 else "left-out" if old == 0.0 else "parameters"
        reason = f"dry friction at the {place}: the model has {old:.5g}, the recording {new:.5g}"
        asymmetry = 0.0 if entry is None else float(entry["parameters"].get("asymmetry") or 0.0)
        yield Change(f"{place}_friction", share, reason, _friction_edit(content, place, carrier, old, new, asymmetry),
                     interval, sigmas_off(old, new, interval))  # fmt: skip
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
            put_arm_tendon(
                draft,
                content,
                f'frictionloss="{number(new)}" solreffriction="{exact[0]}" solimpfriction="{exact[1]}"',
            )
        else:
            put(draft, carrier, "frictionloss", max(0.0, carrier.frictionloss + (new - old) / abs(carrier.lever)))
            if old == 0.0 and not draft.sources.urdf:
                draft.put(tag_of(draft, carrier), "solreffriction", exact[0])
                draft.put(tag_of(draft, carrier), "solimpfriction", exact[1])
        if abs(asymmetry * new) > 0.02 * max(new, _NEGLIGIBLE) and not draft.sources.urdf:
            over = coefficients(content, "motor" if place == "motor" else "arm")
            joint, lever = over[0]
            put_into_section(
                draft, "actuator",
                f'<general name="{joint}_friction_asymmetry" joint="{joint}" gainprm="0" biastype="affine" '
                f'biasprm="{number(-asymmetry * new * lever)}"/>', f"general {joint}_friction_asymmetry",
            )  # fmt: skip

    return edit
