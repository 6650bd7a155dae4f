"""A campaign drafted from records and answers; whatever neither says is guessed or, where it can't be, asked."""

from __future__ import annotations

import tomllib
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np

from jointscope.errors import InputError
from jointscope.recordings.draft.guesses import Draft, guess_channel
from jointscope.recordings.draft.records import Record
from jointscope.recordings.draft.runs import RunDraft, guess_experiment, hit_windows, run_identity, stream_draft
from jointscope.recordings.files import Column
from jointscope.recordings.files.ros_file import EFFORT
from jointscope.recordings.schema import CHANNEL, RIG

Ask = Callable[[str, str], str]
"""Takes a question and the answer that is assumed without one; returns the answer."""

_RUN_KEYS: Final = ("experiment", "arm_angle", "brake", "role")
EFFORTS: Final = ("torque", "current")
_FILE_KEYS: Final = ("sampling_rate", "take", *_RUN_KEYS)


def read_answers(path: Path | None) -> dict[str, Any]:
    """Answers given beforehand: tables ``rig``, ``run``, ``files.NAME`` and ``columns.NAME``, keys as in a campaign.

    Raises:
        InputError: No TOML, or a key that no question asks for.
    """
    if path is None:
        return {}
    try:
        answers = tomllib.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(path, None, "no such file") from None
    except tomllib.TOMLDecodeError as problem:
        raise InputError(path, None, f"not TOML: {problem}") from problem
    known: dict[str, tuple[str, ...]] = {"title": (), "rig": tuple(RIG), "run": (*_RUN_KEYS, "together")}
    for key, value in answers.items():
        if key in ("files", "columns") and isinstance(value, dict):
            allowed = _FILE_KEYS if key == "files" else (*CHANNEL, "ignore")
            for name, table in value.items():
                _check_keys(path, f"{key}.{name}", table, allowed)
        elif key not in known:
            raise InputError(path, key, "unknown answer", value=value, fix="title, rig, run, files or columns")
        elif key != "title":
            _check_keys(path, key, value, known[key])
    return answers


def _check_keys(path: Path, where: str, table: object, allowed: Sequence[str]) -> None:
    if not isinstance(table, dict):
        raise InputError(path, where, "must be a table", value=table)
    for key, value in table.items():
        if key not in allowed:
            raise InputError(
                path, f"{where}.{key}", "unknown answer", value=value, fix=f"one of {', '.join(allowed)}"
            )


def draft_campaign(
    records: Sequence[Record], names: Mapping[Path, str], answers: Mapping[str, Any], ask: Ask | None
) -> tuple[Draft, list[RunDraft], list[str]]:
    """Draft the rig, the runs, and the columns that nobody could place.

    Args:
        records: As ``records_of`` finds them.
        names: Each file's name inside the campaign.
        answers: As ``read_answers`` returns them.
        ask: Puts a question to the user; ``None`` asks nothing.

    Raises:
        InputError: A sampling rate that neither file nor answer says.
    """
    rig = _rig(answers.get("rig", {}), ask)
    unplaced: list[str] = []
    runs: list[RunDraft] = []
    taken: set[str] = set()
    for record in records:
        channels = _channels(record, rig.values["motion"], answers.get("columns", {}), ask, unplaced)
        if channels:
            _ratio(record, channels, rig, ask)
            runs += _runs_of(record, names[record.file], channels, rig, answers, ask, taken)
    runs = _of_one_take(runs, {names[record.file] for record in records if record.simultaneous})
    if answers.get("run", {}).get("together", False) and len(runs) > 1:
        runs = [RunDraft(runs[0].keys, tuple(stream for run in runs for stream in run.streams))]
    return rig, runs, unplaced


