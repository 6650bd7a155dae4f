"""Effects put into a user's file where MJCF has an element for them; of the others a note says where they are."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import mujoco

from jointscope.experiments.own_model.content import Carrier, Content, Place
from jointscope.experiments.own_model.edits import coefficients, number, over_joints, put, put_tendon, tag_of
from jointscope.experiments.own_model.inertia import heavier_by, put_mass
from jointscope.experiments.own_model.wanted import Change, Share, Wanted, interval_of
from jointscope.experiments.own_model.xml_document import Draft
from jointscope.models.effects.transmission import SLIP_LEVELS

_FAR = 1e3  # rad or m


def left_out(content: Content, wanted: Wanted, notes: list[str]) -> Iterator[Change]:
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
        elif name == "neighbour-flexibility" and set(p) <= {"frequency", "modal_share", "damping"}:
            made = _neighbour(content, wanted, p)
        if made is None:
            notes.append(
                f"{name}@{entry['location']}: no element of MJCF puts it into this file; effects.json holds it"
            )
            continue
        share: Share = "left-out"
        shown = entry.get("named", True)
        reason = "the recording shows it" if shown else "it fits the recording, which is not enough to name it"
        reason = f"{name.replace('-', ' ')}: {reason}, the model has none"
        if name == "backlash" and carrier is not None and carrier.play > 0.0:
            share, held = "parameters", number(carrier.play / abs(carrier.lever))
            reason = f"backlash: the model has {held}, the recording {number(p['gap'])} at the joint output"
        interval = None if main == "frequency" else interval_of(entry, main)  # no element holds a frequency
        yield Change(f"{name}@{entry['location']}", share, reason, made, interval)


def _backlash(carrier: Carrier, p: Mapping[str, float]) -> Callable[[Draft], None]:
    half, centre = 0.5 * p["gap"] * abs(carrier.lever), 0.5 * p["gap"] * (p.get("centre") or 0.0) * carrier.lever
    length = f"{number(centre - half)} {number(centre + half)}"

    def edit(draft: Draft) -> None:
        tag = tag_of(draft, carrier)
        if carrier.kind == "fixed":
            draft.put(tag, "springlength", length)
            return
        stiffness = draft.get(tag, "stiffness") or " ".join(number(v) for v in carrier.stiffness)
        draft.put(tag, "stiffness", "0", old=stiffness)
        put_tendon(
            draft,
            f"{carrier.name}_play",
            f'stiffness="{stiffness}" springlength="{length}"',
            over_joints(carrier, draft),
        )

    return edit


def _nonlinear(carrier: Carrier, p: Mapping[str, float], wanted: Wanted) -> Callable[[Draft], None]:
    def edit(draft: Draft) -> None:
        if p.get("soft_share") is not None:
            soft = p["soft_share"] * wanted.base["stiffness"] / carrier.lever**2
            reach = number(p["transition_angle"] * abs(carrier.lever))
            now = float(
                (draft.get(tag_of(draft, carrier), "stiffness") or number(carrier.stiffness[0])).split()[0]
            )
            put(draft, carrier, "stiffness", now - soft)
            put_tendon(draft, f"{carrier.name}_low_torque", f'stiffness="{number(soft)}" springlength="-{reach} {reach}"',
                    over_joints(carrier, draft))  # fmt: skip
        if p.get("cubic") is None:
            return
        if p.get("quadratic"):
            put(draft, carrier, "stiffness", p["quadratic"] / carrier.lever**3, 1)
        put(draft, carrier, "stiffness", p["cubic"] / carrier.lever**4, 2)

    return edit


def _slipping(carrier: Carrier, p: Mapping[str, float]) -> Callable[[Draft], None]:
    def edit(draft: Draft) -> None:
        angle = p["torque"] / p["stiffness"]
        each = p["stiffness"] / len(SLIP_LEVELS) / carrier.lever**2
        for k, level in enumerate(SLIP_LEVELS, 1):
            gives = number(level * angle * abs(carrier.lever))
            put_tendon(draft, f"{carrier.name}_slip_{k}", f'stiffness="{number(each)}" springyield="{gives}"',
                    over_joints(carrier, draft))  # fmt: skip

    return edit


def _drag(content: Content, p: Mapping[str, float]) -> Callable[[Draft], None]:
    carrier = next(iter(content.at("load")), None)

    def edit(draft: Draft) -> None:
        if carrier is None:
            put_tendon(
                draft,
                f"{content.joint.link}_drag",
                f'damping="0 {number(p["coefficient"])}"',
                coefficients(content, "arm"),
            )
        else:
            put(draft, carrier, "damping", p["coefficient"] / abs(carrier.lever) ** 3, 1)

    return edit


def _neighbour(content: Content, wanted: Wanted, p: Mapping[str, float]) -> Callable[[Draft], None]:
    """A part J_p of the link's inertia on a spring of its own about the link's axis, which no sensor rides on."""
    model, link = content.system.model, content.joint.link
    own = model.joint(link)
    slides = model.jnt_type[own.id] == int(mujoco.mjtJoint.mjJNT_SLIDE)
    total = wanted.base["load_inertia"]
    part = min(p["modal_share"], 0.95) * total
    omega = 2.0 * math.pi * p["frequency"]
    axis, anchor = (" ".join(number(v) for v in vector) for vector in (own.axis, own.pos))
    mass, inertia = (part, 1e-6 * part) if slides else (1e-9, part)
    text = (
        f'<body name="{link}_neighbour">\n'
        f'  <inertial pos="{anchor}" mass="{number(mass)}" diaginertia="{" ".join([number(inertia)] * 3)}"/>\n'
        f'  <joint name="{link}_neighbour" type="{"slide" if slides else "hinge"}" axis="{axis}" pos="{anchor}" '
        f'stiffness="{number(part * omega**2)}" damping="{number(2.0 * p["damping"] * omega * part)}" armature="0" '
        f'frictionloss="0" limited="false"/>\n'
        f"</body>"
    )

    def edit(draft: Draft) -> None:
        body = draft.sources.element("joint", link).parent
        assert body is not None
        put_mass(draft, content, total - part - content.values["load_inertia"], heavier_by(content, wanted))
        draft.add(body, text, element=f"body {link}_neighbour")

    return edit


def _stop(content: Content, entry: Mapping[str, Any]) -> Callable[[Draft], None]:
    p = entry["parameters"]
    upper = entry.get("variant") != "lower"
    zero = content.joint.sign * content.system.zero  # of the tendon's length, which is q + sign zero

    def edit(draft: Draft) -> None:
        edge = number(p["angle"] + zero)
        length = f"-{_FAR:g} {edge}" if upper else f"{edge} {_FAR:g}"
        put_tendon(draft, f"{content.joint.link}_stop", f'stiffness="{number(p["stiffness"])}" springlength="{length}"',
                coefficients(content, "arm"))  # fmt: skip

    return edit
