"""What one run leaves open, settled by the others: a channel that is wired or scaled wrongly is so wherever it was used.

A sweep whose torque and motor angle are both off can be put right by a factor on either; a motion with a speed command
says which. So mistakes that leave a run without any contradiction are tried, all together, on the runs that keep one.
"""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from jointscope.identification.quality_factors import (
    Build,
    Correction,
    badness,
    correction_finding,
    factor_search,
    mended,
)
from jointscope.recordings.campaign import Channel, Nameplate, Run
from jointscope.recordings.finding import Finding

Key = tuple[object, ...]
_SETTLED = 1e-9


@dataclass(frozen=True, eq=False)
class Outcome:
    """What the relations of one run say of its channels.

    Attributes:
        run: As recorded.
        found: Findings.
        mended: The run as it would be with all of them put right.
        corrections: What was put right.
        left: Contradictions that remain (soft ones count half).
    """

    run: Run
    found: tuple[Finding, ...]
    mended: Run
    corrections: tuple[Correction, ...]
    left: float


def first_look(run: Run, rig: Nameplate, build: Build) -> Outcome:
    """One run by itself."""
    found, after, corrections = factor_search(run, rig, build)
    return Outcome(run, tuple(found), after, tuple(corrections), badness(build(after)))


def settled(outcomes: Sequence[Outcome]) -> Mapping[Key, tuple[float, str]]:
    """Per channel the correction that leaves most runs without a contradiction, and its name."""
    votes: dict[Key, Counter[tuple[float, str]]] = defaultdict(Counter)
    for outcome in outcomes:
        if outcome.left <= _SETTLED:
            for correction in outcome.corrections:
                for signal in correction.signals:
                    votes[_key(signal.channel)][correction.factor, correction.name] += 1
    return {key: count.most_common(1)[0][0] for key, count in votes.items()}


def second_look(outcome: Outcome, known: Mapping[Key, tuple[float, str]], rig: Nameplate, build: Build) -> Outcome:
    """The run with what others have settled put right first, where that leaves fewer contradictions."""
    if outcome.left <= _SETTLED:
        return outcome
    corrections = [
        Correction((signal,), factor, 0.0, name)
        for signal in outcome.run.signals
        if signal.channel.samples is not None and _key(signal.channel) in known
        for factor, name in (known[_key(signal.channel)],)
    ]
    corrections = _needed(outcome.run, corrections, build)
    if not corrections:
        return outcome
    before, run = build(outcome.run), outcome.run
    found = []
    for correction in corrections:
        found.append(correction_finding(outcome.run, correction.signals[0], correction, before, rig))
        run = mended(run, correction)
    more, run, further = factor_search(run, rig, build)
    left = badness(build(run))
    if left >= outcome.left:
        return outcome
    return Outcome(outcome.run, (*found, *more), run, (*corrections, *further), left)


def _needed(run: Run, corrections: Sequence[Correction], build: Build) -> list[Correction]:
    """Of corrections that act together those whose absence would leave a contradiction."""

    def left(chosen: Sequence[Correction]) -> float:
        after = run
        for correction in chosen:
            after = mended(after, correction)
        return badness(build(after))

    best = left(corrections)
    kept = list(corrections)
    for correction in corrections:
        without = [other for other in kept if other is not correction]
        if left(without) <= best:
            kept = without
    return kept


def _key(channel: Channel) -> Key:
    """What makes a channel of two runs the same one: its column and everything that is declared of it."""
    c = channel
    return (
        c.column, c.quantity, c.unit, c.location, c.role, c.radius, c.direction, c.coupling, c.scale, c.sensitivity,
        c.counts_per_turn, c.side, c.per, c.joint, c.site,
    )  # fmt: skip
