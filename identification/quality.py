"""What is wrong with the recordings, before any fit: what channels show alone, and where they contradict each other.

Channels that share a run must agree with each other, with gravity and with the nameplate. Where they don't, and one
factor known from unit and wiring mistakes would make them agree, that factor is named with the line to paste.
Nothing is corrected.
"""

from __future__ import annotations

import math
from collections import Counter
from dataclasses import replace

import numpy as np

from jointscope.identification.quality_clocks import clock_findings
from jointscope.identification.quality_coherence import coherence_findings
from jointscope.identification.quality_factors import OFF_BY, Build
from jointscope.identification.quality_gravity import gravity_findings, static_relations
from jointscope.identification.quality_relation import Relation
from jointscope.identification.quality_relations import across, run_relations
from jointscope.identification.quality_wiring import Outcome, first_look, second_look, settled
from jointscope.recordings.campaign import Campaign, Run, Signal
from jointscope.recordings.finding import Finding
from jointscope.recordings.quality import recorded_findings
from jointscope.recordings.quality_units import SPINS, arm_angle_findings

_ALIKE = 1.35  # between the largest and the smallest factor by which a channel is off in its runs
_FASTEST = 1500.0  # rad/s of a motor, 14 000 rpm
_AGREED = 0.75  # of the runs in which a channel's scale looks wrong


def findings(campaign: Campaign) -> list[Finding]:
    """Everything ``inspect`` reports: findings of single channels, then those of channels against each other.

    Arms with several joints get the former only: what their channels owe each other needs the arm's model.
    """
    found = recorded_findings(campaign)
    if campaign.rig.topology != "arm":
        found = _vouched(found, campaign)
        found += _agreed(_of_runs(campaign, found))
        found += coherence_findings(campaign)
    return _without_repeats(found, campaign)


def _vouched(found: list[Finding], campaign: Campaign) -> list[Finding]:
    """Without turns of an arm that its motor makes too, at a motor's speed: a shaft may spin, where an arm may not."""
    spun = {f.run for f in found if f.finding == "suspicious-unit" and SPINS in f.detail}
    vouched = {
        (run.id, party.signal.channel.column)
        for run in campaign.runs
        if run.id in spun
        for relation in across(run, campaign.rig)
        if relation.holds() and all(_of_a_motor(p.signal) for p in relation.parties)
        for party in relation.parties
    }
    return [f for f in found if SPINS not in f.detail or (f.run, f.channel) not in vouched]


def _of_a_motor(signal: Signal) -> bool:
    """Whether it turns no faster than motors do: where both encoders' degrees are called radians, a gear's motor would."""
    x = np.nan_to_num(signal.samples)
    speed = np.gradient(x) * signal.sampling_rate if signal.channel.quantity == "angle" else x
    return float(np.percentile(np.abs(speed), 99.0)) < _FASTEST


def _agreed(found: list[Finding]) -> list[Finding]:
    """Without scales that every run would have otherwise: a wrong unit is the same one in all runs, by the same factor."""
    said: dict[str, Counter[str | None]] = {}
    factors: dict[str, list[float]] = {}
    for finding in found:
        if finding.finding == "suspicious-unit":
            said.setdefault(finding.channel, Counter())[finding.toml] += 1
            if finding.detail.startswith(OFF_BY):
                factors.setdefault(finding.channel, []).append(
                    float(finding.detail.removeprefix(OFF_BY).split()[0])
                )
    unlike = {c for c, n in said.items() if n.total() > 2 and n.most_common(1)[0][1] < _AGREED * n.total()}
    unlike |= {c for c, sizes in factors.items() if len(sizes) > 1 and max(sizes) > _ALIKE * min(sizes)}
    return [f for f in found if f.finding != "suspicious-unit" or f.channel not in unlike]


def _of_runs(campaign: Campaign, known: list[Finding]) -> list[Finding]:
    builds = {run.id: _relations_of(run, campaign, known) for run in campaign.runs}
    outcomes = [first_look(_in_radians(run), campaign.rig, builds[run.id]) for run in campaign.runs]
    wiring = settled(outcomes)
    found: list[Finding] = []
    for outcome in outcomes:
        found += _of_outcome(
            second_look(outcome, wiring, campaign.rig, builds[outcome.run.id]),
            campaign,
            _dead(outcome.run.id, known),
        )
    return found


def _of_outcome(outcome: Outcome, campaign: Campaign, unusable: set[str]) -> list[Finding]:
    named = {finding.channel for finding in outcome.found}
    return [
        *outcome.found,
        *gravity_findings(outcome.mended, campaign.rig, named),
        *clock_findings(outcome.mended, campaign.rig, unusable),
    ]


def _relations_of(run: Run, campaign: Campaign, known: list[Finding]) -> Build:
    unusable = _dead(run.id, known)

    def relations(run: Run) -> list[Relation]:
        made = [*run_relations(run, campaign.rig), *static_relations(run, campaign.rig)]
        return [r for r in made if not any(p.signal.channel.column in unusable for p in r.parties)]

    return relations


def _dead(run: str, known: list[Finding]) -> set[str]:
    return {f.channel for f in known if f.run == run and f.finding == "dead-channel"}


def _in_radians(run: Run) -> Run:
    return replace(run, arm_angle=math.radians(run.arm_angle)) if any(arm_angle_findings(run)) else run


def _without_repeats(found: list[Finding], campaign: Campaign) -> list[Finding]:
    """One finding of a name per channel and run, the one with a line to paste first; in the order of the runs."""
    order = {run.id: place for place, run in enumerate(campaign.runs)}
    kept: dict[tuple[str, str, str], Finding] = {}
    for finding in found:
        key = (finding.finding, finding.run, finding.channel)
        if key not in kept or (kept[key].toml is None and finding.toml is not None):
            kept[key] = finding
    return sorted(kept.values(), key=lambda finding: order.get(finding.run, len(order)))
