"""What a forward model said of runs, kept for when it is asked the same again.

A hypothesis is asked what it predicts whenever the noise by which it is judged is found anew, and a fit begins where
another one ended: a tenth of all simulations were of numbers that had been simulated before, by whole sets of runs. What is
found again is what was found, to the bit, so no answer depends on what was kept.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from threading import Lock
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect
    from jointscope.diagnosis.problem import PreparedRun, Problem

Vector = NDArray[np.float64]
Outputs = tuple[Vector, ...]

LIMIT = 200_000_000  # bytes of predictions that are kept


@dataclass(frozen=True, eq=False)
class _Said:
    """Outputs, and what they are of: an object that is kept here can't lend its identity to another one."""

    of: tuple[object, ...]
    outputs: Outputs
    size: int


@dataclass(eq=False)
class Memory:
    """The latest predictions, those asked for longest ago forgotten first."""

    limit: int = LIMIT
    _kept: OrderedDict[tuple[object, ...], _Said] = field(default_factory=OrderedDict)
    _size: int = 0
    _lock: Lock = field(default_factory=Lock)

    def outputs(
        self,
        run: PreparedRun,
        theta: Vector,
        effects: tuple[ActiveEffect, ...],
        problem: Problem,
        simulate: Callable[[], Outputs],
    ) -> Outputs:
        """What ``simulate`` says of this run, these numbers and these effects; arrays that can't be written to."""
        specs = tuple(effect.spec for effect in effects)
        values = tuple(effect.values for effect in effects)
        key = (id(run), id(problem), theta.tobytes(), tuple(map(id, specs)), values)
        with self._lock:
            said = self._kept.get(key)
            if said is not None:
                self._kept.move_to_end(key)
                return said.outputs
        outputs = tuple(y.view() for y in simulate())
        for y in outputs:
            y.flags.writeable = False
        said = _Said((run, problem, specs), outputs, sum(y.nbytes for y in outputs))
        with self._lock:
            if key not in self._kept:
                self._kept[key] = said
                self._size += said.size
            while self._size > self.limit:
                _, oldest = self._kept.popitem(last=False)
                self._size -= oldest.size
        return outputs
