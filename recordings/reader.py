"""Read a campaign: ``campaign.toml`` checked, its data files read, every sample in SI on its device's clock."""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import CampaignError
from jointscope.recordings.campaign import Campaign, Channel, Hold, Nameplate, Run, Stream
from jointscope.recordings.files import Column, DataFile, open_data_file
from jointscope.recordings.rules import arm_joints, check_meaning
from jointscope.recordings.schema import channel_key, check_structure, run_key
from jointscope.recordings.time_stamps import on_uniform_grid
from jointscope.recordings.units import si_factor

MINIMUM_SAMPLES = 64
Table = Mapping[str, Any]
Number = TypeVar("Number", bound=np.generic)
MissingOutputs = Literal["refuse", "allow"]


def read_campaign(path: Path | str, *, missing_outputs: MissingOutputs = "refuse") -> Campaign:
    """Read and check a campaign.

    Args:
        path: The directory, or its ``campaign.toml``.
        missing_outputs: ``allow`` where only inputs are needed (prediction): an output column absent from its file
            is then a channel without samples.

    Raises:
        CampaignError: Anything that breaks the format, as one line naming file, key, value and the way out.
    """
    file = Path(path)
    file = file / "campaign.toml" if file.is_dir() else file
    document = parse_campaign(file)
    files: dict[str, DataFile] = {}
    return Campaign(
        path=file.parent,
        rig=Nameplate(**{key: value for key, value in document["rig"].items() if key != "joints"}),
        runs=tuple(
            _run(run, run_key(run, number), file, files, missing_outputs)
            for number, run in enumerate(document["run"])
        ),
        title=document.get("title", ""),
        notes=document.get("notes", ""),
        mjcf=document.get("model", {}).get("mjcf"),
        urdf=document.get("model", {}).get("urdf"),
        joints=arm_joints(document),
    )


def parse_campaign(file: Path) -> dict[str, Any]:
    """The checked contents of a ``campaign.toml``, data files unopened.

    Raises:
        CampaignError: No such file, no TOML, or a break of the format.
    """
    try:
        document = tomllib.loads(file.read_text(encoding="utf-8"))
    except (FileNotFoundError, NotADirectoryError):
        raise CampaignError(
            file, None, "no such file", fix="a campaign is a directory with a campaign.toml"
        ) from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise CampaignError(file, None, f"not TOML: {problem}") from problem
    check_structure(document, file)
    check_meaning(document, file)
    return document


def _run(run: Table, where: str, file: Path, files: dict[str, DataFile], missing: MissingOutputs) -> Run:
    hold = run.get("hold", {})
    holds: dict[str, Hold] = {"": hold} if isinstance(hold, str) else dict(hold)
    own = holds.get(run.get("joint", ""), holds.get(""))
    brake = run.get("brake", own == "brake")
    if brake and own not in (None, "brake", "brake-with-play"):
        raise CampaignError(
            file, f"{where}.hold", "contradicts brake = true", value=own, fix="keep one of the two"
        )
    payload = run.get("payload", {})
    return Run(
        id=run["id"],
        experiment=run["experiment"],
        streams=tuple(
            _stream(stream, f"{where}.stream[{index}]", file, files, missing)
            for index, stream in enumerate(run["stream"])
        ),
        brake=brake,
        arm_angle=float(run.get("arm_angle", 0.0)),
        repeat_of=run.get("repeat_of"),
        role=run.get("role"),
        initial=run.get("initial", "rest"),
        joint=run.get("joint"),
        posture={name: float(angle) for name, angle in run.get("posture", {}).items()},
        payload_mass=payload.get("mass"),
        payload_com=_vector(payload.get("com")),
        hold=holds,
    )


def _vector(value: list[float] | None) -> tuple[float, float, float] | None:
    return None if value is None else (float(value[0]), float(value[1]), float(value[2]))


