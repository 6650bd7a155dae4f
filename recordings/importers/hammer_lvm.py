"""Two hammer hits on a structure of the University of Ljubljana (github ladisk/lvm_read, MIT).

Force and two accelerations at 1024 Hz, 8 s each, stacked in one LVM file. The structure is not documented. It rings at
several frequencies; the base is the simplest thing that rings, one inertia on a spring. The force's unit label ('g') is
no unit of force, so its scale is unknown.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from jointscope.recordings.importers.importer import Importer

FILE: Final = "long_single_header_multi_ch.lvm"
_HEAD: Final = """format = "jointscope-campaign/1"
title  = "Two hammer hits, force and two accelerations"
notes  = "lvm_read, data/long_single_header_multi_ch.lvm; the structure is not documented."

[rig]
topology      = "single-dof"
motion        = "translational"
plane         = "horizontal"
ground_spring = true                 # it rings, so something holds it: one mode is the base, further ones are physics
"""
_RUN: Final = """
[[run]]
id         = "hit-{number}"
experiment = "hammer"
repeat_of  = "hit"
role       = "{role}"

[[run.stream]]
file          = "{file}"
sampling_rate = 1024.0               # the file prints a step of 0.000977 s
channels = [
  # the file labels the force "g": no unit of force, so its scale is unknown
  {{ column = "{number}/F", quantity = "force", unit = "1", location = "load", role = "input" }},
  {{ column = "{number}/m_1", quantity = "acceleration", unit = "m/s^2", location = "load", role = "output" }},
  {{ column = "{number}/m_2", quantity = "acceleration", unit = "m/s^2", location = "load", role = "output" }},
]
"""


def _campaign(folder: Path, axis: int) -> str:
    del folder, axis
    return _HEAD + "".join(
        _RUN.format(number=number, role=role, file=FILE) for number, role in ((1, "estimate"), (2, "validate"))
    )


IMPORTER: Final = Importer(
    summary="two hammer hits, force and two accelerations, 1024 Hz, 8 s each",
    source="https://github.com/ladisk/lvm_read, folder data; MIT",
    files=(FILE,),
    campaign=_campaign,
)
