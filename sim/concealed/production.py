"""A draw of cases concealed in MuJoCo."""

from __future__ import annotations

from dataclasses import asdict
from functools import partial
from pathlib import Path

from jointscope.sim.concealed.draw import Order, case_name, make_case
from jointscope.sim.draws import Draw, make_draw


def produce(order: Order, folder: Path, workers: int, scheduler: str | None = None) -> str:
    """Write ``order``'s cases into ``folder`` and seal their truth (see :func:`jointscope.sim.draws.make_draw`)."""
    names = tuple(case_name(order, index) for index in range(order.cases))
    return make_draw(Draw(asdict(order), names, partial(make_case, order)), folder, workers, scheduler)
