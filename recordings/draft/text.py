"""A drafted campaign as commented TOML: every guess with its reason in the line above or behind it."""

from __future__ import annotations

from collections.abc import Sequence

from jointscope.recordings.campaign import FORMAT
from jointscope.recordings.draft.guesses import Draft
from jointscope.recordings.draft.runs import RunDraft
from jointscope.recordings.toml_text import value_text

_HEAD = """# Drafted by `jointscope new`. Lines marked "# GUESSED: ..." are assumptions: check them, then remove the mark.
# Nameplate values may be added under [rig]: reduction_ratio, motor_inertia, reducer_inertia, arm_mass,
# arm_com_radius, efficiency, torque_constant, pole_pairs; what is left out is identified or named as unknown.
"""


def draft_text(title: str, rig: Draft, runs: Sequence[RunDraft], unplaced: Sequence[str]) -> str:
    """The whole ``campaign.toml``."""
    lines = [_HEAD, f"format = {value_text(FORMAT)}", f"title  = {value_text(title)}", "", "[rig]", *_table(rig)]
    for run in runs:
        lines += ["", "[[run]]", *_table(run.keys)]
        for stream, channels in run.streams:
            lines += ["", "[[run.stream]]", *_table(stream), "channels = ["]
            for channel in channels:
                lines += [
                    f"  # GUESSED: {key} = {value_text(channel.values[key])}, {why}"
                    for key, why in channel.guessed.items()
                ]
                lines.append(f"  {value_text(channel.values)},")
            lines.append("]")
    if unplaced:
        lines += ["", "# columns that are in the files, and that nothing said the meaning of:"]
        lines += [f"#   {name}" for name in unplaced]
    return "\n".join(lines) + "\n"


def _table(draft: Draft) -> list[str]:
    return [
        f"{key} = {value_text(value)}" + (f"  # GUESSED: {draft.guessed[key]}" if key in draft.guessed else "")
        for key, value in draft.values.items()
    ]