def _stream(stream: Table, where: str, file: Path, files: dict[str, DataFile], missing: MissingOutputs) -> Stream:
    path = file.parent / stream["file"]
    data = (
        files.setdefault(stream["file"], open_data_file(path))
        if stream["file"] not in files
        else files[stream["file"]]
    )
    if stream["channels"][0]["quantity"] == "frf":
        return _frf_stream(stream, where, file, data)
    columns = _columns(stream, where, file, data, missing)
    rate = float(stream["sampling_rate"])
    _check_rate(columns, rate, f"{where}.sampling_rate", file)
    raw = {name: _real(column, path) for name, column in columns.items()}
    length = next((v.size for v in raw.values()), max((c.length for c in data.columns.values()), default=0))
    stamps = _stamps(stream, where, file, data)
    start = stream.get("start", 0.0)
    jitter = 0.0
    if stamps is not None:
        length = stamps.size
        _check_lengths(raw, length, path, stream["time"])
    part = _part(stream, where, file, stamps, rate, length)
    length = part.stop - part.start
    raw = {name: values[part] for name, values in raw.items()}
    masked = stream.get("gaps") == "mask"
    if stamps is not None:
        stamps = stamps[part]
        start = stream.get("start", float(stamps[0]))
        key = f"{where}.time"
        grid = on_uniform_grid(stamps, raw, rate, masked=masked, file=path, column=stream["time"], key=key)
        raw, length, jitter = grid.samples, grid.length, grid.jitter
    for name, values in raw.items():
        _check_samples(values, masked, path, name)
    return Stream(
        file=stream["file"],
        sampling_rate=rate,
        start=0.0 if start == "unknown" else float(start),
        start_uncertainty=math.inf if start == "unknown" else float(stream.get("start_uncertainty", 0.0)),
        length=length,
        channels=tuple(_channel(channel, raw.get(channel["column"])) for channel in stream["channels"]),
        time=stream.get("time"),
        window=tuple(map(float, stream["window"])) if "window" in stream else None,  # type: ignore[arg-type]
        gaps=stream.get("gaps", "refuse"),
        sync=stream.get("sync"),
        jitter=jitter,
    )


def _columns(stream: Table, where: str, file: Path, data: DataFile, missing: MissingOutputs) -> dict[str, Column]:
    """The columns that the channels name, as far as the file has them; all of one length."""
    found: dict[str, Column] = {}
    for position, channel in enumerate(stream["channels"]):
        name = channel["column"]
        column = data.find(name)
        if column is None and (channel["role"] == "input" or missing == "refuse"):
            key = f"{where}.{channel_key(channel, position)}.column"
            raise CampaignError(file, key, f"no such column in {stream['file']}", value=name, fix=_offer(data))
        if column is not None:
            found[name] = column
    lengths = {column.length for column in found.values()}
    if len(lengths) > 1:
        shown = ", ".join(f"{name} {column.length}" for name, column in found.items())
        raise CampaignError(data.path, shown, "samples of differing number", fix="one stream per device")
    return found


def _offer(data: DataFile) -> str:
    names = list(data.columns)
    return f"it has {', '.join(names[:12])}{f' and {len(names) - 12} more' if len(names) > 12 else ''}"


def _check_rate(columns: dict[str, Column], rate: float, key: str, file: Path) -> None:
    for column in columns.values():
        if column.rate is not None and abs(column.rate / rate - 1.0) > 0.01:
            raise CampaignError(
                file,
                key,
                f"the file itself says {column.rate:.6g} Hz for {column.name}",
                value=rate,
                fix="correct one",
            )


def _real(column: Column, path: Path) -> NDArray[np.float64]:
    values = column.read()
    if np.iscomplexobj(values):
        raise CampaignError(path, column.name, "complex values in time data", fix="quantity = 'frf' takes them")
    return np.asarray(values, dtype=np.float64)


def _stamps(stream: Table, where: str, file: Path, data: DataFile) -> NDArray[np.float64] | None:
    if "time" not in stream:
        return None
    column = data.find(stream["time"])
    if column is None:
        raise CampaignError(
            file, f"{where}.time", f"no such column in {stream['file']}", value=stream["time"], fix=_offer(data)
        )
    return _real(column, data.path)


def _check_lengths(raw: dict[str, NDArray[np.float64]], length: int, path: Path, time: str) -> None:
    for name, values in raw.items():
        if values.size != length:
            raise CampaignError(path, name, f"{values.size} samples, but {time} has {length}", fix="mend the file")


