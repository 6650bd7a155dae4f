"""Offsets of channels that read zero at rest, taken off: what an amplifier adds is no motion and no force."""

from __future__ import annotations

from dataclasses import replace

from jointscope.recordings.campaign import Campaign, Run
from jointscope.recordings.quality_rest import at_rest, rest_level, settles_later


def zeroed(campaign: Campaign) -> tuple[Campaign, tuple[str, ...]]:
    """The campaign with certain offsets subtracted, and one line for each.

    A channel whose ac coupling was still charging keeps its samples: that is no constant.
    """
    lines: list[str] = []
    runs = tuple(_zeroed_run(campaign, run, lines) for run in campaign.runs)
    return (replace(campaign, runs=runs), tuple(lines)) if lines else (campaign, ())


def _zeroed_run(campaign: Campaign, run: Run, lines: list[str]) -> Run:
    levels = {}
    for signal in run.signals:
        if signal.channel.samples is None or signal.channel.quantity == "frf":
            continue
        level = rest_level(run, signal, campaign.rig)
        if level is not None and not settles_later(signal, level):
            levels[id(signal.channel)] = level
            lines.append(
                f"{signal.channel.quantity} at the {signal.channel.location} (run {run.id}): "
                f"{at_rest(signal, level)} subtracted"
            )
    if not levels:
        return run
    streams = tuple(
        replace(
            stream,
            channels=tuple(
                replace(c, samples=c.samples - levels[id(c)], taken_off=levels[id(c)])
                if id(c) in levels and c.samples is not None
                else c
                for c in stream.channels
            ),
        )
        for stream in run.streams
    )
    return replace(run, streams=streams)
