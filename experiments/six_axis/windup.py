"""The KR300's recordings: wind-up of axes 1-3 against motor torque (Weigand et al. 2021, MIT licence)."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path
from typing import Any

import numpy as np

from jointscope.identification.windup import WindupFit, fit_windup, statement, windup_records
from jointscope.recordings.importers.importer import import_data_set
from jointscope.recordings.reader import read_campaign


def data_directory() -> Path | None:
    """Where the public recordings lie: the environment's JOINTSCOPE_DATA, else ``../shared/data`` beside the checkout."""
    named = os.environ.get("JOINTSCOPE_DATA")
    folder = Path(named) if named else Path(__file__).resolve().parents[3] / "shared" / "data"
    return folder if folder.is_dir() else None


def kr300_windup(seed: int) -> dict[str, Any]:
    """Per axis: records, fit, statement; or the reason why there is nothing."""
    root = data_directory()
    if root is None or not (root / "kr300-weigand2021").is_dir():
        return {"missing": "set JOINTSCOPE_DATA to the folder that holds kr300-weigand2021"}
    axes = []
    with tempfile.TemporaryDirectory() as folder:
        for axis in (1, 2, 3):
            files = [root / "kr300-weigand2021" / f"trajectory-{name}.mat" for name in "ABC"]
            campaign = read_campaign(
                import_data_set("kr300-weigand2021", files, Path(folder) / str(axis), axis=axis)
            )
            records, inertia = windup_records(campaign)
            fit = fit_windup(records, inertia, rng=np.random.default_rng(seed))
            axes.append({"axis": axis, "fit": fit, "authors": campaign.rig.stiffness_reference, "records": records,
                         "statement": statement(fit, f"axis {axis}")})  # fmt: skip
    return {"axes": axes}


def as_numbers(windup: dict[str, Any]) -> dict[str, Any]:
    """What goes into JSON."""
    if "missing" in windup:
        return windup
    rows = []
    for axis in windup["axes"]:
        fit: WindupFit = axis["fit"]
        rows.append(
            {
                "axis": axis["axis"], "authors_stiffness": axis["authors"], "stiffness": fit.stiffness.value,
                "interval95": [_finite(fit.stiffness.low), _finite(fit.stiffness.high)],
                "plain_stiffness": fit.plain_stiffness.value,
                "plain_interval95": [_finite(fit.plain_stiffness.low), _finite(fit.plain_stiffness.high)],
                "plain_explained": fit.plain_explained, "skew_s": fit.skew.value, "skew_share": fit.skew_share,
                "explained": fit.explained, "left_rad": fit.left, "statement": axis["statement"],
            }
        )  # fmt: skip
    return {"axes": rows}


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
