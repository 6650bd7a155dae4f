"""How well K, J_L and c are known from the takes so far, and how many more hits would do."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from jointscope.errors import RefusedError
from jointscope.experiments.watch.judging import Take
from jointscope.identification.hammer import HammerPlan
from jointscope.identification.identify import identify
from jointscope.identification.intervals import Estimate
from jointscope.identification.result import Identification
from jointscope.models.parameters import ParameterError
from jointscope.recordings.campaign import Campaign

SYMBOLS: Final = (("K", "stiffness"), ("J_L", "inertia"), ("c", "damping"))
FEWEST: Final = 3  # hits without which their scatter isn't known
MOST: Final = 200  # hits; asking for more would be no advice


@dataclass(frozen=True, kw_only=True)
class Known:
    """One of the three.

    Attributes:
        symbol, name: "K", "stiffness".
        unit: Of ``value`` and ``interval``.
        value, interval: Estimate and 95 % interval; ``None`` where it can't be had yet.
        more_hits: Further hits that would bring the half width to what is wanted; 0 when it is there, ``None`` where
            hits alone can't.
        missing: What to do, in words; empty when it is there.
    """

    symbol: str
    name: str
    unit: str = ""
    value: float | None = None
    interval: tuple[float, float] | None = None
    more_hits: int | None = None
    missing: str = ""

    @property
    def half_width(self) -> float:
        """Of the interval, relative [-]; infinite where there is none."""
        if self.interval is None or not self.value:
            return math.inf
        return 0.5 * (self.interval[1] - self.interval[0]) / abs(self.value)


def known_so_far(campaign: Campaign, takes: Sequence[Take], within: float) -> tuple[Known, ...]:
    """K, J_L and c.

    Args:
        campaign: With the nameplate; its runs are not used.
        takes: Usable ones.
        within: Relative half width of the 95 % interval that is wanted [-].
    """
    if campaign.rig.topology == "arm":
        why = "several joints at once: jointscope arm identify takes the whole campaign"
        return tuple(Known(symbol=symbol, name=name, missing=why) for symbol, name in SYMBOLS)
    if not takes:
        why = "no usable take yet: hit the arm with the motor's brake on"
        return tuple(Known(symbol=symbol, name=name, missing=why) for symbol, name in SYMBOLS)
    runs = tuple(take.run for take in takes)
    found, why = None, ""
    try:
        found = identify(Campaign(path=campaign.path, rig=campaign.rig, runs=runs), HammerPlan(levels=False))
    except (RefusedError, ParameterError, np.linalg.LinAlgError) as problem:
        why = str(problem)
    if found is None:
        return tuple(Known(symbol=symbol, name=name, missing=why) for symbol, name in SYMBOLS)
    hits = sum(take.run.experiment == "hammer" for take in takes) - len(found.rejected)
    swept = any(take.run.experiment == "torque-sweep" for take in takes)
    return tuple(_known(symbol, name, found, hits, within, swept) for symbol, name in SYMBOLS)


def _known(symbol: str, name: str, found: Identification, hits: int, within: float, swept: bool) -> Known:
    estimate = found.parameters.get(name)
    total = found.parameters.get("damping_total") if name == "damping" else None
    if estimate is None and total is not None:
        estimate, name = total, "damping_total"
    if estimate is None:
        why = next((row.reason for row in found.refused if row.parameter == name), "not in these recordings")
        few = FEWEST - hits if 0 < hits < FEWEST else None
        return Known(symbol=symbol, name=name, missing=why, more_hits=few)
    half = 0.5 * (estimate.high - estimate.low)
    reached = abs(half / estimate.value) <= within if estimate.value else False
    more: int | None = 0 if reached else _more(half / abs(estimate.value or math.nan), hits, within)
    missing = "" if reached else _advice(more, within)
    if not reached and total is not None and total is not estimate and _narrow(total, half):
        more = None
        share = 100.0 * 0.5 * (total.high - total.low) / total.value
        sweeps = "jointscope diagnose parts them by the sweeps" if swept else "a torque sweep does"
        missing = f"c + b_l is known to {share:.2g} %, but hits don't part the two; {sweeps}"
    return Known(
        symbol=symbol, name=name, unit=estimate.unit, value=estimate.value, interval=(estimate.low, estimate.high),
        more_hits=more, missing=missing,
    )  # fmt: skip


def _narrow(total: Estimate, half: float) -> bool:
    return 0.5 * (total.high - total.low) < 0.5 * half


def _more(relative: float, hits: int, within: float) -> int | None:
    """Hits beyond ``hits`` at which a half width that falls with the square root of their number reaches ``within``."""
    if hits < 1 or not math.isfinite(relative):
        return None
    more = math.ceil(hits * ((relative / within) ** 2 - 1.0))
    return more if more <= MOST else None


def _advice(more: int | None, within: float) -> str:
    wanted = f"{100.0 * within:.3g} %"
    if more is None:
        return f"more of the same hits won't reach {wanted}: more level, a longer record, a better-placed sensor"
    return f"about {more} more hit{'s' if more != 1 else ''} of this kind for {wanted}"
