"""Many evaluations in fixed blocks: resumable, and the same numbers for any number or kind of workers."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jointscope.atomic import replaced_file
from jointscope.errors import JointscopeError, MissingExtraError
from jointscope.experiments.sensitivity import outputs
from jointscope.experiments.sensitivity.study import OUTPUTS, Study
from jointscope.progress import track

Array = NDArray[np.float64]

LOST = "{}; finished blocks are kept: run it again with the same words"
BLOCK = 128  # evaluations; fixed, so that neither workers nor resumption change a bit of the result


def _fingerprint(study: Study, sample: Array) -> str:
    text = json.dumps(asdict(study), sort_keys=True)
    return hashlib.sha256(text.encode() + np.ascontiguousarray(sample).tobytes()).hexdigest()[:16]


def evaluate_block(study: Study, block: Array) -> Array:
    """All outputs of one block, shape (len(block), len(OUTPUTS)), columns in the order of ``OUTPUTS``."""
    names = tuple(factor.name for factor in study.factors)
    if study.engine == "mujoco":
        from jointscope.experiments.sensitivity.engine import evaluate_mujoco

        table = evaluate_mujoco(study.nominal, names, block)
    else:
        table = outputs.evaluate(study.nominal, names, block)
    return np.column_stack([table[name] for name in OUTPUTS])


def _serial(study: Study, blocks: dict[int, Array]) -> Iterator[tuple[int, Array]]:
    for index, block in blocks.items():
        yield index, evaluate_block(study, block)


def _pooled(study: Study, blocks: dict[int, Array], workers: int) -> Iterator[tuple[int, Array]]:
    from joblib import Parallel, delayed
    from joblib.externals.loky.process_executor import BrokenProcessPool

    def task(index: int, block: Array) -> tuple[int, Array]:
        return index, evaluate_block(study, block)

    try:
        yield from Parallel(n_jobs=workers, return_as="generator_unordered")(
            delayed(task)(index, block) for index, block in blocks.items()
        )
    except BrokenProcessPool:
        raise JointscopeError(LOST.format("a process was killed, by the system for its memory perhaps")) from None


def _distributed(study: Study, blocks: dict[int, Array], scheduler: str) -> Iterator[tuple[int, Array]]:
    try:
        from dask.distributed import Client, KilledWorker, as_completed
    except ImportError:
        raise MissingExtraError("work on a Dask cluster", "cluster") from None
    with Client(scheduler) as client:  # type: ignore[no-untyped-call]
        futures = {
            client.submit(evaluate_block, study, block, pure=False): index for index, block in blocks.items()
        }
        try:
            for future in as_completed(futures):  # type: ignore[no-untyped-call]
                yield futures[future], future.result()
        except KilledWorker:
            raise JointscopeError(
                LOST.format("the cluster lost the same work's workers again and again")
            ) from None


def evaluate_sample(
    study: Study, sample: Array, folder: Path, *, workers: int = 2, scheduler: str | None = None
) -> Array:
    """Evaluate a whole sample, keeping every finished block in ``folder``.

    Args:
        study: What to evaluate.
        sample: Parameter sets [SI], shape (n, factors).
        folder: Where finished blocks are kept; those of an earlier, interrupted call are used again.
        workers: Processes on this machine.
        scheduler: Address of a Dask scheduler (``tcp://...``), instead of local processes.

    Returns:
        Shape (n, len(OUTPUTS)); bit for bit the same whatever evaluated it.
    """
    stem = _fingerprint(study, sample)
    path: Callable[[int], Path] = lambda index: folder / f"{stem}-{index:05d}.npy"  # noqa: E731
    blocks = {index: sample[at : at + BLOCK] for index, at in enumerate(range(0, len(sample), BLOCK))}
    waiting = {index: block for index, block in blocks.items() if not path(index).exists()}
    if scheduler is not None:
        finished = _distributed(study, waiting, scheduler)
    elif workers > 1:
        finished = _pooled(study, waiting, workers)
    else:
        finished = _serial(study, waiting)
    for index, table in track(finished, "evaluating", len(waiting)):
        with replaced_file(path(index)) as temporary, temporary.open("wb") as stream:
            np.save(stream, table)
    return np.vstack([np.load(path(index)) for index in blocks])
