"""The constants of one elastic joint and of what disturbs it, as one record that compiled code can read.

Everything is at the joint's output and in SI; of a sliding rig read m for rad, N for N m and kg for kg m^2. A law whose
size is 0 is absent.
"""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Final, TypeVar, cast

import numpy as np

SLIPS: Final = 4  # Dahl elements
LOSSES: Final = 6  # Maxwell elements
STANDARD_GRAVITY: Final = 9.80665  # m/s^2

RIGID: Final = 0.0  # nothing beside the arm
OUTER_BODY: Final = 1.0  # a further body of the arm on a spring
CARRIER: Final = 2.0  # a mount or a neighbour that moves along

Change = float | tuple[float, ...]
Constants = TypeVar("Constants", "Physics", "Control")


@dataclass(frozen=True, kw_only=True)
class Physics:
    """Constants of the equations in ``equations``, whose symbols are given here."""

    motor_inertia: float  # J_M, rotor and reducer times n^2 [kg m^2]
    load_inertia: float  # J_L [kg m^2]
    stiffness: float  # K [N m/rad]
    damping: float  # c [N m s/rad]
    motor_damping: float  # b_m [N m s/rad]
    load_damping: float  # b_l [N m s/rad]
    gravity: float  # m g r, the torque at the horizontal [N m]
    ratio: float  # n
    gain: float = 1.0  # acting torque over logged torque
    lag: float = 0.0  # time constant of the acting torque behind the logged one [s]
    warming: float = 0.0  # share of the torque constant that is lost when warm
    warming_time: float = 1.0  # [s]

    motor_friction: float = 0.0  # T [N m]
    motor_breakaway: float = 0.0  # T_s [N m]
    motor_stribeck_speed: float = 0.0  # w_s [rad/s]; 0: no fall
    motor_asymmetry: float = 0.0  # a: T (1 + a) forwards, T (1 - a) backwards
    motor_smoothing: float = 1.0  # w_e [rad/s]
    motor_bristles: float = 0.0  # 1: LuGre instead of tanh
    bristle_stiffness: float = 0.0  # sigma_0 [N m/rad]
    bristle_damping: float = 0.0  # sigma_1 [N m s/rad]
    load_friction: float = 0.0
    load_breakaway: float = 0.0
    load_stribeck_speed: float = 0.0
    load_asymmetry: float = 0.0
    load_smoothing: float = 1.0
    loaded_friction: float = 0.0  # mu: friction mu |T_S| [1]
    loaded_smoothing: float = 1.0  # [rad/s]
    drag: float = 0.0  # torque over speed squared [N m s^2/rad^2]

    gap: float = 0.0  # total play [rad]
    cubic: float = 0.0  # K_3 [N m/rad^3]
    soft_torque: float = 0.0  # T_1 of a stiffness that is soft at low torque [N m]
    soft_width: float = 0.0  # d_1 [rad]; 0: none
    slip_count: float = 0.0
    slip_stiffness: tuple[float, ...] = (0.0,) * SLIPS  # [N m/rad]
    slip_width: tuple[float, ...] = (1.0,) * SLIPS  # [rad]
    loss_count: float = 0.0
    loss_stiffness: tuple[float, ...] = (0.0,) * LOSSES  # [N m/rad]
    loss_time: tuple[float, ...] = (1.0,) * LOSSES  # [s]
    stiffness_rate: float = 0.0  # relative change of K per second of the run [1/s]
    turning_stiffness: float = 0.0  # share of K that turns with the motor
    turning_order: float = 0.0  # per motor turn
    turning_phase: float = 0.0  # [rad]

    error: float = 0.0  # amplitude of the kinematic error [rad]
    error_order: float = 0.0
    error_phase: float = 0.0  # [rad]
    error_of_output: float = 0.0  # 1: its order counts output turns, not motor turns
    error_second: float = 0.0  # relative size of the second harmonic
    error_third: float = 0.0
    ripple: float = 0.0  # amplitude [N m]
    ripple_order: float = 0.0  # per motor turn
    ripple_phase: float = 0.0  # [rad]
    ripple_second: float = 0.0

    further: float = RIGID  # which further body moves: RIGID, OUTER_BODY or CARRIER
    further_inertia: float = 0.0  # [kg m^2], of a mount [kg]
    further_stiffness: float = 0.0
    further_damping: float = 0.0
    coupling: float = 0.0  # inertia between the carrier's motion and the arm's [kg m^2 or kg m]
    lever: float = 0.0  # what the carrier's acceleration adds to the accelerometer's [m or 1]
    coupling_angle: float = 0.0  # arm angle at which the coupling is full [rad]
    stop_angle: float = 0.0  # [rad]
    stop_stiffness: float = 0.0  # [N m/rad]
    stop_damping: float = 0.0  # [N m s/rad]
    stop_side: float = 1.0  # 1: above, -1: below
    shaking: float = 0.0  # amplitude from outside [N m, of a moving floor m/s^2]
    shaking_frequency: float = 0.0  # [Hz]
    shaking_phase: float = 0.0  # [rad]
    shaken_moment: float = 0.0  # m r: the floor moves [kg m]; 0: a torque on the arm

    brake_torque: float = 0.0  # beyond it a held shaft creeps [N m]; 0: it holds
    brake_damping: float = 1.0  # [N m s/rad]
    cable_torque: float = 0.0  # [N m]
    cable_width: float = 1.0  # [rad]
    cable_bend: float = 0.0  # how much more on one side of the travel
    grease: float = 0.0  # viscosity at rest [N m s/rad]
    grease_recovery: float = 1.0  # [s]
    grease_shear: float = 1.0  # [rad]


@dataclass(frozen=True, kw_only=True)
class Control:
    """What holds or drives the joint in one run, per output unit.

    Attributes:
        mode: One of ``HELD``, ``TORQUE``, ``MOTOR_SPEED``, ``LOAD_SPEED``.
        proportional: Of the speed loop [N m s/rad].
        integral: Of the speed loop [N m/rad].
        hold: Weak position hold of a torque run [N m/rad].
        hold_rate: [N m s/rad].
        reference: Angle that is held; the cable's side is counted from it too [rad].
        preload: The drive's torque at the start [N m].
        push: Torque about the joint per newton of a held run's programme [m].
    """

    mode: float
    proportional: float = 0.0
    integral: float = 0.0
    hold: float = 0.0
    hold_rate: float = 0.0
    reference: float = 0.0
    preload: float = 0.0
    push: float = 0.0


HELD: Final = 0.0  # the motor's shaft is braked; the programme is the hammer's force [N]
TORQUE: Final = 1.0  # the programme is a torque [N m]
MOTOR_SPEED: Final = 2.0  # the programme is w_s [rad/s]
LOAD_SPEED: Final = 3.0  # no elasticity: the programme is the load's speed


def packed(constants: Constants) -> Constants:
    """A NumPy record with the fields of ``constants``: what the compiled equations take in its place."""
    layout = []
    values = []
    for field in fields(constants):
        value = getattr(constants, field.name)
        layout.append((field.name, "f8", (len(value),)) if isinstance(value, tuple) else (field.name, "f8"))
        values.append(value)
    return cast(Constants, np.array([tuple(values)], dtype=layout).view(np.recarray)[0])
