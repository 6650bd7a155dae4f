"""One take on the bench: the rig put at its start angle, held or braked, then driven."""

from __future__ import annotations

import copy
from collections.abc import Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.models.rig import brake
from jointscope.sim.equilibrium import Equilibrium, equilibrium
from jointscope.sim.physics import BASE, Physics
from jointscope.sim.stepping import Actuation, Controller, Machine, Trace, machine, march, stack_inputs, step

Real = NDArray[np.float64]

_SETTLING = 0.2  # s for which an actuation is fed its holding command before the take


@dataclass(frozen=True, eq=False)
class Setup:
    """A rig at rest, ready for a take.

    Attributes:
        machine: The compiled model.
        start: Its angles [rad], shape (nq,).
        motor_angle: q_s [rad].
        holding_torque: Motor torque that acts at rest [N m]; 0 with the brake on.
        physics: What is added to the base rig.
        speeds: At the start [rad/s], shape (nv,), where it does not begin at rest.
    """

    machine: Machine
    start: Real
    motor_angle: float
    holding_torque: float
    physics: Physics
    speeds: Real | None = None


def set_up(
    spec: mujoco.MjSpec, arm_angle: float, timestep: float, *, braked: bool = False, physics: Physics = BASE
) -> Setup:
    """Bring the rig to rest at ``arm_angle`` [rad], by the drive or, with ``braked``, on the brake.

    Args:
        spec: The base model.
        arm_angle: Of the arm from the horizontal [rad].
        timestep: h [s].
        braked: Whether the motor is held from then on.
        physics: What is added to the base rig.
    """
    spec = spec.copy()
    physics.edit(spec)
    free = machine(spec, timestep)
    law = physics.law(copy.copy(free.model)) if physics.law else None  # a law may renew dry friction in its model
    rest: Equilibrium = equilibrium(free, arm_angle, law)
    motor = int(free.model.joint("motor").qposadr[0])
    motor_angle = float(rest.q[motor])
    if not braked:
        return Setup(free, rest.q, motor_angle, rest.torque, physics)
    held = machine(brake(spec, motor_angle), timestep, held=motor_angle)
    return Setup(held, np.delete(rest.q, motor), motor_angle, 0.0, physics)


def take(
    setup: Setup, columns: Mapping[str, Real | float], steps: int, controller: Controller | None = None
) -> Trace:
    """Drive the rig from its rest, without :attr:`Physics.sensed`.

    Args:
        setup: The rig at rest.
        columns: Control by actuator name, shape (steps,); the motor's is a command.
        steps: [-].
        controller: A drive that commands the motor instead.
    """
    physics, machine = setup.physics, setup.machine
    inputs = stack_inputs(machine, columns, steps)
    law = physics.law(machine.model) if physics.law else None
    free = "motor" in machine.inputs
    actuation = physics.actuation(machine.timestep) if physics.actuation and free else None
    if law is None and actuation is None and controller is None:
        return step(machine, setup.start, inputs, speeds=setup.speeds)
    if actuation is not None:
        command = holding_command(setup)
        _settle(actuation, command, machine.timestep)
    return march(
        machine, setup.start, inputs, controller=controller, actuation=actuation, law=law, speeds=setup.speeds
    )


def holding_command(setup: Setup) -> float:
    """The commanded torque whose actuation, once settled, gives the holding torque [N m]."""
    if setup.physics.actuation is None or "motor" not in setup.machine.inputs:
        return setup.holding_torque
    h = setup.machine.timestep
    command = setup.holding_torque
    for _ in range(30):
        missing = setup.holding_torque - _settle(setup.physics.actuation(h), command, h)
        command += missing
        if abs(missing) < 1e-12:
            break
    return command


def _settle(actuation: Actuation, command: float, timestep: float) -> float:
    """Feed a constant command until the take begins; the torque that acts then [N m]."""
    steps = round(_SETTLING / timestep)
    torque = command
    for k in range(-steps, 0):
        torque = actuation(k * timestep, command)
    return torque
