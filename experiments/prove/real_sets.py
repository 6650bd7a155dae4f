"""The public recordings, what is published of them, and what a right answer to each of them is.

The diagnosis knows none of this: it is given a campaign like any other. Here it is only judged.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

Diagnosis = Mapping[str, Any]


@dataclass(frozen=True)
class Published:
    """A figure that others printed of these recordings.

    Attributes:
        what: Of which quantity, with its unit.
        key: ``effect.parameter``, ``parameters.name`` or ``held_out.name`` of diagnosis.json that answers it, or "".
        within: Largest relative difference that counts as agreement [-]; 0 where it is only shown.
    """

    what: str
    value: float
    key: str
    within: float
    source: str


@dataclass(frozen=True, kw_only=True)
class RealSet:
    """A public set of recordings as one campaign.

    Attributes:
        name: Of the case.
        data_set: Of the importer, and of the folder below DATA.
        axis: Where the set has several.
        base: What the diagnosis is handed as the base, in words.
        verdicts: Right verdicts.
        places: ``effect@location`` or ``@location`` of which the first named effect, or the leading candidate where none
            is named, must be one; empty where none need be.
        never: Effects that these recordings do not hold, so that naming one is wrong.
        figure: Key of ``held_out`` that shows what the answer is worth.
        limit: What that figure must not exceed [-], or ``None`` where it must only fall.
        published: Figures of others.
    """

    name: str
    data_set: str
    axis: int | None = None
    base: str
    verdicts: tuple[str, ...]
    places: tuple[str, ...] = ()
    never: tuple[str, ...] = ()
    figure: str = "error"
    limit: float | None = None
    published: tuple[Published, ...] = ()


_JANOT = "Janot, Gautier and Brunot 2019, IDIM-LS"
_WEIGAND = "Weigand et al. 2021, nominal model"
EMPS = RealSet(
    name="emps",
    data_set="emps",
    base="one inertia with viscous friction and a force of unknown zero",
    verdicts=("effects",),
    places=("coulomb-friction@load",),
    never=("backlash", "stiffness-nonlinearity", "link-flexibility", "end-stop"),
    figure="inverse_error",
    limit=0.042,
    published=(
        Published("Coulomb friction [N]", 20.3935, "coulomb-friction.torque", 0.02, _JANOT),
        Published("viscous friction [N s/m]", 203.5034, "parameters.load_damping", 0.05, _JANOT),
        Published("inertia [kg]", 95.1089, "parameters.inertia", 0.02, _JANOT),
        Published("inverse force error, pulses", 0.0598, "held_out.inverse_error", 0.0, _JANOT + ", cross test"),
    ),
)


def _robot(axis: int, stiffness: float) -> RealSet:
    return RealSet(
        name=f"kr300-axis-{axis}",
        data_set="kr300-weigand2021",
        axis=axis,
        base="two inertias, a linear elastic reducer, viscous friction",
        verdicts=("effects", "unknown"),
        places=("@motor", "hysteresis@transmission", "load-dependent-friction@transmission"),
        never=("sensor-tilt", "neighbour-flexibility", "external-vibration"),
        figure="wind_up_error",
        published=(Published("stiffness [N m/rad]", stiffness, "parameters.stiffness", 0.0, _WEIGAND),),
    )


BENCH = RealSet(
    name="motor-bench",
    data_set="motor-bench-flexcoupling",
    base="two inertias, a linear elastic coupling, viscous friction; torque per unit of current",
    verdicts=("none",),
    never=(
        "backlash", "stiffness-nonlinearity", "link-flexibility", "base-compliance", "neighbour-flexibility",
        "end-stop", "hysteresis",
    ),
    figure="wind_up_error",
)  # fmt: skip
HAMMER = RealSet(
    name="hammer-lvm",
    data_set="hammer-lvm",
    base="one inertia on a spring; force per unit of an uncalibrated channel",
    verdicts=("effects", "unknown"),
    places=("link-flexibility@load", "base-compliance@base", "neighbour-flexibility@neighbour"),
    never=(
        "backlash", "stiffness-nonlinearity", "coulomb-friction", "stribeck-friction", "quadratic-damping", "end-stop",
        "hysteresis",
    ),
    figure="error",
)  # fmt: skip
SETS: tuple[RealSet, ...] = (
    EMPS,
    BENCH,
    _robot(1, 4.5778e6),
    _robot(2, 7.5189e6),
    _robot(3, 4.0956e6),
    HAMMER,
)


@dataclass(frozen=True)
class Check:
    """One thing asked of an answer."""

    asked: str
    found: str
    met: bool


def named(diagnosis: Diagnosis) -> list[str]:
    """``effect@location`` of what was claimed, most certain first."""
    return [f"{effect['effect']}@{effect['location']}" for effect in diagnosis["effects"]]


def leading(diagnosis: Diagnosis) -> str:
    """The first named effect, else the best candidate, else ``@location`` of an unnamed force; empty without any."""
    candidates = [
        *named(diagnosis),
        *next((r["effects"] for r in diagnosis.get("ranking", []) if r["effects"]), []),
    ]
    place = (diagnosis.get("where") or {}).get("location")
    return candidates[0] if candidates else f"@{place}" if place else ""


def figure(diagnosis: Diagnosis, key: str) -> tuple[float, float]:
    """The held-out figure with the base and with the answer [-]; ``nan`` where it is not known."""
    held = diagnosis.get("held_out") or {}
    if key == "inverse_error":
        pair = held.get("base_inverse_error"), held.get("inverse_error")
    elif key == "error":
        pair = held.get("base_error"), held.get("augmented_error")
    else:
        both = held.get(key) or {}
        pair = both.get("base"), both.get("augmented")
    return math.nan if pair[0] is None else float(pair[0]), math.nan if pair[1] is None else float(pair[1])


def value(diagnosis: Diagnosis, key: str) -> float:
    """What the answer says of ``key`` (see :class:`Published`); ``nan`` where it says nothing."""
    first, _, last = key.partition(".")
    if first == "held_out":
        return figure(diagnosis, last)[1]
    if first == "parameters":
        found = diagnosis["parameters"].get(last)
    else:
        effects = [effect for effect in diagnosis["effects"] if effect["effect"] == first]
        found = effects[0]["parameters"].get(last) if effects else None
    return math.nan if found is None or found["value"] is None else float(found["value"])


def checks(asked: RealSet, diagnosis: Diagnosis) -> list[Check]:
    """What is asked of the answer to a set's own campaign."""
    claimed = named(diagnosis)
    found = [
        Check(
            f"verdict {' or '.join(asked.verdicts)}", diagnosis["verdict"], diagnosis["verdict"] in asked.verdicts
        )
    ]
    if asked.places:
        first = leading(diagnosis)
        right = any(first == place or (place.startswith("@") and first.endswith(place)) for place in asked.places)
        found.append(
            Check(f"first named, or leading candidate: {', '.join(asked.places)}", first or "nothing", right)
        )
    wrong = [name for name in claimed if name.split("@")[0] in asked.never]
    found.append(Check("nothing claimed that is not there", ", ".join(wrong) or "nothing", not wrong))
    if asked.places:
        before, after = figure(diagnosis, asked.figure)
        wanted = "falls" if asked.limit is None else f"<= {asked.limit:g}"
        met = after < before if asked.limit is None else after <= asked.limit
        found.append(Check(f"held-out {asked.figure} {wanted}", f"{before:.4f} -> {after:.4f}", met))
    for figure_of in asked.published:
        if figure_of.within > 0.0:
            said = value(diagnosis, figure_of.key)
            met = abs(said / figure_of.value - 1.0) <= figure_of.within
            found.append(
                Check(f"{figure_of.what} {figure_of.value:g} +- {100 * figure_of.within:g} %", f"{said:.5g}", met)
            )
    return found
