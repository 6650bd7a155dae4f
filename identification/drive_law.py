"""The drive's speed law as data, and as ``model.json`` keeps it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from jointscope.errors import InputError

LAW_TERMS = ("proportional", "integral", "acceleration_feedforward", "velocity_feedforward")


@dataclass(frozen=True, kw_only=True)
class Drive:
    """A PI speed law with feed-forward and a torque limit, all on the motor shaft.

    Attributes:
        proportional: K_p [N m s/rad].
        integral: K_i [N m/rad].
        acceleration_feedforward: J_f [kg m^2].
        velocity_feedforward: b_f [N m s/rad].
        torque_limit: [N m]; ``None`` where no run reached it.
        standard_errors: Of the first four, in that order; 0 for a term that the runs do not need.
        residual: RMS of logged minus explained torque below 60 Hz [N m].
        log_noise: RMS of the log's own noise in that band, from what it holds near half its rate [N m].
        explained: 1 - residual variance over torque variance [-].
        runs: Ids of the runs used.
    """

    proportional: float
    integral: float
    acceleration_feedforward: float = 0.0
    velocity_feedforward: float = 0.0
    torque_limit: float | None = None
    standard_errors: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    residual: float = 0.0
    log_noise: float = 0.0
    explained: float = 1.0
    runs: tuple[str, ...] = ()

    @property
    def unexplained(self) -> float:
        """RMS of the torque that neither the law nor the log's noise accounts for [N m]."""
        return math.sqrt(max(self.residual**2 - 1.5 * self.log_noise**2, 0.0))

    @property
    def lacking(self) -> float:
        """The same over the torque's own rms about its mean [-]."""
        unlike = math.sqrt(max(1.0 - self.explained, 0.0))
        return unlike * self.unexplained / self.residual if self.residual > 0.0 else 0.0

    def to_json(self) -> dict[str, Any]:
        """As ``model.json`` keeps it under ``drive``."""
        units = ("N m s/rad", "N m/rad", "kg m^2", "N m s/rad")
        entries = {
            name: {
                "value": getattr(self, name),
                "unit": unit,
                "interval95": [getattr(self, name) - 1.96 * error, getattr(self, name) + 1.96 * error],
            }
            for name, unit, error in zip(LAW_TERMS, units, self.standard_errors, strict=True)
        }
        limit = None if self.torque_limit is None else {"value": self.torque_limit, "unit": "N m"}
        return {
            "law": "pi-speed",
            **entries,
            "torque_limit": limit,
            "residual": {"value": self.residual, "unit": "N m"},
            "log_noise": {"value": self.log_noise, "unit": "N m"},
            "explained": self.explained,
            "runs": list(self.runs),
        }


def drive_from_json(content: Mapping[str, Any], file: str = "model.json") -> Drive:
    """Read what ``Drive.to_json`` wrote.

    Raises:
        InputError: A key is missing or not a number.
    """
    try:
        limit = content.get("torque_limit")
        widths = [content[name]["interval95"][1] - content[name]["value"] for name in LAW_TERMS]
        return Drive(
            **{name: float(content[name]["value"]) for name in LAW_TERMS},
            torque_limit=None if limit is None else float(limit["value"]),
            standard_errors=tuple(float(width) / 1.96 for width in widths),  # type: ignore[arg-type]
            residual=float(content["residual"]["value"]),
            log_noise=float(content["log_noise"]["value"]),
            explained=float(content["explained"]),
            runs=tuple(content["runs"]),
        )
    except (KeyError, TypeError, ValueError, IndexError) as problem:
        raise InputError(file, "drive", f"can't be read: {problem!r}") from None
