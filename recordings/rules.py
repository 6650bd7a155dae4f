"""What the keys of a ``campaign.toml`` must mean together; the keys one by one are in ``schema``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, Final

from jointscope.errors import CampaignError
from jointscope.recordings.campaign import Quantity
from jointscope.recordings.schema import channel_key, run_key
from jointscope.recordings.units import advice, required_key, units_for

Table = Mapping[str, Any]

_EVERYWHERE = ("base", "neighbour")
ROTATIONAL_PLACES: Final[dict[str, tuple[str, ...]]] = {
    "force": ("arm", *_EVERYWHERE),
    "torque": ("arm", "motor"),
    "phase-current": ("motor",),
    "current": ("motor",),
    "voltage": ("motor",),
    "linear-acceleration": ("arm", *_EVERYWHERE),
    "angular-acceleration": ("motor", "arm", *_EVERYWHERE),
    "angle": ("motor", "arm", *_EVERYWHERE),
    "angular-velocity": ("motor", "arm", *_EVERYWHERE),
    "speed-command": ("motor",),
    "frf": ("arm", "motor", *_EVERYWHERE),
}
TRANSLATIONAL_PLACES: Final[dict[str, tuple[str, ...]]] = {
    "force": ("load", "motor"),
    "phase-current": ("motor",),
    "current": ("motor",),
    "voltage": ("motor",),
    "speed-command": ("motor",),
    "position": ("load", "motor"),
    "velocity": ("load", "motor"),
    "acceleration": ("load", "motor", "base"),
    "frf": ("load", "motor"),
    # a motor that turns a screw or a pinion: n is its angle per metre
    "torque": ("motor",),
    "angle": ("motor",),
    "angular-velocity": ("motor",),
    "angular-acceleration": ("motor",),
}
_TURNING: Final = ("torque", "angle", "angular-velocity", "angular-acceleration")
_KEYS_OF: Final[dict[str, tuple[str, ...]]] = {
    "direction": ("linear-acceleration",),
    "side": ("torque",),
    "per": ("current", "phase-current"),
    "form": ("frf",),
    "averages": ("frf",),
    "coherence": ("frf",),
    "reference_radius": ("frf",),
}


def check_meaning(document: Table, file: Path) -> None:
    """Check what single keys can't show: units against quantities, places, radii, references between keys.

    Raises:
        CampaignError: The first break, as one line naming ``file``, the key, its value and the way out.
    """
    rig = document["rig"]
    _check_model(document, file)
    seen: dict[str, int] = {}
    for number, run in enumerate(document["run"]):
        where = run_key(run, number)
        if run["id"] in seen:
            raise CampaignError(
                file, f"run[{number}].id", "used by another run", value=run["id"], fix="ids are unique"
            )
        seen[run["id"]] = number
        _check_run(run, rig, document, file, where)
        for index, stream in enumerate(run["stream"]):
            inside = f"{where}.stream[{index}]"
            _check_stream(stream, file, inside)
            for position, channel in enumerate(stream["channels"]):
                _check_channel(channel, rig, file, f"{inside}.{channel_key(channel, position)}")


def _is_file(path: Path) -> bool:
    """Whether there is such a file; a name that no file can have has none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def arm_joints(document: Table) -> tuple[str, ...]:
    """The joints an arm campaign names, in ``[model]`` or ``[rig]``."""
    return tuple(document.get("model", {}).get("joints", document["rig"].get("joints", ())))


def _check_model(document: Table, file: Path) -> None:
    model, topology = document.get("model"), document["rig"]["topology"]
    if topology != "arm":
        if model is not None:
            raise CampaignError(
                file, "model", "only an arm has one", value=dict(model), fix="topology = 'arm', or drop it"
            )
        return
    if not model or ("mjcf" in model) == ("urdf" in model):
        raise CampaignError(
            file, "model", "an arm needs its model", fix="[model] with mjcf = '...' or urdf = '...'"
        )
    for key in ("mjcf", "urdf"):
        if key in model and not _is_file(file.parent / model[key]):
            raise CampaignError(
                file, f"model.{key}", "no such file", value=model[key], fix="a path inside the campaign"
            )


