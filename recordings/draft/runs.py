"""From records to runs: which experiment a record is, and where one continuous record holds several hits."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from jointscope.recordings.draft.guesses import Draft
from jointscope.recordings.draft.records import Record
from jointscope.recordings.pulses import find_pulses

PRE_TRIGGER: Final = 0.1  # s before the hit
APART: Final = 0.5  # s; closer ones are second contacts, for inspect to report
SHORTEST: Final = 0.4  # s of record after a hit
LOWEST: Final = 0.05  # of the largest hit


@dataclass(frozen=True, eq=False)
class RunDraft:
    """A run to be written: its keys, its streams with their channels, and the take that an answer says it is a part of."""

    keys: Draft
    streams: tuple[tuple[Draft, tuple[Draft, ...]], ...]
    take: str = ""


def hit_windows(force: np.ndarray[Any, np.dtype[np.float64]], rate: float) -> list[tuple[float, float]]:
    """[t0, t1] of every hit in one record, in seconds of the file: pre-trigger, hit, and its decay up to the next."""
    pulses = find_pulses(force, rate, share=LOWEST, dead_time=APART)
    if not pulses:
        return []
    begins = [max(0.0, pulse.first / rate - PRE_TRIGGER) for pulse in pulses]
    ends = [*begins[1:], force.size / rate]
    return [
        (round(math.floor(begin * rate) / rate, 6), round(math.floor(end * rate) / rate, 6))
        for begin, end in zip(begins, ends, strict=True)
        if end - begin >= SHORTEST + PRE_TRIGGER and (end - begin) * rate >= 64
    ]


def guess_experiment(channels: Sequence[Draft], record: Record) -> tuple[str, str]:
    """What the record was taken for, and why that is thought."""
    quantities = {draft.values["quantity"]: draft.values["column"] for draft in channels}
    columns = {column.name: column for column in record.columns}
    if "force" in quantities and record.rate:
        column = columns[quantities["force"]]
        x = np.asarray(column.read(), dtype=np.float64)
        pulses = find_pulses(x, record.rate)
        if pulses and all(p.last - p.first < 0.05 * record.rate for p in pulses):
            return "hammer", f"{column.name} holds short pulses"
    if "frf" in quantities:
        return "hammer", "FRFs come from hammer tests mostly"
    if "speed-command" in quantities:
        return "speed-motion", f"there is a speed command, {quantities['speed-command']}"
    drive = next(
        (quantities[q] for q in ("torque", "current", "voltage", "phase-current") if q in quantities), None
    )
    if drive is not None:
        return "torque-sweep", f"there is a drive signal, {drive}"
    return "free", "no excitation was recognised"


def stream_draft(record: Record, name: str, rate: float | None, missing: str) -> Draft:
    """The stream's own keys; ``missing`` is a column that lacks values, empty where none does."""
    draft = Draft({"file": name})
    if rate is not None and "taken as" in record.rate_from and rate == record.rate:
        draft.guess("sampling_rate", rate, record.rate_from)
    elif rate is not None:
        draft.state("sampling_rate", rate)
    if record.time is not None and (record.simultaneous or not record.uniform):
        draft.state("time", record.time)
    if record.time is not None and not record.uniform:
        draft.guess("gaps", "mask", "the time stamps are not uniform; rows may be missing")
    if missing:
        draft.guess("gaps", "mask", f"values of {missing} are missing")
    return draft


def run_identity(record: Record, number: int, taken: set[str]) -> str:
    """An id that no other run has, after the file and its record."""
    base = Path(record.file.name).stem + (f"-{record.name}" if record.name else "")
    plain = "".join(sign if sign.isalnum() or sign in "-_" else "-" for sign in base) + (
        f"-{number:02d}" if number else ""
    )
    name, count = plain, 1
    while name in taken:
        count += 1
        name = f"{plain}-{count}"
    taken.add(name)
    return name