def _of_one_take(runs: Sequence[RunDraft], files: Collection[str]) -> list[RunDraft]:
    """Parts of one take joined to one run: those that an answer says are, and the records of ``files``, on one clock.

    What it was taken for is said by the part that was driven; what an answer says of any part holds for all.
    """
    joined: dict[str, list[RunDraft]] = {}
    for number, run in enumerate(runs):
        file = str(run.streams[0][0].values["file"])
        own = f"file {file}" if file in files else f"run {number}"
        joined.setdefault(f"take {run.take}" if run.take else own, []).append(run)
    found = []
    for parts in joined.values():
        main = next((part for part in parts if part.keys.values["experiment"] != "free"), parts[0])
        for part in parts:
            for key, value in part.keys.values.items():
                if part is not main and key != "id" and key not in part.keys.guessed:
                    main.keys.state(key, value)
        if main.take:
            main.keys.state("id", main.take)
        found.append(RunDraft(main.keys, tuple(stream for part in parts for stream in part.streams), main.take))
    return found


def _rig(stated: Mapping[str, Any], ask: Ask | None) -> Draft:
    rig = Draft(dict(stated))
    questions = (
        ("topology", "two-inertia", "two-inertia joint, or single-dof (motor braked or absent)?", "the usual rig"),
        ("motion", "rotational", "rotational or translational?", "the usual rig"),
        (
            "plane",
            "vertical",
            "does gravity act on the arm (vertical) or not (horizontal)?",
            "gravity mostly acts",
        ),
    )
    for key, usual, question, why in questions:
        if key in rig.values:
            continue
        answer = ask(question, usual) if ask else ""
        if answer:
            rig.state(key, answer)
        else:
            rig.guess(key, usual, why)
    return rig


def _channels(
    record: Record, motion: str, columns: Mapping[str, Any], ask: Ask | None, unplaced: list[str]
) -> list[Draft]:
    found = []
    for column in record.columns:
        if not np.isfinite(np.asarray(column.read())).any():  # what a driver names and does not measure
            unplaced.append(f"{record.file.name}: {column.name} holds no number")
            continue
        stated = columns.get(column.name, columns.get(column.name.rsplit("/", 1)[-1], {}))
        if column.label == EFFORT and "quantity" not in stated and not stated.get("ignore", False):
            stated = {**stated, **_effort(record, column, ask)}
        draft = guess_channel(column, motion, stated)
        if draft is None and not stated.get("ignore", False) and ask:
            quantity = ask(f"{record.file.name}, {column.name}: what does it measure (empty: nothing of use)?", "")
            if quantity:
                draft = guess_channel(column, motion, {**stated, "quantity": quantity})
        if draft is None:
            if not stated.get("ignore", False):
                unplaced.append(f"{record.file.name}: {column.name}")
            continue
        if ask and "radius" in draft.guessed:
            answer = ask(f"{record.file.name}, {column.name}: distance from the joint axis in m?", "1.0")
            if answer:
                draft.state("radius", float(answer))
        found.append(draft)
    return found


def _effort(record: Record, column: Column, ask: Ask | None) -> dict[str, str]:
    """Whether an effort is a torque or a current: nothing in a bag says it, so somebody must."""
    question = (
        f"{record.file.name}, {column.name}: torque (N m) or current (A)? the UR driver's default is current"
    )
    said = ask(question, "").strip().lower() if ask else ""
    if said not in EFFORTS:
        raise InputError(
            record.file, column.name, "an effort is a torque or a current, and nothing in the file says which",
            fix="say --effort torque or --effort current; drivers differ, and the UR driver's default is current",
        )  # fmt: skip
    return effort_answer(said)


def _ratio(record: Record, channels: Sequence[Draft], rig: Draft, ask: Ask | None) -> None:
    """A torque at the output means nothing to the motor without the ratio."""
    behind = next((c.values["column"] for c in channels if c.values.get("side") == "output"), None)
    if behind is None or "reduction_ratio" in rig.values:
        return
    said = ask("reduction ratio, motor turns per output turn?", "") if ask else ""
    try:
        rig.state("reduction_ratio", float(said))
    except ValueError:
        raise InputError(
            record.file, behind, "a torque at the joint's output needs the ratio to the motor shaft",
            fix="say it in --answers: [rig] reduction_ratio = ...",
        ) from None  # fmt: skip