def _check_run(run: Table, rig: Table, document: Table, file: Path, where: str) -> None:
    arm = rig["topology"] == "arm"
    gravity = rig["motion"] == "rotational" and rig.get("plane", "vertical") == "vertical"
    if gravity and not arm and "arm_angle" not in run:
        raise CampaignError(
            file, f"{where}.arm_angle", "missing", fix="rad from the horizontal; or say rig.plane = 'horizontal'"
        )
    known = arm_joints(document)
    named = [("joint", run["joint"])] if "joint" in run else []
    named += [("posture", name) for name in run.get("posture", {})]
    named += [("hold", name) for name in run["hold"]] if isinstance(run.get("hold"), dict) else []
    for key, name in named:
        if known and name not in known:
            raise CampaignError(
                file, f"{where}.{key}", "no such joint", value=name, fix=f"known: {', '.join(known)}"
            )
    _check_columns(run, file, where)


def _check_columns(run: Table, file: Path, where: str) -> None:
    """Columns are unique within a run; streams that cut several windows from one file repeat none either."""
    seen: dict[str, str] = {}
    for index, stream in enumerate(run["stream"]):
        for channel in stream["channels"]:
            column = channel["column"]
            if column in seen:
                raise CampaignError(
                    file, f"{where}.stream[{index}].channels[{column}].column", "named twice in this run",
                    value=column, fix="column names are unique within a run",
                )  # fmt: skip
            seen[column] = stream["file"]
        if "sync" in stream and stream["sync"] not in [c["column"] for c in stream["channels"]]:
            raise CampaignError(
                file, f"{where}.stream[{index}].sync", "not a channel of this stream", value=stream["sync"],
                fix="name the column that both devices recorded",
            )  # fmt: skip


def _check_stream(stream: Table, file: Path, where: str) -> None:
    frf = [channel["quantity"] == "frf" for channel in stream["channels"]]
    if any(frf) and not all(frf):
        raise CampaignError(
            file, f"{where}.channels", "FRFs and time data in one stream", fix="give each its own stream"
        )
    if not any(frf) and "sampling_rate" not in stream:
        raise CampaignError(file, f"{where}.sampling_rate", "missing", fix="it is required [Hz]")
    if not any(frf) and "frequency" in stream:
        raise CampaignError(
            file, f"{where}.frequency", "only FRFs have one", value=stream["frequency"], fix="drop it"
        )
    if stream.get("start") == "unknown" and "start_uncertainty" in stream:
        raise CampaignError(
            file, f"{where}.start_uncertainty", "said beside start = 'unknown'", value=stream["start_uncertainty"],
            fix="give start in seconds with its uncertainty, or 'unknown' alone",
        )  # fmt: skip
    path = Path(stream["file"])
    if path.is_absolute() or ".." in path.parts:
        raise CampaignError(
            file, f"{where}.file", "outside the campaign", value=stream["file"], fix="a relative path"
        )
    if not _is_file(file.parent / path):
        raise CampaignError(
            file, f"{where}.file", "no such file", value=stream["file"], fix=f"it is sought in {file.parent}"
        )


