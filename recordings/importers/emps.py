"""EMPS: an electro-mechanical positioning system (Janot, Gautier and Brunot, 2019; nonlinearbenchmark.org).

A DC motor drives a carriage through a ball screw under position and speed feedback. The authors model it as one
inertia; the force on the carriage is the control voltage times a printed gain.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from scipy.io import loadmat

from jointscope.recordings.importers.importer import Importer

_RUN: Final = """
[[run]]
id         = "{id}"
experiment = "speed-motion"
role       = "{role}"
initial    = "estimate"              # the carriage moves at the first sample

[[run.stream]]
file          = "{file}"
sampling_rate = 1000.0
channels = [
  # control signal in volts; the force is gtau times it (gtau as the file holds it, N/V)
  {{ column = "vir", quantity = "force", unit = "1", scale = {gain!r}, location = "load", role = "input" }},
  {{ column = "qm", quantity = "position", unit = "m", location = "load", role = "output" }},
]
# qg, the reference position in m{extra}, is in the file too; no channel names it
"""
_HEAD: Final = """format = "jointscope-campaign/1"
title  = "EMPS, electro-mechanical positioning system"
notes  = "Janot, Gautier, Brunot: Data set and reference models of EMPS, 2019. Closed-loop positioning, 1 kHz."

[rig]
topology      = "single-dof"
motion        = "translational"
plane         = "horizontal"
ground_spring = false
"""


def _campaign(folder: Path, axis: int) -> str:
    del axis
    takes = (
        ("estimation", "estimate", "DATA_EMPS.mat", ""),
        ("pulses", "validate", "DATA_EMPS_PULSES.mat", ", with pulses_N, the times of the force pulses,"),
    )
    return _HEAD + "".join(
        _RUN.format(id=id_, role=role, file=file, extra=extra, gain=float(loadmat(folder / file)["gtau"].item()))
        for id_, role, file, extra in takes
    )


IMPORTER: Final = Importer(
    summary="DC motor, ball screw, carriage: control voltage and position, 1 kHz, two takes of 24.8 s",
    source="https://www.nonlinearbenchmark.org; free for research",
    files=("DATA_EMPS.mat", "DATA_EMPS_PULSES.mat"),
    campaign=_campaign,
)
