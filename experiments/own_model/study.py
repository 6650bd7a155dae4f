"""Whose error is it: the simulation's numerics, its numbers, what it left out, or what it holds that isn't there?

The user's file is stepped unchanged and scored. Every change that the diagnosis suggests is an edit of its text; those
are kept that lower the error on the fitted runs, and the error on the held-out runs is split over the four kinds by
stepping the file with every subset of kinds mended.
"""

from __future__ import annotations

import math
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.predict_file import predict_campaign
from jointscope.errors import InputError, RefusedError
from jointscope.experiments.own_model.changes import proposals
from jointscope.experiments.own_model.content import Content, read_content
from jointscope.experiments.own_model.numerics import numerics_change
from jointscope.experiments.own_model.scoring import ChannelError, channel_errors, grouped, mean_error, polarity
from jointscope.experiments.own_model.shares import shapley
from jointscope.experiments.own_model.stepping import Bench, place, renamed
from jointscope.experiments.own_model.wanted import SHARES, Change, Share, Wanted
from jointscope.experiments.own_model.xml_document import Draft, Line, Sources, read_sources
from jointscope.models.effects import augment
from jointscope.recordings.campaign import Campaign, Run
from jointscope.recordings.zeroed import zeroed
from jointscope.sim.own_model import OwnJoint, load_own
from jointscope.sim.replay_prescribed import prescribed

Real = NDArray[np.float64]
Report = Callable[[str], None]

SURE = 3.0  # standard errors by which a value must be off before it is changed
MATERIAL = 0.05  # of the error that remains with all changes, by which it must rise without one
SMALLEST = 1e-3  # of the signal: a change that gains less is none
PER_STRATUM = 2  # runs of each kind that are stepped for every variant


@dataclass(frozen=True, eq=False)
class KeptChange:
    """A change that is in the patch.

    Attributes:
        lines: What it changes.
        gain_alone: Held-out error of the unchanged file less that of the file with this change only [-].
    """

    change: Change
    lines: tuple[Line, ...]
    gain_alone: float


@dataclass(frozen=True, eq=False)
class OwnModelStudy:
    """A user's model against a campaign.

    Attributes:
        model: Its file.
        joint: Which joint is which.
        sources: Its text.
        content: What it holds of the joint.
        runs: Ids of the runs on which errors are given; held out where ``held_out``.
        error: Of the unchanged file [-]; ``remaining`` with the patch (and the laws of effects.json).
        patched: With the patch's text alone, no law beside it [-].
        shares: Of error - remaining, by kind; all four.
        kept: Changes in the patch.
        dropped: Keys of changes that were tried and gain nothing.
        texts: The files with all changes.
        unchanged, changed: Channel by channel.
        notes: What the reader must know.
    """

    model: Path
    joint: OwnJoint
    sources: Sources
    content: Content
    runs: tuple[str, ...]
    held_out: bool
    error: float
    remaining: float
    patched: float
    shares: dict[Share, float]
    kept: tuple[KeptChange, ...]
    dropped: tuple[str, ...]
    texts: tuple[bytes, ...]
    unchanged: tuple[ChannelError, ...]
    changed: tuple[ChannelError, ...]
    notes: tuple[str, ...]


