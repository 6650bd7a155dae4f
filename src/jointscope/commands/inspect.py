"""What a campaign holds, and what is wrong with its channels, before anything is fitted to them.

Lists every run with its channels, rates and levels, and then the findings:
  single channels    clipping, overload, dead channels, offsets, gaps, held or stuck samples, jittered time stamps,
                     quantisation, mains hum, IEPE sensors not yet settled; hammer hits: double hits, pulses too short
                     for the rate, recordings that end too soon
  against gravity    static accelerometers and the holding torque against arm_angle and m g r
  against each other motor and arm angle, speeds, accelerations, commands, torque, hammer force: a reversed channel, or
                     a factor known from unit mistakes (sqrt 2, 3/2, n, n^2, 9.80665, 4.448, 2 pi, 60/2 pi, 180/pi)
                     that would make all agree, with the corrected line to paste into campaign.toml
  clocks             devices that disagree about when the same motion happened
  repeats            hits whose responses don't repeat

Nothing is corrected: findings are for you to judge.

examples:
  jointscope inspect bench
  jointscope inspect bench --json | jq .quality
"""

from __future__ import annotations

import argparse
import json
from collections import defaultdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jointscope.recordings.campaign import Campaign, Run, Signal
    from jointscope.recordings.finding import Finding


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("campaign", metavar="CAMPAIGN", type=Path, help="directory with a campaign.toml")
    parser.add_argument("--json", action="store_true", help="everything as JSON; the findings are under quality")


def run(options: argparse.Namespace) -> int:
    """Print what was found."""
    from jointscope.identification.quality import findings
    from jointscope.recordings.reader import read_campaign

    campaign = read_campaign(options.campaign, missing_outputs="allow")
    found = findings(campaign)
    if options.json:
        print(json.dumps(as_json(campaign, found), indent=2, ensure_ascii=False, allow_nan=False))
    else:
        _print_runs(campaign)
        _print_findings(found, len(campaign.runs))
    return 0


def as_json(campaign: Campaign, found: list[Finding]) -> dict[str, Any]:
    """The whole answer for machines (``jointscope-inspection/1``)."""
    return {
        "format": "jointscope-inspection/1",
        "title": campaign.title,
        "rig": {name: value for name, value in vars(campaign.rig).items() if value is not None},
        "runs": [_run_json(take) for take in campaign.runs],
        "quality": [finding.as_json() for finding in found],
    }


def _run_json(take: Run) -> dict[str, Any]:
    return {
        "id": take.id,
        "experiment": take.experiment,
        "brake": take.brake,
        "arm_angle_rad": take.arm_angle,
        "role": take.role,
        "channels": [_channel_json(signal) for signal in take.signals],
    }


def _channel_json(signal: Signal) -> dict[str, Any]:
    channel, stream = signal.channel, signal.stream
    known: dict[str, Any] = {
        "column": channel.column, "quantity": channel.quantity, "location": channel.location, "role": channel.role,
        "file": stream.file, "sampling_rate_hz": stream.sampling_rate, "samples": stream.length,
        "recorded": channel.samples is not None,
    }  # fmt: skip
    return known | _levels(signal)


def _levels(signal: Signal) -> dict[str, Any]:
    """Peak, rms about the mean, and mean, in SI."""
    import numpy as np

    from jointscope.recordings.units import si_unit

    if signal.channel.samples is None:
        return {}
    x = np.abs(signal.channel.samples) if signal.channel.quantity == "frf" else signal.samples
    return {
        "unit": si_unit(signal.channel),
        "peak": float(np.nanmax(np.abs(x))),
        "mean": float(np.nanmean(x)),
        "rms": float(np.nanstd(x)),
    }


def _print_runs(campaign: Campaign) -> None:
    rig = campaign.rig
    print(f"{campaign.path}: {campaign.title or 'no title'}")
    print(f"  {rig.topology}, {rig.motion}, {rig.plane}; {len(campaign.runs)} runs")
    for take in campaign.runs:
        held = ", brake on" if take.brake else ""
        role = f", {take.role}" if take.role else ""
        print(f"{take.id}: {take.experiment}{held}, arm at {take.arm_angle:.4g} rad{role}")
        for signal in take.signals:
            print("  " + _channel_line(signal))


def _channel_line(signal: Signal) -> str:
    channel, stream = signal.channel, signal.stream
    what = f"{channel.column:20s} {channel.quantity + ' at ' + channel.location:28s} {channel.role:6s}"
    if channel.samples is None:
        return f"{what} declared, not recorded"
    level = _levels(signal)
    unit = "" if level["unit"] == "1" else " " + level["unit"]
    if stream.frequency is not None:
        span = f"{stream.frequency[0]:.4g}-{stream.frequency[-1]:.4g} Hz, {stream.length} lines"
        return f"{what} {span}, largest {level['peak']:.4g}{unit}"
    length = (
        f"{stream.sampling_rate:.6g} Hz, {stream.length} samples, {stream.length / stream.sampling_rate:.4g} s"
    )
    return f"{what} {length}, peak {level['peak']:.4g}{unit}, rms {level['rms']:.4g}{unit}"


def _print_findings(found: list[Finding], runs: int) -> None:
    from jointscope.recordings.finding import NAMES

    if not found:
        print("no findings")
        return
    groups: dict[tuple[str, str], list[Finding]] = defaultdict(list)
    for finding in found:
        groups[finding.finding, finding.channel].append(finding)
    print(f"\n{len(groups)} finding{'s' if len(groups) > 1 else ''}:")
    for (name, channel), members in groups.items():
        where = f" {channel}" if channel else ""
        print(f"{name}{where}: {NAMES[name]}")
        for member in members[:3]:
            print(f"  {member.run}: {member.detail}")
        if len(members) > 3:
            rest = ", ".join(member.run for member in members[3:])
            everywhere = f"all {runs} runs" if len(members) == runs else f"{len(members)} runs in all, also {rest}"
            print(f"  ({everywhere})")
        line = next((member.toml for member in members if member.toml), None)
        if line:
            print(f"  if so, paste: {line}")
