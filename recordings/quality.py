"""What the recordings show by themselves, one channel at a time: no model, no other channel.

Findings that need a frequency response or the mechanics of the joint are in ``identification.quality``.
"""

from __future__ import annotations

from collections.abc import Iterator

from jointscope.recordings.campaign import Campaign, Run, Signal
from jointscope.recordings.finding import NAMES, Finding
from jointscope.recordings.quality_hammer import hammer_findings
from jointscope.recordings.quality_levels import level_findings
from jointscope.recordings.quality_rest import rest_findings
from jointscope.recordings.quality_samples import sample_findings
from jointscope.recordings.quality_speeds import speed_findings
from jointscope.recordings.quality_units import arm_angle_findings, label_findings

__all__ = ["NAMES", "Finding", "recorded_findings"]


def recorded_findings(campaign: Campaign) -> list[Finding]:
    """Findings of every run, in the order of runs and channels. FRF streams and absent columns have none."""
    return [finding for run in campaign.runs for finding in _of_run(run, campaign)]


def _of_run(run: Run, campaign: Campaign) -> Iterator[Finding]:
    yield from arm_angle_findings(run)
    yield from speed_findings(run)
    for signal in run.signals:
        if signal.channel.samples is None or signal.channel.quantity == "frf":
            continue
        yield from _of_signal(run, signal, campaign)
    if run.experiment == "hammer":
        yield from hammer_findings(run)


def _of_signal(run: Run, signal: Signal, campaign: Campaign) -> Iterator[Finding]:
    yield from label_findings(run, signal)
    dead = list(level_findings(run, signal))
    yield from dead
    if any(finding.finding == "dead-channel" for finding in dead):
        return
    yield from sample_findings(run, signal)
    yield from rest_findings(run, signal, campaign.rig)