def effort_answer(said: str) -> dict[str, str]:
    """A channel's keys for an effort that is said to be a ``torque`` or a ``current``."""
    if said == "torque":
        return {"quantity": "torque", "unit": "N m", "location": "motor", "side": "output"}
    return {"quantity": "current", "unit": "A", "location": "motor"}


def _runs_of(
    record: Record, name: str, channels: list[Draft], rig: Draft, answers: Mapping[str, Any], ask: Ask | None,
    taken: set[str],
) -> list[RunDraft]:  # fmt: skip
    stated = {**answers.get("run", {}), **answers.get("files", {}).get(record.file.name, {})}
    stated.pop("together", None)
    frf = channels[0].values["quantity"] == "frf"
    rate = None if frf else _rate(record, stated, ask)
    record = replace(record, rate=rate)
    keys = _run_keys(record, channels, rig, stated, ask)
    windows: list[tuple[float, float] | None] = [None]
    force = next((d.values["column"] for d in channels if d.values["quantity"] == "force"), None)
    if keys.values["experiment"] == "hammer" and force is not None and rate is not None and record.uniform:
        column = next(c for c in record.columns if c.name == force)
        cut = hit_windows(np.asarray(column.read(), dtype=np.float64), rate)
        windows = list(cut) if len(cut) > 1 else [None]
    used = {channel.values["column"] for channel in channels}
    gappy = (c.name for c in record.columns if c.name in used and np.isnan(np.asarray(c.read())).any())
    missing = next(gappy, "")
    runs = []
    for number, window in enumerate(windows, start=1):
        own = Draft(
            {"id": run_identity(record, number if len(windows) > 1 else 0, taken), **keys.values},
            dict(keys.guessed),
        )
        stream = stream_draft(record, name, rate, missing)
        if window is not None:
            stream.guess(
                "window", list(window), f"hit {number} of {len(windows)}, with {1e3 * 0.1:.0f} ms before it"
            )
            own.guess(
                "repeat_of", f"{record.file.stem}{'-' + record.name if record.name else ''}", "hits of one record"
            )
        runs.append(RunDraft(own, ((stream, tuple(channels)),), str(stated.get("take", ""))))
    return runs


def _rate(record: Record, stated: Mapping[str, Any], ask: Ask | None) -> float:
    if "sampling_rate" in stated:
        return float(stated["sampling_rate"])
    if record.rate is not None:
        return record.rate
    answer = ask(f"{record.file.name}: sampling rate in Hz?", "") if ask else ""
    if not answer:
        raise InputError(
            record.file, "sampling_rate", "nothing in the file says it",
            fix=f"give --rate HZ, or in --answers: [files.\"{record.file.name}\"] sampling_rate = ...",
        )  # fmt: skip
    try:
        return float(answer)
    except ValueError:
        raise InputError(record.file, "sampling_rate", "not a number", value=answer) from None


def _run_keys(
    record: Record, channels: list[Draft], rig: Draft, stated: Mapping[str, Any], ask: Ask | None
) -> Draft:
    keys = Draft({key: value for key, value in stated.items() if key in _RUN_KEYS})
    experiment, why = guess_experiment(channels, record)
    keys.guess("experiment", experiment, why)
    if keys.values["experiment"] == "hammer" and rig.values["topology"] == "two-inertia":
        keys.guess("brake", True, "hammer tests are taken with the motor held")
    if (
        rig.values["motion"] == "rotational"
        and rig.values["plane"] == "vertical"
        and "arm_angle" not in keys.values
    ):
        answer = ask(f"{record.file.name}: arm angle at the start, rad from the horizontal?", "0.0") if ask else ""
        if answer:
            keys.state("arm_angle", float(answer))
        else:
            keys.guess(
                "arm_angle", 0.0, "nothing says it; gravity depends on it, measure it in rad from the horizontal"
            )
    return keys
