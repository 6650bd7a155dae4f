"""``identification.json``: what an identification says, for machines (``jointscope-identification/1``)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from jointscope.identification.intervals import Estimate
from jointscope.identification.result import Identification, Level, Mode

FORMAT = "jointscope-identification/1"


def estimate_json(estimate: Estimate) -> dict[str, Any]:
    """Value, unit and headline interval, the two intervals it is the wider of beside it."""
    return {
        "value": estimate.value,
        "unit": estimate.unit,
        "interval95": [estimate.low, estimate.high],
        "interval95_model": list(estimate.model),
        "interval95_repeats": None if estimate.repeats is None else list(estimate.repeats),
    }


def _mode(mode: Mode) -> dict[str, Any]:
    return {
        "kind": mode.kind,
        "frequency_hz": mode.frequency.value,
        "frequency_interval95": [mode.frequency.low, mode.frequency.high],
        "damping_ratio": mode.damping_ratio.value,
        "damping_ratio_interval95": [mode.damping_ratio.low, mode.damping_ratio.high],
        "b1": list(mode.b1),
    }


def _level(level: Level) -> dict[str, Any]:
    return {
        "peak_input": [level.low, level.high],
        "hits": level.hits,
        "frequency_hz": level.frequency.value,
        "frequency_interval95": [level.frequency.low, level.frequency.high],
        "damping_ratio": level.damping_ratio.value,
        "damping_ratio_interval95": [level.damping_ratio.low, level.damping_ratio.high],
        "parameters": {name: estimate_json(value) for name, value in level.parameters.items()},
    }


def to_json(found: Identification, quality: Sequence[Mapping[str, Any]] = ()) -> dict[str, Any]:
    """The file's content; ``quality`` are the findings of ``inspect``, to which rejected hits are added."""
    own = [
        {"finding": row.finding, "run": row.run, "channel": None, "detail": row.detail}
        for row in found.rejected
        if not any(other.get("run") == row.run and other.get("finding") == row.finding for other in quality)
    ]
    lack = found.lack_of_fit
    fit = found.fit
    return {
        "format": FORMAT,
        "method": found.method,
        "band_hz": None if math.isnan(found.band[0]) else list(found.band),
        "parameters": {name: estimate_json(value) for name, value in found.parameters.items()},
        "modes": [_mode(mode) for mode in found.modes],
        "quality": [*quality, *own],
        "refused": [{"parameter": row.parameter, "reason": row.reason} for row in found.refused],
        "notes": list(found.notes),
        "residual": None
        if lack is None
        else {
            "verdict": lack.verdict,
            "share": lack.share,
            "f_ratio": lack.ratio,
            "probability": lack.probability,
        },
        "scatter": None if fit is None else {"gain": fit.scatter.gain, "timing_s": fit.scatter.timing},
        "levels": [_level(level) for level in found.levels],
        "level_probability": found.level_probability,
        "comparison": [
            {
                "method": row.method,
                "frequency_hz": row.frequency,
                "damping_ratio": row.damping_ratio,
                "stiffness": row.stiffness,
                "inertia": row.inertia,
                "damping": row.damping,
            }
            for row in found.comparison
        ],
        "log_frf_error": None if found.response is None else found.response.log_error,
    }
