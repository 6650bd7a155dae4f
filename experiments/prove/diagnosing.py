"""Diagnose every case of a draw in processes of their own, with a time limit, keeping what is finished.

Each case is copied into a folder of its own first, away from the seal and from the other cases. A process that
crashes or runs out of time is replaced; its case counts as wrong.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import shutil
import tempfile
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any, Final

from jointscope.atomic import write_text
from jointscope.errors import InputError
from jointscope.progress import track

STATE: Final = "prove.json"
ANSWERS: Final = "answers"
FIRST_CASE_EXTRA: Final = 300.0  # s beyond the limit for a new process's first case, in which code is compiled


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


def diagnose_all(folder: Path, out: Path, names: Sequence[str], *, workers: int, limit: float) -> list[Answer]:
    """Answers to ``names`` in their order; those already in ``out`` are not diagnosed again.

    Args:
        folder: The draw.
        out: Where answers are kept, one file each.
        names: Cases.
        workers: Processes at once.
        limit: Time for one case [s].
    """
    (out / ANSWERS).mkdir(parents=True, exist_ok=True)
    todo = [name for name in names if not (out / ANSWERS / f"{name}.json").is_file()]
    for answer in track(_work(folder, todo, workers, limit), "diagnosing", len(todo)):
        write_text(out / ANSWERS / f"{answer.case}.json", json.dumps(vars(answer), sort_keys=True) + "\n")
    return [load(out, name) for name in names]


def load(out: Path, name: str) -> Answer:
    """A kept answer."""
    return Answer(**json.loads((out / ANSWERS / f"{name}.json").read_text(encoding="utf-8")))


def _work(folder: Path, names: Sequence[str], workers: int, limit: float) -> Iterator[Answer]:
    if not names:
        return
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    workers = max(1, min(workers, len(names)))
    posts = [_Post(max(1, (os.cpu_count() or 1) // workers)) for _ in range(workers)]
    free = list(posts)
    lock = threading.Lock()

    def one(name: str) -> Answer:
        with lock:
            post = free.pop()
        try:
            return post.answer(folder, name, limit)
        finally:
            with lock:
                free.append(post)

    try:
        with ThreadPoolExecutor(workers) as threads:
            jobs = [threads.submit(one, name) for name in names]
            try:
                for job in as_completed(jobs):
                    yield job.result()
            finally:
                for job in jobs:
                    job.cancel()
    finally:
        for post in posts:
            post.close()


class _Post:
    """A process that diagnoses one case after another and can be replaced when it hangs."""

    def __init__(self, threads: int) -> None:
        self._threads = threads
        self._process: multiprocessing.process.BaseProcess | None = None
        self._line: Connection | None = None
        self._fresh = True

    def answer(self, folder: Path, name: str, limit: float) -> Answer:
        started = time.monotonic()
        with tempfile.TemporaryDirectory(prefix="case-") as scratch:
            campaign, target = Path(scratch) / "campaign", Path(scratch) / "out"
            shutil.copytree(folder / name, campaign)
            line = self._open()
            patience = limit + (FIRST_CASE_EXTRA if self._fresh else 0.0)
            line.send((str(campaign), str(target), self._threads))
            status, message = "timed-out", f"more than {patience:.0f} s"
            try:
                if line.poll(patience):
                    status, message, seconds = line.recv()
                    self._fresh = False
                    return Answer(name, status, seconds, _read(target) if status == "answered" else None, message)
            except (EOFError, OSError) as problem:
                status, message = "crashed", f"the process ended: {problem!r}"
            self.close()
            return Answer(name, status, time.monotonic() - started, None, message)

    def _open(self) -> Connection:
        if self._line is None:
            context = multiprocessing.get_context("spawn")
            mine, theirs = context.Pipe()
            self._process = context.Process(target=_serve, args=(theirs,), daemon=True)
            self._process.start()
            theirs.close()
            self._line, self._fresh = mine, True
        return self._line

    def close(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.join()
        if self._line is not None:
            self._line.close()
        self._process, self._line = None, None


def _read(target: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((target / "diagnosis.json").read_text(encoding="utf-8"))
    return found


def _serve(line: Connection) -> None:
    """The process's life: diagnose what is sent, say how it went."""
    import contextlib
    import io

    from jointscope.cli import main

    while True:
        try:
            campaign, target, threads = line.recv()
        except EOFError:
            return
        words = ["diagnose", campaign, "--out", target, "--workers", str(threads)]
        started = time.monotonic()
        noise = io.StringIO()
        try:
            with contextlib.redirect_stdout(noise), contextlib.redirect_stderr(noise):
                code = main(words)
            status, message = "answered", ""
            if code or not (Path(target) / "diagnosis.json").is_file():
                status, message = "crashed", f"exit code {code}: {noise.getvalue()[-500:]}"
        except SystemExit as problem:
            status, message = "crashed", f"exit {problem.code}: {noise.getvalue()[-500:]}"
        except Exception as problem:  # whatever it is, it is this case's failure and not the proof's
            status, message = "crashed", f"{problem!r}: {noise.getvalue()[-500:]}"
        line.send((status, message, time.monotonic() - started))
