"""A small campaign on disk that every test can take and break."""

from pathlib import Path

import numpy as np
import pytest

TOML = """format = "jointscope-campaign/1"
title = "bench"

[rig]
topology = "two-inertia"
motion = "rotational"
plane = "vertical"
reduction_ratio = 141.0

[[run]]
id = "a"
experiment = "hammer"
brake = true
arm_angle = 0.0

[[run.stream]]
file = "a.csv"
sampling_rate = 1024.0
channels = [
  { column = "force", quantity = "force", unit = "N", location = "arm", radius = 0.8, role = "input" },
  { column = "acc", quantity = "linear-acceleration", unit = "m/s^2", location = "arm", radius = 0.95, role = "output" },
]
"""


def write_csv(path, columns):
    rows = np.column_stack(list(columns.values()))
    text = ",".join(columns) + "\n"
    path.write_text(text + "\n".join(",".join(repr(float(v)) for v in row) for row in rows) + "\n")


@pytest.fixture
def rng():
    return np.random.default_rng(20260317)


@pytest.fixture
def small(tmp_path: Path, rng):
    """A directory with a sound hammer campaign of 128 samples."""
    (tmp_path / "campaign.toml").write_text(TOML)
    write_csv(tmp_path / "a.csv", {"force": rng.standard_normal(128), "acc": rng.standard_normal(128)})
    return tmp_path
