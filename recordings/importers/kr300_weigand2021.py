"""KUKA KR300 Ultra SE with encoders on both sides of the gearboxes of axes 1 to 3 (Weigand et al., IROS 2021; MIT).

Each axis is its own campaign of three trajectories. Motor angle and speed are recorded referred to the joint, the
torque at the motor. Gear ratio, motor inertia and the authors' stiffness are printed in the set's ``para``.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Final

import numpy as np
from scipy.io import loadmat

from jointscope.recordings.importers.importer import Importer

# TOML keeps a table on its line, so these lines are as long as they are
# ruff: noqa: E501
_HEAD: Final = """format = "jointscope-campaign/1"
title  = "KUKA KR300 Ultra SE, axis {axis}"
notes  = "Weigand et al., Robot_Identification, trajectories A, B, C, 10 s FF, 4 ms. All six axes move at once; arm_angle is the robot's own joint angle, whose zero is not documented against the horizontal."

[rig]
topology            = "two-inertia"
motion              = "rotational"
plane               = "{plane}"{why}
reduction_ratio     = {ratio!r}
motor_inertia       = {inertia!r}        # J_mr of the set
stiffness_reference = {stiffness!r}      # c_rad of the set
"""
_RUN: Final = """
[[run]]
id         = "trajectory-{name}"
experiment = "speed-motion"
arm_angle  = {angle!r}
role       = "{role}"

[[run.stream]]
file          = "trajectory-{name}.mat"
sampling_rate = 250.0
channels = [
  {{ column = "rec.act_torque_abs_nm[{row}]", quantity = "torque", unit = "N m", location = "motor", role = "input" }},
  # the file's motor angle and speed are degrees at the joint: times the ratio, in rad
  {{ column = "rec.act_pos_mot_deg[{row}]", quantity = "angle", unit = "1", scale = {scale!r}, location = "motor", role = "output" }},
  {{ column = "rec.act_vel_mot_deg_per_s[{row}]", quantity = "angular-velocity", unit = "1", scale = {scale!r}, location = "motor", role = "output" }},
  {{ column = "rec.act_pos_se_deg[{row}]", quantity = "angle", unit = "deg", location = "arm", role = "output" }},
]
"""


def _campaign(folder: Path, axis: int) -> str:
    row = axis - 1
    names = (("A", "estimate"), ("B", "estimate"), ("C", "validate"))
    text = ""
    for name, role in names:
        with warnings.catch_warnings():  # the authors' MATLAB object can't be read and isn't needed
            warnings.simplefilter("ignore")
            file = loadmat(
                folder / f"trajectory-{name}.mat", struct_as_record=False, squeeze_me=True,
                variable_names=["rec", "para"],
            )  # fmt: skip
        para, rec = file["para"], file["rec"]
        ratio = float(para.u[row])
        if not text:
            upright = axis == 1
            text = _HEAD.format(
                axis=axis, ratio=ratio, inertia=float(para.J_mr[row]),
                stiffness=float(np.atleast_1d(para.c_rad_ode)[row]),
                plane="horizontal" if upright else "vertical",
                why="      # axis 1 is upright: gravity does not act about it" if upright else "",
            )  # fmt: skip
        text += _RUN.format(
            name=name, role=role, row=row, scale=ratio * math.pi / 180.0,
            angle=math.radians(float(rec.act_pos_se_deg[row, 0])),
        )  # fmt: skip
    return text


IMPORTER: Final = Importer(
    summary="six-axis robot, motor-side and link-side encoders and motor torque, three takes of 10 s at 250 Hz",
    source="https://github.com/JonasWeigand/Robot_Identification; MIT",
    files=("trajectory-A.mat", "trajectory-B.mat", "trajectory-C.mat"),
    campaign=_campaign,
    axes=(1, 2, 3),
)
