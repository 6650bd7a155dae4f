r"""The drive's loop closed around the model, with the logged torque as a measured input through it.

Replayed open loop, a torque that is off by half a bit moves the arm by half a radian in seconds, even through a perfect
model. The drive would not have let it: what it asks for depends on the speed. With alpha the law's share,

    T_e = T_log + alpha (law(w_c, n q_s') - T_log).

What disturbs the machine inside the loop (friction, a wrong inertia) reaches the prediction divided by 1 + alpha P L,
P the plant and L the law; noise of the log by (1 - alpha); torque that the law does not explain by alpha. So alpha
follows from what the drive's identification left over: near 1 where the law explains the torque down to the log's own
noise, small where it does not. docs/decisions/2026-11-21-closed-loop-prediction.md holds the measurement.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from jointscope.identification.drive_law import Drive
from jointscope.prediction.integrate import Loop
from jointscope.recordings.bandlimited import Bandlimited

Real = NDArray[np.float64]

SMALLEST_SHARE = 0.1  # still removes drift within half a second at the gains of a usual drive
LARGEST_SHARE = 0.9  # a law is never the whole truth


def law_share(drive: Drive) -> float:
    """alpha [-] from the unexplained torque r and the log's noise n: 1/(1 + r/(2 n)), between 0.1 and 0.9."""
    ratio = drive.unexplained / max(2.0 * drive.log_noise, 1e-12)
    return min(max(1.0 / (1.0 + ratio), SMALLEST_SHARE), LARGEST_SHARE)


def close(
    drive: Drive,
    command: Bandlimited,
    t: Real,
    hold: float,
    *,
    logged: bool,
    share: float | None = None,
) -> Loop:
    """The loop that ``drive`` closes.

    Args:
        drive: The law.
        command: w_c [rad/s, motor shaft] as a function of time [s].
        t: Steps and half steps [s], shape (2 n - 1,).
        hold: T_0, torque that holds the arm at rest [N m, motor shaft].
        logged: Whether the run logged its torque; without it the law acts alone.
        share: alpha [-]; ``None``: as ``law_share`` says.
    """
    limit = math.inf if drive.torque_limit is None else drive.torque_limit
    law = np.array(
        [
            drive.proportional,
            drive.integral,
            drive.acceleration_feedforward,
            drive.velocity_feedforward,
            hold,
            limit,
        ]
    )
    alpha = law_share(drive) if share is None else share
    return Loop(command=command(t), command_rate=command(t, 1), law=law, share=alpha if logged else 1.0)
