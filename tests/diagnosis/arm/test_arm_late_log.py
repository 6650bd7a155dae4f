"""A drive's log that stamps late moves whole: what drives the arm, and what its rotor is tied to."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parent))
import planar  # type: ignore[import-not-found]

from jointscope.diagnosis.arm.predict import predict_outputs
from jointscope.diagnosis.arm.prepare import prepare_arm
from jointscope.diagnosis.arm.recorder import recorder_faults
from jointscope.diagnosis.effects.spec import ActiveEffect

LATE = 6  # samples of the drive's log


@pytest.fixture(scope="module")
def campaign(tmp_path_factory):
    return planar.swept(tmp_path_factory.mktemp("late"))


def split(campaign, late):
    """The same with the drive's channels in a log of their own, ``late`` samples behind its stamps."""
    (run,) = campaign.runs
    (stream,) = run.streams
    daq = tuple(c for c in stream.channels if c.quantity == "linear-acceleration")
    drive = tuple(
        replace(c, samples=np.concatenate([np.full(late, c.samples[0]), c.samples[: c.samples.size - late]]))
        for c in stream.channels
        if c not in daq
    )
    streams = (replace(stream, channels=daq), replace(stream, file="e.npz", channels=drive))
    return prepare_arm(replace(campaign, runs=(replace(run, streams=streams),)))


def test_what_is_late_and_said_to_be_late_is_in_time(campaign):
    in_time, late = split(campaign, 0), split(campaign, LATE)
    delay = next(spec for spec in recorder_faults(late) if spec.name == "delay")
    rate = campaign.runs[0].streams[0].sampling_rate
    theta = in_time.base.start
    expected = predict_outputs(in_time.arm_runs[0], theta, (), in_time)
    found = predict_outputs(late.arm_runs[0], theta, (ActiveEffect(delay, (LATE / rate,)),), late)
    unsaid = predict_outputs(late.arm_runs[0], theta, (), late)
    for y, z, wrong, probe in zip(expected, found, unsaid, in_time.arm_runs[0].probes, strict=True):
        if probe >= 0:
            inner = slice(4 * LATE, -4 * LATE)
            size = float(np.std(y[inner]))
            assert float(np.std((z - y)[inner])) < 2e-3 * size
            assert float(np.std((wrong - y)[inner])) > 0.1 * size
