"""Compiling ahead of the first simulation, where several processes are to share the work.

Each stepper is compiled where it is first called, ten seconds each. Processes that begin together would compile the same
ones side by side; given a share each, they find the others' on disk.
"""

from __future__ import annotations

from typing import Any

from numba import boolean, float64, int64

from jointscope.diagnosis.kernel.full_steps import simulate_full
from jointscope.diagnosis.kernel.scalar_steps import FIXED, FREE

_ROW, _TABLE, _SWITCHES = float64[::1], float64[:, ::1], int64[::1]
_SCALAR = (_ROW, _ROW, _SWITCHES, boolean, boolean, int64, _ROW, _ROW, _ROW, float64, float64, _TABLE)
_FULL = (_ROW, _ROW, _SWITCHES, _ROW, _ROW, _ROW, _ROW, float64, float64, _TABLE)


def compile_ahead(part: int, parts: int) -> int:
    """Compile, or read from disk, the steppers of one share of the work.

    Args:
        part: Which share, 0 to ``parts`` - 1.
        parts: Number of shares.

    Returns:
        How many steppers the share holds.
    """
    steppers: list[tuple[Any, tuple[Any, ...]]] = [(simulate_full, _FULL)]
    steppers += [(stepper, _SCALAR) for stepper in (*FREE.values(), *FIXED.values())]
    for stepper, signature in steppers[part::parts]:
        stepper.compile(signature)
    return len(steppers[part::parts])
