"""Diagnose every case of a draw in processes of their own, with a time limit, keeping what is finished.

Each case is copied into a folder of its own first, away from the seal and from the other cases. A process that
crashes or runs out of time makes its case wrong and touches no other. One that is killed from outside is started once
more: a diagnosis that kills itself dies again, an operator's kill or a machine short of memory does not repeat.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

from jointscope.atomic import write_text
from jointscope.errors import InputError, MissingExtraError
from jointscope.progress import track

STATE: Final = "prove.json"
ANSWERS: Final = "answers"
KILLS: Final = (signal.SIGKILL, signal.SIGTERM, signal.SIGINT) if os.name == "posix" else ()
COMMAND: tuple[str, ...] = (sys.executable, "-m", "jointscope", "diagnose")


@dataclass(frozen=True)
class Answer:
    """What came of one case.

    Attributes:
        status: ``answered``, ``crashed`` or ``timed-out``.
        seconds: Wall time, reading and writing included.
        diagnosis: The content of diagnosis.json; ``None`` unless answered.
        message: The last words of a crash.
    """

    case: str
    status: str
    seconds: float
    diagnosis: dict[str, Any] | None
    message: str = ""


def cases_of(folder: Path) -> list[str]:
    """Names of the folder's campaigns, sorted."""
    found = sorted(path.parent.name for path in folder.glob("*/campaign.toml"))
    if not found:
        raise InputError(
            folder, None, "holds no campaign", fix="point at a folder written by 'jointscope conceal'"
        )
    return found


def claim(out: Path, seal: str) -> None:
    """Bind ``out`` to the seal's hash before anything is diagnosed.

    Raises:
        InputError: ``out`` was begun with another seal.
    """
    out.mkdir(parents=True, exist_ok=True)
    file = out / STATE
    if file.is_file():
        held = json.loads(file.read_text(encoding="utf-8"))["seal"]
        if held != seal:
            raise InputError(
                file, "seal", f"the draw's seal is now {seal}", value=held, fix="choose another --out"
            )
    else:
        write_text(file, json.dumps({"seal": seal}) + "\n")


def diagnose_all(
    folder: Path, out: Path, names: Sequence[str], *, workers: int, limit: float, scheduler: str | None = None
) -> list[Answer]:
    """Answers to ``names`` in their order; those already in ``out`` are not diagnosed again.

    Args:
        folder: The draw.
        out: Where answers are kept, one file each.
        names: Cases.
        workers: Processes at once, on this machine.
        limit: Time for one case [s].
        scheduler: Address of a Dask scheduler whose workers see ``folder``, instead of local processes.
    """
    (out / ANSWERS).mkdir(parents=True, exist_ok=True)
    todo = [name for name in names if not (out / ANSWERS / f"{name}.json").is_file()]
    answers = _cluster(folder, todo, scheduler, limit) if scheduler else _local(folder, todo, workers, limit)
    for answer in track(answers, "diagnosing", len(todo)):
        write_text(out / ANSWERS / f"{answer.case}.json", json.dumps(vars(answer), sort_keys=True) + "\n")
    return [load(out, name) for name in names]


def load(out: Path, name: str) -> Answer:
    """A kept answer."""
    return Answer(**json.loads((out / ANSWERS / f"{name}.json").read_text(encoding="utf-8")))


def diagnose_one(folder: Path, name: str, limit: float, threads: int) -> Answer:
    """Diagnose a copy of one case with the command line, in a process of its own."""
    started = time.monotonic()
    killed = True
    for _ in range(2):
        answer, killed = _attempt(folder, name, limit, threads)
        if not killed:
            break
    return replace(answer, seconds=time.monotonic() - started) if killed else answer


def _attempt(folder: Path, name: str, limit: float, threads: int) -> tuple[Answer, bool]:
    """One try, and whether its process was killed."""
    started = time.monotonic()
    with tempfile.TemporaryDirectory(prefix="case-") as scratch:
        campaign, target = Path(scratch) / "campaign", Path(scratch) / "out"
        shutil.copytree(folder / name, campaign)
        words = [*COMMAND, str(campaign), "--out", str(target)]
        environment = {**os.environ, "OMP_NUM_THREADS": "1"}
        try:
            done = subprocess.run(
                [*words, "--workers", str(threads)], capture_output=True, text=True, timeout=limit, env=environment,
                check=False,
            )  # fmt: skip
        except subprocess.TimeoutExpired:
            return Answer(name, "timed-out", time.monotonic() - started, None, f"more than {limit:g} s"), False
        seconds = time.monotonic() - started
        found = target / "diagnosis.json"
        if done.returncode or not found.is_file():
            message = f"exit code {done.returncode}: {done.stderr[-500:]}"
            return Answer(name, "crashed", seconds, None, message), -done.returncode in KILLS
        return Answer(name, "answered", seconds, json.loads(found.read_text(encoding="utf-8"))), False


def _local(folder: Path, names: Sequence[str], workers: int, limit: float) -> Iterator[Answer]:
    workers = max(1, min(workers, len(names)))
    threads = max(1, (os.cpu_count() or 1) // workers)
    with ThreadPoolExecutor(workers) as pool:
        jobs = [pool.submit(diagnose_one, folder, name, limit, threads) for name in names]
        try:
            for job in as_completed(jobs):
                yield job.result()
        finally:
            for job in jobs:
                job.cancel()


def _cluster(folder: Path, names: Sequence[str], scheduler: str, limit: float) -> Iterator[Answer]:
    try:
        from dask.distributed import Client
        from dask.distributed import as_completed as completed
    except ImportError:
        raise MissingExtraError("a Dask cluster", "cluster") from None
    with Client(scheduler) as client:  # type: ignore[no-untyped-call]
        jobs = [client.submit(diagnose_one, folder.resolve(), name, limit, 1, pure=False) for name in names]
        for job in completed(jobs):  # type: ignore[no-untyped-call]
            yield job.result()
