"""What a model holds beside the joint that the recordings show; each is taken out only where that helps."""

from __future__ import annotations

from collections.abc import Iterator

import mujoco
import numpy as np

from jointscope.experiments.own_model.content import Carrier, Content, Place
from jointscope.experiments.own_model.edits import number, put, tag_of
from jointscope.experiments.own_model.wanted import Change, Wanted
from jointscope.experiments.own_model.xml_document import Draft


def contradicted(content: Content, wanted: Wanted, draft: Draft) -> Iterator[Change]:
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
        if carrier.play > 0.0 and carrier.place == spring_at and wanted.find("backlash") is None:
            yield _closed(content, carrier)
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
                put(draft, carrier, attribute, 0.0, position)

    return Change(
        f"{carrier.name}_{attribute}", "contradicted", f"the model holds {what}, the recording does not", edit
    )


def _linear(carrier: Carrier, attribute: str, what: str) -> Change:
    def edit(draft: Draft) -> None:
        for position in (1, 2):
            if getattr(carrier, attribute)[position] != 0.0:
                put(draft, carrier, attribute, 0.0, position)

    return Change(
        f"{carrier.name}_{attribute}_terms",
        "contradicted",
        f"the model holds {what}, the recording does not",
        edit,
    )


def _closed(content: Content, carrier: Carrier) -> Change:
    """Without the dead band, about the middle of which its spring then acts."""
    middle = float(np.mean(content.system.model.tendon_lengthspring[content.system.model.tendon(carrier.name).id]))

    def edit(draft: Draft) -> None:
        draft.put(tag_of(draft, carrier), "springlength", number(middle))

    width, label = number(carrier.play / abs(carrier.lever)), f"{carrier.kind} {carrier.name}"
    reason = f"the model holds a dead band of {width} at the joint's output ({label}), the recording does not"
    return Change(f"{carrier.name}_springlength", "contradicted", reason, edit)


def _unlimited(carrier: Carrier) -> Change:
    def edit(draft: Draft) -> None:
        draft.put(tag_of(draft, carrier), "limited", "false")

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