def _part(
    stream: Table, where: str, file: Path, stamps: NDArray[np.float64] | None, rate: float, length: int
) -> slice:
    """Samples inside ``window``, [t0, t1) in the file's own time: its stamps, or seconds after its first sample."""
    if "window" not in stream:
        return slice(0, length)
    begin, end = stream["window"]
    if stamps is not None:
        chosen = slice(int(np.searchsorted(stamps, begin)), int(np.searchsorted(stamps, end)))
        held = (float(stamps[0]), float(stamps[-1]) + 1.0 / rate)
    else:
        chosen = slice(max(0, round(begin * rate)), min(length, round(end * rate)))
        held = (0.0, length / rate)
    slack = 1.5 / rate
    if begin < held[0] - slack or end > held[1] + slack or chosen.stop <= chosen.start:
        raise CampaignError(
            file, f"{where}.window", f"outside the file, which holds {held[0]:.6g} to {held[1]:.6g} s",
            value=list(stream["window"]), fix="choose a part inside",
        )  # fmt: skip
    return chosen


def _check_samples(values: NDArray[np.float64], masked: bool, path: Path, name: str) -> None:
    if values.size < MINIMUM_SAMPLES:
        raise CampaignError(
            path, name, f"{values.size} samples", fix=f"a channel needs at least {MINIMUM_SAMPLES}"
        )
    infinite = np.flatnonzero(np.isinf(values))
    if infinite.size:
        raise CampaignError(
            path, name, f"infinite sample {infinite[0]}", value=float(values[infinite[0]]), fix="mend it"
        )
    missing = np.flatnonzero(np.isnan(values))
    if missing.size and not masked:
        raise CampaignError(
            path, name, f"{missing.size} missing samples, the first is {missing[0]}", value=math.nan,
            fix="say gaps = 'mask' on the stream to leave them unscored",
        )  # fmt: skip
    if values.size - missing.size < MINIMUM_SAMPLES:
        raise CampaignError(
            path,
            name,
            f"{values.size - missing.size} samples that are not missing",
            fix=f"at least {MINIMUM_SAMPLES}",
        )


def _frf_stream(stream: Table, where: str, file: Path, data: DataFile) -> Stream:
    columns = _columns(stream, where, file, data, "refuse")
    frequency: NDArray[np.float64] | None = None
    if "frequency" in stream:
        axis = data.find(stream["frequency"])
        if axis is None:
            raise CampaignError(
                file, f"{where}.frequency", f"no such column in {stream['file']}", value=stream["frequency"],
                fix=_offer(data),
            )  # fmt: skip
        frequency = _real(axis, data.path)
    channels = []
    for position, channel in enumerate(stream["channels"]):
        column = columns[channel["column"]]
        own = column.frequency if frequency is None else frequency
        if own is None or own.size != column.length:
            key = f"{where}.frequency"
            raise CampaignError(
                file, key, f"no frequency axis for {column.name}", fix="name the column that holds it"
            )
        if frequency is not None and not np.array_equal(own, frequency):
            raise CampaignError(data.path, column.name, "another frequency axis", fix="one stream per axis")
        frequency = own
        values = np.asarray(column.read(), dtype=np.complex128)
        if not np.isfinite(values).all():
            bad = int(np.flatnonzero(~np.isfinite(values))[0])
            raise CampaignError(data.path, column.name, f"line {bad} is not finite", value=complex(values[bad]))
        coherence = column.coherence
        if "coherence" in channel:
            found = data.find(channel["coherence"])
            if found is None:
                key = f"{where}.{channel_key(channel, position)}.coherence"
                raise CampaignError(file, key, "no such column", value=channel["coherence"], fix=_offer(data))
            coherence = _real(found, data.path)
        averages = channel.get("averages", column.averages)
        channels.append(
            _channel({**channel, "averages": averages}, values, None if coherence is None else _frozen(coherence))
        )
    assert frequency is not None
    return Stream(
        file=stream["file"],
        sampling_rate=float(stream.get("sampling_rate", 2.0 * frequency[-1])),
        length=frequency.size,
        channels=tuple(channels),
        frequency=_frozen(frequency),
    )


def _frozen(values: NDArray[Number]) -> NDArray[Number]:
    copy = values.copy()
    copy.setflags(write=False)
    return copy


def _channel(channel: Table, raw: NDArray[Any] | None, coherence: NDArray[np.float64] | None = None) -> Channel:
    declared = {key: value for key, value in channel.items() if key not in ("point", "axis", "coherence")}
    without = Channel(
        **declared, point=_vector(channel.get("point")), axis=_vector(channel.get("axis")), coherence=coherence
    )
    if raw is None:
        return without
    samples = _frozen(raw * si_factor(without))
    return Channel(**{**_fields(without), "samples": samples})


def _fields(channel: Channel) -> dict[str, Any]:
    return {name: getattr(channel, name) for name in channel.__dataclass_fields__}