def study_own_model(
    campaign: Campaign,
    answer: Mapping[str, Any],
    model: Mapping[str, Any],
    file: Path,
    joint: OwnJoint,
    *,
    workers: int = 2,
    report: Report = lambda _: None,
) -> OwnModelStudy:
    """Score a user's model, find what must change in its file, and split its error.

    Args:
        campaign: The recordings.
        answer: Their ``diagnosis.json``.
        model: Their diagnosis' ``model.json``.
        file: The user's MJCF or URDF.
        joint: Which joint is which in it.
        workers: Runs stepped at a time.
        report: Told of every stage.

    Raises:
        InputError: The file or a name in it can't be used.
        RefusedError: No run of the campaign can be stepped.
    """
    report("reading your model")
    campaign, _ = zeroed(campaign)  # as the diagnosis took it
    sources = read_sources(file)
    content = _content(campaign, file, joint)
    wanted = wanted_of(campaign, answer, model)
    bench = Bench(campaign, augment(model).description, workers)
    fitted, judged, held_out = _runs(campaign, answer)
    # in the model's own signs, which the user's has too
    predictions = predict_campaign({**model, "sensors": ()}, campaign)
    trusted = [
        (run, {s.channel.column: np.asarray(y) for s, y in predictions.get(run.id, [])}) for run in campaign.runs
    ]
    signs = polarity(trusted)
    with tempfile.TemporaryDirectory(prefix="jointscope-") as folder:
        variants = _Variants(sources, joint, bench, signs, Path(folder))
        proposed, notes = proposals(content, wanted, Draft(sources))
        report("stepping it unchanged, and with finer steps")
        step = numerics_change(sources, content, lambda edits, runs: variants.outputs(edits, runs), fitted)
        proposed = [*([step] if step else []), *(c for c in proposed if c.sigmas > SURE)]
        report(f"trying {len(proposed)} changes on {len(fitted)} fitted runs")
        kept, dropped = _kept(proposed, lambda chosen: variants.error(chosen, fitted, laws=True))
        report(f"splitting the error on {len(judged)} runs over {len(kept)} changes")
        kinds = [k for k in SHARES if any(c.share == k for c in kept)]
        if "left-out" not in kinds and variants.has_laws:
            kinds.append("left-out")

        def mended(chosen: frozenset[str]) -> float:
            return variants.error([c for c in kept if c.share in chosen], judged, laws="left-out" in chosen)

        split = shapley(kinds, mended)
        unchanged = variants.errors([], judged, laws=False)
        changed = variants.errors(kept, judged, laws="left-out" in kinds)
        before = mean_error(unchanged)
        lines = [KeptChange(c, variants.lines(c), before - variants.error([c], judged, laws=False)) for c in kept]
        if "left-out" in kinds and variants.has_laws and not variants.can_act(kept):
            notes.append("a law of effects.json can't act on this model's own names: it is not stepped here")
        return OwnModelStudy(
            model=Path(file), joint=joint, sources=sources, content=content, runs=tuple(r.id for r in judged),
            held_out=held_out, error=before, remaining=mean_error(changed),
            patched=variants.error(kept, judged, laws=False),
            shares={k: split.get(k, 0.0) for k in SHARES}, kept=tuple(lines),
            dropped=tuple(c.key for c in dropped), texts=variants.texts(kept), unchanged=unchanged, changed=changed,
            notes=tuple(dict.fromkeys(notes)),
        )  # fmt: skip


def _content(campaign: Campaign, file: Path, joint: OwnJoint) -> Content:
    angle = campaign.runs[0].arm_angle
    two = campaign.rig.topology == "two-inertia"
    return read_content(load_own(file), joint, two=two, angle=angle, ratio=campaign.rig.reduction_ratio or 1.0)


def wanted_of(campaign: Campaign, answer: Mapping[str, Any], model: Mapping[str, Any]) -> Wanted:
    """What a diagnosis asks of a model."""
    public = {"inertia": "load_inertia", "damping_total": "damping"}
    intervals = {}
    for name, parameter in answer["parameters"].items():
        low, high = parameter["interval95"]
        if low is not None and high is not None:
            intervals[public.get(name, name)] = (float(low), float(high))
    found = {(e["effect"], e["location"]): e["parameters"] for e in answer["effects"]}
    effects = []
    for entry in model["effects"]:
        key = (entry["effect"], entry["location"])
        intervals_of = {k: v["interval95"] for k, v in found.get(key, {}).items()}
        effects.append({**entry, "intervals": intervals_of, "named": key in found})
    rig = campaign.rig
    single = rig.topology == "single-dof"
    return Wanted(
        base=model["base"], intervals=intervals, effects=tuple(effects),
        merged=frozenset({"damping"} if "damping_total" in answer["parameters"] else set()), single=single,
        vertical=rig.plane == "vertical" and rig.motion == "rotational",
        spring=not single or (rig.ground_spring if rig.ground_spring is not None else any(r.brake for r in campaign.runs)),
        ratio=rig.reduction_ratio or 1.0, efficiency=1.0 if rig.efficiency is None else rig.efficiency,
    )  # fmt: skip


def _runs(campaign: Campaign, answer: Mapping[str, Any]) -> tuple[tuple[Run, ...], tuple[Run, ...], bool]:
    """Runs to fit, runs to judge, and whether the latter were held out; a few of every kind, the strongest first."""
    possible = [run for run in campaign.runs if prescribed(run) is None and run.select(role="output")]
    if not possible:
        raise RefusedError(f"{campaign.path}: no run drives a model by force or torque, so yours can't be stepped")
    held = set(answer["held_out"]["runs"]) if answer["held_out"] else set()
    judged = [run for run in possible if run.id in held]
    fitted = [run for run in possible if run.id not in held]
    if not judged or not fitted:
        few = tuple(_few(possible))
        return few, few, False
    return tuple(_few(fitted)), tuple(_few(judged)), True


