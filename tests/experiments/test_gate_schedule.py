"""Work in turn: nothing begins before what it needs, the earlier goes first, and what fails takes nothing with it."""

import os
import threading
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor

import pytest

from jointscope.experiments.gates.schedule import Piece, in_turn


def done(pieces, workers):
    """(names in the order of their ends, results, names in the order of their beginnings, the most at once)."""
    began, at_once, most, lock = [], 0, 0, threading.Lock()

    def call(name, needs, open_door):
        nonlocal at_once, most
        with lock:
            began.append(name)
            at_once += 1
            most = max(most, at_once)
        assert all(need in ended for need in needs), f"{name} began before {needs}"
        open_door.wait(0.02)
        with lock:
            at_once -= 1
        if name == "bad":
            raise ValueError("bad")
        return name.upper()

    ended, results, door = [], {}, threading.Event()
    with ThreadPoolExecutor(workers) as pool:
        made = [
            Piece(name=name, call=(call, (name, needs, door)), after=frozenset(needs)) for name, needs in pieces
        ]
        for name in in_turn(made, pool, workers, results):
            ended.append(name)
    return ended, results, began, most


@pytest.mark.parametrize("workers", [1, 2, 3])
def test_what_others_need_comes_before_them_and_the_earlier_first(workers):
    """A chain, a piece listed before what it needs, and free ones; never more at once than there are hands."""
    pieces = [
        ("last", ["middle"]),
        ("middle", ["first"]),
        ("free", []),
        ("first", []),
        ("other", []),
        ("kept", []),
    ]
    ended, results, began, most = done(pieces, workers)
    assert sorted(ended) == sorted(name for name, _ in pieces)
    assert most <= workers
    assert began[0] == "free"
    assert results["last"].result() == "LAST"
    if workers == 1:
        assert began == ["free", "first", "middle", "last", "other", "kept"]


def test_what_fails_is_its_own_result_and_the_rest_is_done():
    """A failure is kept where it is asked for; what came after it is begun all the same."""
    ended, results, _, _ = done([("bad", []), ("after", ["bad"]), ("free", [])], 2)
    assert sorted(ended) == ["after", "bad", "free"]
    with pytest.raises(ValueError, match="bad"):
        results["bad"].result()


def test_a_process_that_dies_leaves_failures_and_no_hang():
    """What comes after a death of the pool fails at once, each piece with its own result."""
    results = {}
    pieces = [
        Piece(name="dies", call=(os._exit, (1,))),
        Piece(name="after", call=(abs, (-1,)), after=frozenset({"dies"})),
    ]
    with ProcessPoolExecutor(1) as pool:
        assert list(in_turn(pieces, pool, 1, results)) == ["dies", "after"]
    assert results["dies"].exception() is not None and results["after"].exception() is not None
