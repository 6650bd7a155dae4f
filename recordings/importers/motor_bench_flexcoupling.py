"""Motor bench with a flexible coupling (Hori-Fujimoto Lab, T. Beauduin, W. Ohnishi; github FdiTools, MIT).

Two inertias, encoders on both, periodic multisine current: 20 periods of 1 s at 2.5 kHz. The channels are declared as
the files hold them; the first period, a transient that the authors drop too, is left out by ``window``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Final

from jointscope.recordings.importers.importer import Importer

_HEAD: Final = """format = "jointscope-campaign/1"
title  = "Motor bench with flexible coupling"
notes  = "FdiTools, MultisineTypeA (full, 11-250 Hz) and TypeB (odd, sparse). Neither inertia nor torque constant is printed."

[rig]
topology        = "two-inertia"
motion          = "rotational"
plane           = "horizontal"
reduction_ratio = 1.0                # motor and load share a shaft through the coupling
"""
_RUN: Final = """
[[run]]
id         = "multisine-{name}"
experiment = "torque-sweep"
role       = "{role}"
initial    = "estimate"              # periodic steady state

[[run.stream]]
file          = "MultisineType{name}.mat"
sampling_rate = 2500.0
window        = [1.0, 20.0]          # the first period is the transient
channels = [
  {{ column = "iq_adx", quantity = "current", unit = "A", location = "motor", role = "input" }},
  {{ column = "theta_mx", quantity = "angle", unit = "rad", location = "motor", role = "output" }},
  {{ column = "theta_my", quantity = "angle", unit = "rad", location = "arm", role = "output" }},
  {{ column = "omega_max", quantity = "angular-velocity", unit = "rad/s", location = "motor", role = "output" }},
  {{ column = "omega_may", quantity = "angular-velocity", unit = "rad/s", location = "arm", role = "output" }},
]
"""


def _campaign(folder: Path, axis: int) -> str:
    del folder, axis
    return _HEAD + "".join(_RUN.format(name=n, role=r) for n, r in (("A", "estimate"), ("B", "validate")))


IMPORTER: Final = Importer(
    summary="motor bench with flexible coupling: motor current and both encoders, two multisines of 20 s at 2.5 kHz",
    source="https://github.com/HoriFujimotoLab/FdiTools, folder Examples; MIT",
    files=("MultisineTypeA.mat", "MultisineTypeB.mat"),
    campaign=_campaign,
)