def _few(runs: Sequence[Run]) -> list[Run]:
    strata: dict[tuple[str, bool], list[Run]] = {}
    for run in runs:
        strata.setdefault((run.experiment, run.brake), []).append(run)
    found = []
    for members in strata.values():
        members = sorted(members, key=_level)
        picks = {len(members) - 1, (len(members) - 1) // 2} if len(members) > 1 else {0}
        found += [members[k] for k in sorted(picks)][-PER_STRATUM:]
    return found


def _level(run: Run) -> float:
    """RMS of what was recorded of the run's outputs, enough to sort takes of one kind."""
    return max(float(np.nanstd(s.samples)) for s in run.select(role="output"))


def _kept(proposed: list[Change], error: Callable[[Sequence[Change]], float]) -> tuple[list[Change], list[Change]]:
    """Changes whose absence from the full set costs more than chance; the rest."""
    if not proposed:
        return [], []
    full = error(proposed)
    needed = max(SMALLEST, MATERIAL * full)
    kept = list(proposed)
    cost = {id(c): error([o for o in kept if o is not c]) - full for c in kept}
    weak = sorted((c for c in kept if cost[id(c)] < needed), key=lambda c: cost[id(c)])
    for change in weak:  # two that can stand for each other both look weak: take them away one by one
        rest = [c for c in kept if c is not change]
        if error(rest) - error(kept) < needed:
            kept = rest
    return kept, [c for c in proposed if c not in kept]


@dataclass(eq=False)
class _Variants:
    """Errors of the file under subsets of changes, each stepped once."""

    sources: Sources
    joint: OwnJoint
    bench: Bench
    signs: Mapping[Any, float]
    folder: Path
    known: dict[Any, tuple[ChannelError, ...]] = field(default_factory=dict)

    @property
    def has_laws(self) -> bool:
        return bool(self.bench.description.get("laws"))

    def draft(self, chosen: Sequence[Change]) -> Draft:
        draft = Draft(self.sources)
        for change in chosen:
            change.edit(draft)
        return draft

    def texts(self, chosen: Sequence[Change]) -> tuple[bytes, ...]:
        return self.draft(chosen).texts()

    def lines(self, change: Change) -> tuple[Line, ...]:
        return tuple(self.draft([change]).lines)

    def _placed(self, chosen: Sequence[Change], *, laws: bool) -> tuple[Path, OwnJoint]:
        folder = self.folder / f"v{len(list(self.folder.iterdir()))}"
        main = place(self.sources, self.texts(chosen), folder)
        joint = next((c.joint for c in chosen if c.joint is not None), self.joint)
        return main, renamed(main, joint) if laws and self.has_laws else joint

    def can_act(self, chosen: Sequence[Change]) -> bool:
        """Whether every law of effects.json finds its coordinates in this model."""
        main, joint = self._placed(chosen, laws=True)
        return len(self.bench.laws(load_own(main), joint)) == len(self.bench.description.get("laws", []))

    def outputs(
        self, chosen: Sequence[Change], runs: Sequence[Run], *, laws: bool = False
    ) -> list[dict[str, Real]]:
        main, joint = self._placed(chosen, laws=laws)
        return self.bench.step(load_own(main), joint, runs, effects=laws)

    def errors(
        self, chosen: Sequence[Change], runs: Sequence[Run], *, laws: bool | None = None
    ) -> tuple[ChannelError, ...]:
        laws = any(c.share == "left-out" for c in chosen) if laws is None else laws
        laws = laws and self.has_laws
        key = (frozenset(c.key for c in chosen), tuple(r.id for r in runs), laws)
        if key not in self.known:
            made = self.outputs(chosen, runs, laws=laws)
            self.known[key] = tuple(
                e for run, y in zip(runs, made, strict=True) for e in channel_errors(run, y, self.signs)
            )
        return self.known[key]

    def error(self, chosen: Sequence[Change], runs: Sequence[Run], *, laws: bool | None = None) -> float:
        value = mean_error(self.errors(chosen, runs, laws=laws))
        if math.isnan(value):
            raise InputError(
                self.sources.files[0], None, "none of its outputs could be scored against the recordings"
            )
        return value


def simulation_json(study: OwnModelStudy) -> dict[str, Any]:
    """``simulation`` of ``diagnosis.json``."""
    return {
        "kind": "model",
        "model": study.model.name,
        "runs": list(study.runs),
        "held_out": study.held_out,
        "error": study.error,
        "remaining": study.remaining,
        "patched_error": study.patched,
        "shares": {
            "numerics": study.shares["numerics"], "parameters": study.shares["parameters"],
            "left_out": study.shares["left-out"], "contradicted": study.shares["contradicted"],
        },
        "by_experiment": {"unchanged": grouped(study.unchanged), "changed": grouped(study.changed)},
        "changes": [
            {
                "key": k.change.key, "share": k.change.share.replace("-", "_"), "reason": k.change.reason,
                "interval95": None if k.change.interval is None else [float(v) for v in k.change.interval],
                "gain_alone": k.gain_alone,
                "lines": [
                    {"file": row.file, "line": row.line, "element": row.element, "attribute": row.attribute,
                     "old": row.old, "new": row.new} for row in k.lines
                ],
            }
            for k in study.kept
        ],
        "tried_without_gain": list(study.dropped),
        "model_values": {
            name: None if not math.isfinite(value) else value for name, value in study.content.values.items()
        },
        "notes": list(study.notes),
    }  # fmt: skip
