"""Read a campaign: ``campaign.toml`` checked, its data files read, every sample in SI on its device's clock."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from jointscope.errors import CampaignError
from jointscope.recordings.campaign import Campaign, Nameplate, Run, Stream
from jointscope.recordings.files import DataFile, open_data_file
from jointscope.recordings.frf_stream import read_frf_stream
from jointscope.recordings.rules import arm_joints, check_meaning
from jointscope.recordings.schema import check_structure, run_key
from jointscope.recordings.stream_columns import MissingOutputs, Table, vector
from jointscope.recordings.time_stream import read_time_stream
from jointscope.recordings.toml_parse import parse_toml


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
    return campaign_of(parse_campaign(file), file, missing_outputs=missing_outputs)


def campaign_of(document: Table, file: Path, *, missing_outputs: MissingOutputs = "refuse") -> Campaign:
    """The campaign that a checked document describes.

    Args:
        document: As ``parse_campaign`` returns it.
        file: Where the document stands, or would: data files are looked for beside it.
        missing_outputs: As for :func:`read_campaign`.

    Raises:
        CampaignError: A data file breaks the format.
    """
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
        document = parse_toml(file.read_text(encoding="utf-8-sig"))
    except (FileNotFoundError, NotADirectoryError):
        raise CampaignError(
            file, None, "no such file", fix="a campaign is a directory with a campaign.toml"
        ) from None
    except RecursionError:
        raise CampaignError(file, None, "not TOML: nested too deep") from None
    except ValueError as problem:  # of TOML, of UTF-8, or of a number with thousands of digits
        raise CampaignError(file, None, f"not TOML: {problem}") from problem
    except OSError as problem:
        raise CampaignError(file, None, f"can't be read: {problem.strerror or problem}") from problem
    check_structure(document, file)
    check_meaning(document, file)
    return document


def _run(run: Table, where: str, file: Path, files: dict[str, DataFile], missing: MissingOutputs) -> Run:
    hold = run.get("hold", {})
    holds: dict[str, Any] = {"": hold} if isinstance(hold, str) else dict(hold)
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
        payload_com=vector(payload.get("com")),
        hold=holds,
    )


def _stream(stream: Table, where: str, file: Path, files: dict[str, DataFile], missing: MissingOutputs) -> Stream:
    name = stream["file"]
    if name not in files:
        files[name] = open_data_file(file.parent / name)
    if stream["channels"][0]["quantity"] == "frf":
        return read_frf_stream(stream, where, file, files[name])
    return read_time_stream(stream, where, file, files[name], missing)
