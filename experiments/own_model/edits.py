"""Edits of a draft in the terms of a joint: a carrier's coefficient, a tendon over motor and load, a new element."""

from __future__ import annotations

from typing import Literal

import numpy as np

from jointscope.errors import RefusedError
from jointscope.experiments.own_model.content import Carrier, Content
from jointscope.experiments.own_model.xml_document import Draft, Tag


def number(value: float) -> str:
    return f"{value + 0.0:.7g}"


def tag_of(draft: Draft, carrier: Carrier) -> Tag:
    return draft.sources.element(carrier.kind, carrier.name)


def put(draft: Draft, carrier: Carrier, attribute: str, value: float, position: int = 0) -> None:
    """Set one coefficient of a carrier's attribute, the others as they are."""
    own = getattr(carrier, attribute)
    tag = tag_of(draft, carrier)
    if draft.sources.urdf:
        tag, attribute = _urdf_dynamics(draft, tag, attribute)
    text = draft.get(tag, attribute)
    if text is None:
        held = own if isinstance(own, tuple) else (own,)
        while len(held) > 1 and held[-1] == 0.0:
            held = held[:-1]
        old = " ".join(number(v) for v in held)
    tokens = (text if text is not None else old).split()
    tokens += ["0"] * (position + 1 - len(tokens))
    if float(tokens[position]) != value:
        tokens[position] = number(value)
    draft.put(tag, attribute, " ".join(tokens), old=None if text is not None else old)


def _urdf_dynamics(draft: Draft, joint: Tag, attribute: str) -> tuple[Tag, str]:
    names = {"damping": "damping", "frictionloss": "friction"}
    if attribute not in names:
        raise RefusedError(f"a URDF has no {attribute}")
    found = next((t for t in draft.sources.select("dynamics") if t.parent is joint), None)
    if found is None:
        raise RefusedError(f"joint {joint.name} has no <dynamics> in the URDF")
    return found, names[attribute]


def put_arm_tendon(draft: Draft, content: Content, attributes: str) -> None:
    """A fixed tendon whose coordinate is the arm's angle."""
    put_tendon(draft, f"{content.joint.link}_arm", attributes, coefficients(content, "arm"))


def coefficients(content: Content, which: Literal["arm", "motor"]) -> list[tuple[str, float]]:
    function = content.system.arm if which == "arm" else content.system.motor
    model = content.system.model
    return [(model.joint(int(model.dof_jntid[k])).name, float(function[k])) for k in np.flatnonzero(function)]


def put_tendon(draft: Draft, name: str, attributes: str, over: list[tuple[str, float]]) -> None:
    inside = "\n".join(f'  <joint joint="{joint}" coef="{number(c)}"/>' for joint, c in over)
    put_into_section(draft, "tendon", f'<fixed name="{name}" {attributes}>\n{inside}\n</fixed>', f"fixed {name}")


def put_into_section(draft: Draft, kind: str, text: str, element: str) -> None:
    section = next((t for t in draft.sources.select(kind) if not t.closes_itself
                    and t.parent is draft.sources.tags[0]), None)  # fmt: skip
    if section is None:
        inside = "\n".join("  " + line for line in text.splitlines())
        draft.add(draft.sources.tags[0], f"<{kind}>\n{inside}\n</{kind}>", element=element)
    else:
        draft.add(section, text, element=element)


def over_joints(carrier: Carrier, draft: Draft) -> list[tuple[str, float]]:
    """The carrier's own coordinate as a sum over joints."""
    if carrier.kind == "joint":
        return [(carrier.name, 1.0)]
    tag = tag_of(draft, carrier)
    rows = [t for t in draft.sources.tags if t.parent is tag and t.kind == "joint"]
    return [(t.attributes["joint"][0], float(t.attributes["coef"][0])) for t in rows]
