"""A draw's folder: many cases on several processes, resumable, their truth sealed at the end; whoever simulates them."""

from __future__ import annotations

import json
import multiprocessing
import os
import shutil
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from jointscope.atomic import replaced_file, write_text
from jointscope.errors import InputError, JointscopeError, MissingExtraError
from jointscope.progress import track
from jointscope.sim.concealed.seal import seal, unseal, write_seal

ORDER: Final = "draw.json"
PARTS: Final = ".parts"
RESTARTS: Final = 3  # of the processes, after one of them died


@dataclass(frozen=True)
class Draw:
    """What is to be made, in terms that a process can be sent.

    Attributes:
        asked: The order as it stands in the folder and in the truth; ``seed``, ``cases`` and ``draw`` among it.
        names: Of the cases' folders, one per case.
        make: Writes case ``index`` into a new folder and returns its truth; a function of a module.
    """

    asked: Mapping[str, Any]
    names: tuple[str, ...]
    make: Callable[[int, Path], dict[str, Any]]


def make_draw(draw: Draw, folder: Path, workers: int, scheduler: str | None = None) -> str:
    """Write the cases into ``folder`` and seal their truth; finished cases are kept when it is run again.

    Args:
        draw: What is asked for.
        folder: Where; with a ``scheduler`` its workers have to see it.
        workers: Processes on this machine.
        scheduler: Address of a Dask scheduler, instead of local processes.

    Returns:
        SHA-256 of the seal.

    Raises:
        InputError: The folder holds another draw.
        JointscopeError: Cases failed; the others are kept.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _claim(draw, folder)
    (folder / PARTS).mkdir(exist_ok=True)
    todo = [i for i, name in enumerate(draw.names) if not _finished(folder, name)]
    work = _cluster(draw, folder, todo, scheduler) if scheduler else _local(draw, folder, todo, workers)
    failed = [said for said in track(work, "concealing", len(todo)) if said]
    if failed:
        raise JointscopeError(f"{len(failed)} of {len(draw.names)} cases failed, the others are kept: {failed[0]}")
    parts = {name: folder / PARTS / f"{name}.sealed" for name in sorted(draw.names)}
    cases = {name: unseal(part.read_bytes(), part) for name, part in parts.items()}
    return write_seal(folder, {"format": "jointscope-truth/1", "order": dict(draw.asked), "cases": cases})


def _claim(draw: Draw, folder: Path) -> None:
    """The number of cases may grow; nothing else may change."""
    file = folder / ORDER
    if file.is_file():
        held = json.loads(file.read_text(encoding="utf-8"))
        for key, value in draw.asked.items():
            if key != "cases" and held.get(key) != value:
                raise InputError(file, key, f"this folder holds another draw than {value!r}", value=held.get(key),
                                 fix="choose another --out")  # fmt: skip
    elif any(folder.iterdir()):
        raise InputError(folder, None, "isn't empty and holds no draw", fix="choose another --out")
    write_text(file, json.dumps(dict(draw.asked)) + "\n")


def _finished(folder: Path, name: str) -> bool:
    return (folder / PARTS / f"{name}.sealed").is_file() and (folder / name / "campaign.toml").is_file()


def _one(task: tuple[Draw, int, str]) -> str:
    """Make one case; what went wrong, or nothing."""
    draw, index, folder = task
    name = draw.names[index]
    directory = Path(folder) / name
    if _finished(Path(folder), name):  # by a process that died before it could say so
        return ""
    if directory.is_dir():  # written, but its truth was lost with the process
        shutil.rmtree(directory)
    try:
        truth = draw.make(index, directory)
    except Exception as problem:  # of any kind: the other cases don't depend on it
        return f"case {index} of seed {draw.asked['seed']} ({draw.asked['draw']}): {problem!r}"
    with replaced_file(Path(folder) / PARTS / f"{name}.sealed") as temporary:
        temporary.write_bytes(seal(truth))
    return ""


def _local(draw: Draw, folder: Path, todo: list[int], workers: int) -> Iterator[str]:
    tasks = [(draw, index, str(folder)) for index in todo]
    if workers <= 1 or len(tasks) <= 1:
        yield from map(_one, tasks)
        return
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    left = {task[1]: task for task in tasks}
    for _ in range(RESTARTS + 1):
        for index, said in _pooled(list(left.values()), workers):
            del left[index]
            yield said
        if not left:
            return
    raise JointscopeError(
        f"processes died {RESTARTS + 1} times; {len(left)} of {len(tasks)} cases are missing: run again"
    )


def _pooled(tasks: list[tuple[Draw, int, str]], workers: int) -> Iterator[tuple[int, str]]:
    """Index and outcome of the cases that are finished before a process dies, which takes all others with it."""
    context = multiprocessing.get_context("spawn")
    pool = ProcessPoolExecutor(
        min(workers, len(tasks)), mp_context=context, initializer=_follow, initargs=(os.getpid(),)
    )
    with pool:
        jobs = {pool.submit(_one, task): task[1] for task in tasks}
        try:
            for job in as_completed(jobs):
                try:
                    said = job.result()
                except BrokenProcessPool:
                    continue
                yield jobs[job], said
        finally:
            pool.shutdown(wait=False, cancel_futures=True)


def _follow(parent: int) -> None:
    """End this process when the one that started it is gone, however it went."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(0.5)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()


def _cluster(draw: Draw, folder: Path, todo: list[int], scheduler: str) -> Iterator[str]:
    try:
        from dask.distributed import Client, as_completed
    except ImportError:
        raise MissingExtraError("a Dask cluster", "cluster") from None
    with Client(scheduler) as client:  # type: ignore[no-untyped-call]
        tasks = [(draw, index, str(folder.resolve())) for index in todo]
        for job in as_completed(client.map(_one, tasks, pure=False)):  # type: ignore[no-untyped-call]
            yield job.result()
