"""What rings or clips on an arm: nothing at its null, and what the law says beyond."""

from __future__ import annotations

import math
import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import planar  # type: ignore[import-not-found]

from jointscope.diagnosis.arm.predict import predict_outputs
from jointscope.diagnosis.arm.prepare import prepare_arm
from jointscope.diagnosis.arm.recorder import recorder_faults
from jointscope.diagnosis.effects.spec import ActiveEffect


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    return prepare_arm(planar.swept(tmp_path_factory.mktemp("recorder")))


def read(problem, *actives):
    return predict_outputs(problem.arm_runs[0], problem.base.start, actives, problem)


def law(problem, variant):
    return next(s for s in recorder_faults(problem) if s.variant == variant)


@pytest.mark.parametrize(("variant", "null"), [("mount", (math.inf, 0.05)), ("clip", (math.inf,))])
def test_at_its_null_a_fault_is_none(swept, variant, null):
    plain, faulty = read(swept), read(swept, ActiveEffect(law(swept, variant), null))
    assert all(np.array_equal(a, b) for a, b in zip(plain, faulty, strict=True))


def test_a_mount_that_rings_amplifies_and_the_angle_stays(swept):
    """Far below its resonance a mount adds (f/f_a)^2 of what it carries; the encoder has none."""
    plain, ringing = read(swept), read(swept, ActiveEffect(law(swept, "mount"), (400.0, 0.05)))
    for y, z, probe in zip(plain, ringing, swept.arm_runs[0].probes, strict=True):
        if probe < 0:
            assert np.array_equal(y, z)
        else:
            assert 1.0 < float(np.std(z) / np.std(y)) < 1.05


def test_what_clips_is_flat_beyond_its_level_and_untouched_below(swept):
    level = 0.5 * max(float(np.max(np.abs(y))) for y in read(swept)[1:])
    plain, clipped = read(swept), read(swept, ActiveEffect(law(swept, "clip"), (level,)))
    for y, z, probe in zip(plain, clipped, swept.arm_runs[0].probes, strict=True):
        assert np.array_equal(z, y if probe < 0 else np.clip(y, -level, level))


def test_one_accelerometer_clips_and_the_other_does_not(swept):
    seat, _ = sorted({s for r in swept.arm_runs for s in r.sensors})
    level = 0.5 * max(float(np.max(np.abs(y))) for y in read(swept)[1:])
    plain, clipped = read(swept), read(swept, ActiveEffect(law(swept, f"clip, {seat}"), (level,)))
    for y, z, probe in zip(plain, clipped, swept.arm_runs[0].probes, strict=True):
        own = probe >= 0 and swept.arm_runs[0].sensors[probe] == seat
        assert np.array_equal(z, np.clip(y, -level, level) if own else y)
