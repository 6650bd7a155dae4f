"""Work that waits for other work, done by several processes: each piece starts as soon as what it needs is done."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, BrokenExecutor, Executor, Future, wait
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Piece:
    """One piece of work.

    Attributes:
        name: What others call it in their ``after``, and where its result is found.
        call: A function of a module, and what it is called with.
        after: Names of the pieces that must have ended before, whether or not they went well.
    """

    name: Hashable
    call: tuple[Callable[..., Any], tuple[object, ...]]
    after: frozenset[Hashable] = frozenset()


def in_turn(
    pieces: Sequence[Piece], pool: Executor, at_once: int, results: dict[Hashable, Future[Any]]
) -> Iterator[Hashable]:
    """Do all ``pieces``, the earlier first where there is a choice; yields the name of each that has ended.

    Args:
        pieces: Those to be done; what a piece comes after and is not among them counts as done.
        pool: Does them.
        at_once: How many it has hands for.
        results: Filled as they end, by name.
    """
    waiting = list(pieces)
    running: dict[Future[Any], Hashable] = {}
    while waiting or running:
        open_names = {piece.name for piece in waiting} | set(running.values())
        ready = [piece for piece in waiting if not piece.after & open_names]
        for piece in ready[: at_once - len(running)]:
            waiting.remove(piece)
            running[_begun(pool, piece)] = piece.name
        ended, _ = wait(running, return_when=FIRST_COMPLETED)
        for future in ended:
            name = running.pop(future)
            results[name] = future
            yield name


def _begun(pool: Executor, piece: Piece) -> Future[Any]:
    """The piece under way; failed at once where a process that died took the pool with it."""
    function, arguments = piece.call
    try:
        return pool.submit(function, *arguments)
    except BrokenExecutor as problem:
        failed: Future[Any] = Future()
        failed.set_exception(problem)
        return failed
