"""A whole draw: many cases on several processes, resumable, sealed at the end."""

from __future__ import annotations

import json
import multiprocessing
import os
import shutil
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Final

from jointscope.atomic import replaced_file, write_text
from jointscope.errors import InputError, JointscopeError, MissingExtraError
from jointscope.progress import track
from jointscope.sim.concealed.draw import Order, case_name, make_case
from jointscope.sim.concealed.seal import seal, unseal, write_seal

ORDER = "draw.json"
PARTS = ".parts"
RESTARTS: Final = 3  # of the processes, after one of them died


def produce(order: Order, folder: Path, workers: int, scheduler: str | None = None) -> str:
    """Write ``order``'s cases into ``folder`` and seal their truth; finished cases are kept when it is run again.

    Args:
        order: What is asked for.
        folder: Where; with a ``scheduler`` its workers have to see it.
        workers: Processes on this machine.
        scheduler: Address of a Dask scheduler, instead of local processes.

    Returns:
        SHA-256 of the seal.

    Raises:
        InputError: The folder holds another draw.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _claim(order, folder)
    (folder / PARTS).mkdir(exist_ok=True)
    todo = [i for i in range(order.cases) if not _finished(folder, case_name(order, i))]
    work = _cluster(order, folder, todo, scheduler) if scheduler else _local(order, folder, todo, workers)
    failed = [said for said in track(work, "concealing", len(todo)) if said]
    if failed:
        raise JointscopeError(f"{len(failed)} of {order.cases} cases failed, the others are kept: {failed[0]}")
    cases = {}
    for i in range(order.cases):
        part = folder / PARTS / f"{case_name(order, i)}.sealed"
        cases[case_name(order, i)] = unseal(part.read_bytes(), part)
    truth = {"format": "jointscope-truth/1", "order": _as_json(order), "cases": dict(sorted(cases.items()))}
    return write_seal(folder, truth)


def _as_json(order: Order) -> dict[str, object]:
    return {"seed": order.seed, "cases": order.cases, "kind": order.kind, "draw": order.draw}


def _claim(order: Order, folder: Path) -> None:
    """The number of cases may grow; nothing else may change."""
    file = folder / ORDER
    if file.is_file():
        held = json.loads(file.read_text(encoding="utf-8"))
        for key, value in _as_json(order).items():
            if key != "cases" and held.get(key) != value:
                raise InputError(file, key, f"this folder holds another draw than {value!r}", value=held.get(key),
                                 fix="choose another --out")  # fmt: skip
    elif any(folder.iterdir()):
        raise InputError(folder, None, "isn't empty and holds no draw", fix="choose another --out")
    write_text(file, json.dumps(_as_json(order)) + "\n")


def _finished(folder: Path, name: str) -> bool:
    return (folder / PARTS / f"{name}.sealed").is_file() and (folder / name / "campaign.toml").is_file()


def _one(task: tuple[Order, int, str]) -> str:
    """Make one case; what went wrong, or nothing."""
    order, index, folder = task
    name = case_name(order, index)
    directory = Path(folder) / name
    if _finished(Path(folder), name):  # by a process that died before it could say so
        return ""
    if directory.is_dir():  # written, but its truth was lost with the process
        shutil.rmtree(directory)
    try:
        truth = make_case(order, index, directory)
    except Exception as problem:  # of any kind: the other cases don't depend on it
        return f"case {index} of seed {order.seed} ({order.draw}): {problem!r}"
    with replaced_file(Path(folder) / PARTS / f"{name}.sealed") as temporary:
        temporary.write_bytes(seal(truth))
    return ""


def _local(order: Order, folder: Path, todo: list[int], workers: int) -> Iterator[str]:
    tasks = [(order, index, str(folder)) for index in todo]
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


def _pooled(tasks: list[tuple[Order, int, str]], workers: int) -> Iterator[tuple[int, str]]:
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


def _cluster(order: Order, folder: Path, todo: list[int], scheduler: str) -> Iterator[str]:
    try:
        from dask.distributed import Client, as_completed
    except ImportError:
        raise MissingExtraError("a Dask cluster", "cluster") from None
    with Client(scheduler) as client:  # type: ignore[no-untyped-call]
        tasks = [(order, index, str(folder.resolve())) for index in todo]
        for job in as_completed(client.map(_one, tasks, pure=False)):  # type: ignore[no-untyped-call]
            yield job.result()
