"""How the kernel is compiled and kept on disk.

Compiled code is kept per source file, with everything it calls compiled in, and the compiler does not notice when a called
law in another file changes. So the name under which it is kept holds a digest of all the kernel's files: a change in any
of them compiles all anew.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import ParamSpec, TypeVar

import numpy as np
from numba import njit
from numpy.typing import NDArray

Given = ParamSpec("Given")
R = TypeVar("R")
Real = NDArray[np.float64]


def digest(folder: Path) -> str:
    """Eight hexadecimal digits that change with the name or text of any source file in ``folder``."""
    found = hashlib.sha256()
    for file in sorted(folder.glob("*.py")):
        found.update(file.name.encode() + b"\0" + file.read_bytes() + b"\0")
    return found.hexdigest()[:8]


SOURCES = digest(Path(__file__).parent)


def compiled(function: Callable[Given, R]) -> Callable[Given, R]:
    """The function compiled, and kept on disk under its name and ``SOURCES``."""
    return _jit(function, False)


def inlined(function: Callable[Given, R]) -> Callable[Given, R]:
    """The same, put into each place that calls it by the optimiser: the front end would take three times as long."""
    return _jit(function, True)


def _jit(function: Callable[Given, R], within: bool) -> Callable[Given, R]:
    function.__qualname__ = f"{function.__name__}_{SOURCES}"
    jit = njit(
        cache=True, nogil=True, error_model="numpy", fastmath={"contract", "nsz", "arcp"}, forceinline=within
    )
    made: Callable[Given, R] = jit(function)
    return made
