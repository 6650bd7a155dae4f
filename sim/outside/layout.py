"""What is where: the integrator's state and what it stores, by index, and its steps."""

from __future__ import annotations

from typing import Final

from jointscope.sim.outside.physics import LOSSES, SLIPS

STEP: Final = 25e-6  # s
STORE: Final = 2  # steps between two stored samples
RATE: Final = 1.0 / (STEP * STORE)  # of what is stored [Hz]

# The state, by index.
Q_S: Final = 0
W_S: Final = 1
Q: Final = 2
W: Final = 3
ACTING: Final = 4  # the lagging torque [N m]
INTEGRAL: Final = 5  # of the speed's error [rad]
BRISTLE: Final = 6  # [rad]
SLIP: Final = 7  # Dahl elements [rad]
LOSS: Final = SLIP + SLIPS  # Maxwell elements [rad]
FURTHER: Final = LOSS + LOSSES  # the further body's coordinate
FURTHER_RATE: Final = FURTHER + 1
STRUCTURE: Final = FURTHER + 2  # of the grease: 1 at rest, 0 when sheared
CABLE: Final = FURTHER + 3  # [rad]
STATES: Final = FURTHER + 4

# What is stored, by index.
MOTOR_ANGLE: Final = 0  # q_s [rad]
MOTOR_RATE: Final = 1
ARM_ANGLE: Final = 2
ARM_RATE: Final = 3
ARM_ACCELERATION: Final = 4  # [rad/s^2]
CARRIED: Final = 5  # acceleration of what carries the sensor, beside the arm's own [m/s^2]
DRIVE: Final = 6  # the drive's torque as logged, at the output [N m]
JOINT_TORQUE: Final = 7  # T_S [N m]
STORED: Final = 8
