"""A campaign as the text of its ``campaign.toml``."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import fields
from typing import Any

from jointscope.recordings.campaign import FORMAT, Campaign, Channel, Nameplate, Run, Stream

_DEFAULTS = {"direction": "tangential", "coupling": "dc", "side": "motor", "per": "peak"}


def value_text(value: object) -> str:
    """A TOML value: text, number, flag, list or inline table."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, int):
        return str(value)
    if isinstance(value, float):
        return _float_text(value)
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(map(value_text, value)) + "]"
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{key_text(k)} = {value_text(v)}" for k, v in value.items()) + " }"
    raise TypeError(f"{value!r} has no place in a campaign.toml")


def _float_text(value: float) -> str:
    if not math.isfinite(value):
        raise ValueError(f"{value!r} has no place in a campaign.toml")
    return repr(float(value))


def key_text(key: str) -> str:
    """A TOML key, quoted where it must be."""
    plain = key != "" and all(sign.isascii() and (sign.isalnum() or sign in "-_") for sign in key)
    return key if plain else value_text(key)


def channel_line(channel: Channel, **changed: object) -> str:
    """The inline table of a channel, on one line; ``changed`` replaces keys (``None`` drops one)."""
    values: dict[str, object] = {}
    for field in fields(Channel):
        value = getattr(channel, field.name)
        if (
            field.name in ("samples", "coherence", "taken_off", "file_unit")
            or value is None
            or _DEFAULTS.get(field.name) == value
        ):
            continue
        values[field.name] = list(value) if isinstance(value, tuple) else value
    values.update(changed)
    return value_text({key: value for key, value in values.items() if value is not None})


def campaign_text(campaign: Campaign, names: Mapping[tuple[str, int], str]) -> str:
    """The whole file; ``names`` gives each stream's data file by run id and place."""
    lines = [f"format = {value_text(FORMAT)}", f"title  = {value_text(campaign.title)}"]
    if campaign.notes:
        lines.append(f"notes  = {value_text(campaign.notes)}")
    lines += ["", "[rig]", *_rig_lines(campaign.rig)]
    if campaign.mjcf or campaign.urdf or campaign.joints:
        model = {"mjcf": campaign.mjcf, "urdf": campaign.urdf, "joints": list(campaign.joints) or None}
        lines += ["", "[model]", *(f"{k} = {value_text(v)}" for k, v in model.items() if v)]
    for run in campaign.runs:
        lines += ["", "[[run]]", *_run_lines(run, campaign.rig)]
        for index, stream in enumerate(run.streams):
            lines += ["", "[[run.stream]]", *_stream_lines(stream, names[run.id, index])]
    return "\n".join(lines) + "\n"


def _rig_lines(rig: Nameplate) -> list[str]:
    values = {field.name: getattr(rig, field.name) for field in fields(rig)}
    return [f"{key} = {value_text(value)}" for key, value in values.items() if value is not None]


def _run_lines(run: Run, rig: Nameplate) -> list[str]:
    values: dict[str, Any] = {"id": run.id, "experiment": run.experiment, "brake": run.brake or None}
    if rig.topology != "arm" or run.arm_angle:
        values["arm_angle"] = float(run.arm_angle)
    values |= {"repeat_of": run.repeat_of, "role": run.role, "joint": run.joint}
    values["initial"] = None if run.initial == "rest" else run.initial
    values["posture"] = dict(run.posture) or None
    if run.payload_mass is not None:
        com = {} if run.payload_com is None else {"com": list(run.payload_com)}
        values["payload"] = {"mass": run.payload_mass, **com}
    if run.hold:
        values["hold"] = run.hold[""] if set(run.hold) == {""} else dict(run.hold)
    return [f"{key} = {value_text(value)}" for key, value in values.items() if value is not None]


def _stream_lines(stream: Stream, name: str) -> list[str]:
    values: dict[str, Any] = {"file": name}
    if stream.frequency is None:
        values["sampling_rate"] = float(stream.sampling_rate)
    if math.isinf(stream.start_uncertainty):
        values["start"] = "unknown"
    elif stream.frequency is None:
        values["start"] = float(stream.start)
        values["start_uncertainty"] = float(stream.start_uncertainty) or None
    if stream.frequency is not None:
        values["frequency"] = frequency_column(stream)
    values["gaps"] = "mask" if stream.gaps == "mask" else None
    values["sync"] = stream.sync
    lines = [f"{key} = {value_text(value)}" for key, value in values.items() if value is not None]
    lines.append("channels = [")
    for channel in stream.channels:
        coherence = None if channel.coherence is None else coherence_column(channel)
        lines.append(f"  {channel_line(channel, coherence=coherence)},")
    return [*lines, "]"]


def frequency_column(stream: Stream) -> str:
    """The column that holds the frequency axis of an FRF stream."""
    names = {channel.column for channel in stream.channels}
    return "frequency" if "frequency" not in names else "frequency axis"


def coherence_column(channel: Channel) -> str:
    """The column that holds an FRF's coherence."""
    return f"coherence of {channel.column}"