def _check_channel(channel: Table, rig: Table, file: Path, where: str) -> None:
    quantity, unit, location = channel["quantity"], channel["unit"], channel["location"]
    places = ROTATIONAL_PLACES if rig["motion"] == "rotational" else TRANSLATIONAL_PLACES
    if quantity not in places:
        raise CampaignError(
            file, f"{where}.quantity", f"not measured on a {rig['motion']} rig", value=quantity,
            fix=f"one of {', '.join(places)}, or correct rig.motion",
        )  # fmt: skip
    if location not in places[quantity]:
        raise CampaignError(
            file, f"{where}.location", f"{quantity} is not measured there", value=location,
            fix=f"{' | '.join(places[quantity])}",
        )  # fmt: skip
    if rig["motion"] == "translational" and quantity in _TURNING:
        _check_screw(channel, rig, file, where)
    _check_unit(channel, file, where, quantity, unit)
    if quantity == "speed-command" and unit == "m/s":
        _check_slide(rig, file, where)
    for key, quantities in _KEYS_OF.items():
        if key in channel and quantity not in quantities:
            raise CampaignError(
                file, f"{where}.{key}", f"has no meaning for {quantity}", value=channel[key],
                fix=f"it belongs to {' and '.join(quantities)}",
            )  # fmt: skip
    if quantity == "speed-command" and channel["role"] != "input":
        raise CampaignError(
            file, f"{where}.role", "a command is an input", value=channel["role"], fix="role = 'input'"
        )
    if channel.get("side") == "output" and "reduction_ratio" not in rig and rig["topology"] != "arm":
        raise CampaignError(
            file,
            f"{where}.side",
            "needs the ratio to the motor shaft",
            value="output",
            fix="give rig.reduction_ratio",
        )
    if channel.get("coupling") == "ac" and "low_cutoff" not in channel:
        raise CampaignError(
            file,
            f"{where}.low_cutoff",
            "missing",
            fix="an ac coupling has a first-order high-pass: give its corner [Hz]",
        )
    placed = any(key in channel for key in ("radius", "site", "point"))
    lever = quantity in ("force", "linear-acceleration") and location == "arm"
    if lever and rig["motion"] == "rotational" and not placed:
        raise CampaignError(
            file,
            f"{where}.radius",
            "missing",
            fix=f"a {quantity} on a rotational rig needs its distance from the axis [m]",
        )
    if "point" in channel and "body" not in channel and rig["topology"] == "arm":
        raise CampaignError(file, f"{where}.body", "missing", fix="a point is given in the frame of a body")


def _check_screw(channel: Table, rig: Table, file: Path, where: str) -> None:
    """What turns on a rig that slides is a motor's shaft, a known angle to the metre."""
    if "reduction_ratio" not in rig:
        raise CampaignError(
            file, f"{where}.quantity", "needs the motor's angle per metre", value=channel["quantity"],
            fix="give rig.reduction_ratio [rad/m], or the channel as a force or position of the slide",
        )  # fmt: skip
    if channel.get("side") == "output":
        raise CampaignError(
            file, f"{where}.side", "the output of a translational rig slides", value="output",
            fix="quantity = 'force' for what acts on the slide",
        )  # fmt: skip


def _check_slide(rig: Table, file: Path, where: str) -> None:
    """A command in m/s is the slide's own, and its motor's where that is counted in metres too."""
    if rig["motion"] != "translational" or rig.get("reduction_ratio", 1.0) != 1.0:
        raise CampaignError(
            file, f"{where}.unit", "this motor is not counted in metres", value="m/s",
            fix="write 'rad/s' or 'rpm'; 'm/s' is for rig.motion = 'translational' with a reduction_ratio of 1",
        )  # fmt: skip


def _check_unit(channel: Table, file: Path, where: str, quantity: Quantity, unit: str) -> None:
    form = channel.get("form")
    if quantity == "frf" and form is None:
        raise CampaignError(file, f"{where}.form", "missing", fix="accelerance | mobility | receptance")
    if unit not in units_for(quantity, form):
        raise CampaignError(
            file, f"{where}.unit", f"does not fit {quantity}", value=unit, fix=advice(quantity, unit, form)
        )
    needed = required_key(quantity, unit)
    if needed and needed not in channel:
        raise CampaignError(file, f"{where}.{needed}", "missing", fix=f"unit = {unit!r} has no scale without it")
    for key, units in _SCALING.items():
        if key in channel and unit not in units:
            raise CampaignError(
                file, f"{where}.{key}", f"has no meaning with unit = {unit!r}", value=channel[key],
                fix=f"it goes with unit = {' or '.join(repr(u) for u in units)}",
            )  # fmt: skip


_SCALING: Final = {
    "scale": ("1",),
    "sensitivity": ("mV",),
    "counts_per_turn": ("counts",),
}
