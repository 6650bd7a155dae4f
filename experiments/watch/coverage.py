"""What is still missing for each family of effects: experiments and channels that show it, recordings that tell it apart.

Every effect of the catalogue is asked what ``diagnose`` asks it: can these recordings show it at all
(``EffectSpec.possible``, ``revealed_by``), and is one of the recordings there that tells it from its look-alikes
(``next_experiment.separators``)? Nothing here is a fit, and nothing says that an effect is present.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from jointscope.diagnosis.effects import DRIFT_PER_RUN, PAYLOADS, REGISTRY, EffectSpec
from jointscope.diagnosis.next_experiment import MENU, separators
from jointscope.diagnosis.parameters import base_spec
from jointscope.diagnosis.problem import PreparedRun, Problem
from jointscope.diagnosis.run_preparation import prepare_run
from jointscope.diagnosis.sizes import unit_scales
from jointscope.errors import RefusedError
from jointscope.experiments.watch.held import Held, held
from jointscope.experiments.watch.judging import Take
from jointscope.recordings.campaign import Campaign, Nameplate, Run

EXPERIMENTS: Final = {
    "hammer": "hammer hits",
    "torque-sweep": "a torque sweep",
    "speed-motion": "a motion under speed control",
    "free": "a record without excitation",
}
_ORDER: Final = (
    "stiffness", "dissipative", "hysteretic", "mode", "periodic", "input", "gravity", "inertia", "contact", "sensor-gain",
    "sensor-time", "external",
)  # fmt: skip
KEPT_BACK: Final = 2  # takes of one experiment, so that one can be held out


@dataclass(frozen=True, kw_only=True)
class EffectCoverage:
    """One effect.

    Attributes:
        effect, location, family: As in the catalogue.
        shown: Whether these takes can show it.
        missing: Why not, or empty.
        apart: Look-alikes that these takes can't tell it from, with the recording (key of ``MENU``) that would.
    """

    effect: str
    location: str
    family: str
    shown: bool
    missing: str
    apart: tuple[tuple[str, str], ...]

    @property
    def name(self) -> str:
        """``effect@location``."""
        return f"{self.effect}@{self.location}"


@dataclass(frozen=True, kw_only=True)
class Coverage:
    """The whole state of a campaign in the making.

    Attributes:
        effects: Every effect of the catalogue, by family.
        menu: How far each recording of the menu is.
        alone: Experiments of which too few takes are there to hold one out.
        next_take: The recording that would tell most effects apart, or ``None``.
        refused: Why nothing can be said, or empty.
    """

    effects: tuple[EffectCoverage, ...] = ()
    menu: Mapping[str, Held]
    alone: tuple[str, ...] = ()
    next_take: str | None = None
    refused: str = ""


def coverage(campaign: Campaign, takes: Sequence[Take]) -> Coverage:
    """What ``takes`` can show, and what they lack."""
    rig = campaign.rig
    menu = held(takes, rig)
    if rig.topology == "arm":
        return Coverage(menu=menu, refused="effects are diagnosed joint by joint; this campaign has several")
    counts: Counter[str] = Counter(take.run.experiment for take in takes)
    problem = bench_problem(rig, [take.run for take in takes])
    found = _effects(problem, set(counts), menu)
    return Coverage(
        effects=tuple(sorted(found, key=lambda one: (_ORDER.index(one.family), one.name))),
        menu=menu,
        alone=tuple(name for name in EXPERIMENTS if 0 < counts[name] < KEPT_BACK),
        next_take=_next(found, counts),
    )


def bench_problem(rig: Nameplate, runs: Sequence[Run]) -> Problem | None:
    """Runs as the diagnosis sees them, without a start value: enough to ask what they can show, in a moment."""
    prepared: list[PreparedRun] = []
    for run in runs:
        try:
            one = prepare_run(run, rig, len(prepared))
        except (RefusedError, ValueError):
            continue  # a run that the diagnosis can't use shows nothing to it
        if one is not None:
            prepared.append(one)
    if not prepared:
        return None
    travel = max((_travel(run, rig) for run in runs), default=0.0)
    scales = replace(unit_scales(), travel=travel)
    return Problem(rig=rig, runs=tuple(prepared), base=base_spec(rig, tuple(prepared)), scales=scales)


def _travel(run: Run, rig: Nameplate) -> float:
    """How far the arm travels [rad or m], from whichever angle or speed was recorded."""
    found = [0.0]
    for signal in run.select():
        ratio = (rig.reduction_ratio or 1.0) if signal.channel.location == "motor" else 1.0
        x = signal.samples[np.isfinite(signal.samples)]
        if signal.channel.quantity in ("angle", "position"):
            found.append(float(np.ptp(x)) / ratio)
        elif signal.channel.quantity in ("angular-velocity", "velocity", "speed-command"):
            found.append(float(np.ptp(np.cumsum(x))) / signal.sampling_rate / ratio)
    return max(found)


def _effects(problem: Problem | None, experiments: set[str], menu: Mapping[str, Held]) -> list[EffectCoverage]:
    groups: dict[tuple[str, str], list[EffectSpec]] = {}
    for spec in (*REGISTRY, *PAYLOADS, DRIFT_PER_RUN):
        groups.setdefault((spec.name, spec.location), []).append(spec)
    missing = {key: _missing(specs, problem, experiments) for key, specs in groups.items()}
    visible = {name for (name, _), why in missing.items() if not why}
    found = []
    for (name, location), specs in groups.items():
        why = missing[name, location]
        others = dict.fromkeys(other for spec in specs for other in spec.look_alikes if other in visible)
        apart = [] if why else [(other, _untold(name, location, other, menu)) for other in others]
        found.append(
            EffectCoverage(
                effect=name, location=location, family=specs[0].family, shown=not why, missing=why,
                apart=tuple((other, key) for other, key in apart if key),
            )
        )  # fmt: skip
    return found


def _missing(specs: Sequence[EffectSpec], problem: Problem | None, experiments: set[str]) -> str:
    """Why none of an effect's variants can be seen; empty where one can."""
    wanted = dict.fromkeys(name for spec in specs for name in spec.revealed_by)
    if not experiments.intersection(wanted):
        return "record " + " or ".join(EXPERIMENTS.get(name, name) for name in wanted)
    if problem is None:
        return "no take holds an input and an output in time"
    reasons = []
    for spec in specs:
        if not experiments.intersection(spec.revealed_by):
            continue
        why = spec.possible(problem)
        if why is None:
            return ""
        reasons.append(why)
    return reasons[0]


def _untold(name: str, location: str, other: str, menu: Mapping[str, Held]) -> str:
    """The sharpest recording that tells the two apart, where none of those that would is there; else empty."""
    keys = separators(f"{name}@{location}", f"{other}@{location}")
    return "" if not keys or any(menu[key].enough for key in keys) else keys[0]


def _next(found: Sequence[EffectCoverage], counts: Counter[str]) -> str | None:
    """An experiment that none of the takes is, if that hides the most; else the recording most pairs wait for."""
    hidden = Counter(one.missing for one in found if one.missing.startswith("record "))
    waiting = Counter(key for one in found for _, key in one.apart)
    if not sum(counts.values()):
        return f"record {EXPERIMENTS['hammer']}, the motor held by its brake"
    if hidden:
        return hidden.most_common(1)[0][0]
    if waiting:
        order = list(MENU)
        return MENU[max(waiting, key=lambda key: (waiting[key], -order.index(key)))]
    return None
