"""Stepping a held arm: commands in, states and sensors out, all in MuJoCo's own loop.

A sensor's value belongs to the state before the step, t_k = k h; states and sensors come back on that one clock. The
Euler step keeps velocities at t_k - h/2: they are centred here, and so is what a drive makes of them.
"""

from __future__ import annotations

from dataclasses import dataclass

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

from jointscope.errors import JointscopeError
from jointscope.models.arm.holding import HeldArm, Rest

Real = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Trajectory:
    """What a held arm did.

    Attributes:
        times: [s], shape (n,).
        position: Joint coordinates of the held model [rad], shape (n, nq).
        velocity: [rad/s], centred on ``times``, shape (n, nv).
        acceleration: [rad/s^2], shape (n, nv).
        sensors: Shape (n, nsensordata), SI.
    """

    held: HeldArm
    times: Real
    position: Real
    velocity: Real
    acceleration: Real
    sensors: Real

    def accelerometer(self, probe: str) -> Real:
        """Specific force along a probe's axis [m/s^2], shape (n,)."""
        return self.sensors[:, self.held.sensor(probe)][:, 2]

    def force(self, actuator: str) -> Real:
        """Torque of an actuator [N m at the output], shape (n,)."""
        force = self.sensors[:, self.held.sensor(actuator)][:, 0]
        model = self.held.model
        index = self.held.actuator(actuator)
        kv = -float(model.actuator_biasprm[index, 2])
        if kv == 0.0:
            return force
        dof = int(model.jnt_dofadr[model.actuator_trnid[index, 0]])
        centred: Real = force - kv * 0.5 * float(model.opt.timestep) * self.acceleration[:, dof]
        if not model.actuator_forcelimited[index]:
            return centred
        low, high = model.actuator_forcerange[index]
        return np.where((force <= low) | (force >= high), force, centred)

    def rotor(self, joint: str) -> Real:
        """Rotor angle at the output [rad], shape (n,)."""
        dof = self.held.rotor[self.held.arm.index(joint)]
        if dof < 0:
            raise JointscopeError(f"joint {joint}: its rotor doesn't move (hold {self.held.hold[joint]!r})")
        return self.position[:, _address(self.held, int(dof))]

    def rotor_speed(self, joint: str) -> Real:
        """Rotor speed at the output [rad/s], shape (n,)."""
        return self.velocity[:, int(self.held.rotor[self.held.arm.index(joint)])]

    def link(self, joint: str) -> Real:
        """Link angle [rad], shape (n,)."""
        k = self.held.arm.index(joint)
        angle = self.position[:, _address(self.held, int(self.held.reducer[k]))]
        return angle if self.held.rotor[k] < 0 else angle + self.rotor(joint)


def step_arm(held: HeldArm, rest: Rest, commands: Real) -> Trajectory:
    """Step from rest under ``commands``, shape (n, n_actuators), one row per step.

    Raises:
        JointscopeError: The motion diverged.
    """
    return step_arm_repeats(held, rest, commands[None])[0]


def step_arm_repeats(held: HeldArm, rest: Rest, commands: Real) -> list[Trajectory]:
    """Several runs from the same rest: ``commands`` of shape (runs, n, n_actuators)."""
    model = held.model
    workers = [mujoco.MjData(model) for _ in range(min(2, commands.shape[0]))]
    start = workers[0]
    start.qpos[:], start.qvel[:] = rest.qpos, 0.0
    full = mujoco.mjtState.mjSTATE_FULLPHYSICS
    state = np.zeros(mujoco.mj_stateSize(model, full))
    mujoco.mj_getState(model, start, state, full)
    padded = np.concatenate([commands, commands[:, -1:]], axis=1)  # a velocity is centred by the one that follows
    states, sensors = rollout.rollout(model, workers, state[None], np.ascontiguousarray(padded))
    if not np.all(np.isfinite(states[:, -1])):
        raise JointscopeError("the simulated arm diverged; take a smaller step or softer drives")
    n, h = commands.shape[1], model.opt.timestep
    q, v = slice(1, 1 + model.nq), slice(1 + model.nq, 1 + model.nq + model.nv)
    runs = []
    for run in range(states.shape[0]):
        position = np.concatenate([state[None, q], states[run, : n - 1, q]])
        early = np.concatenate([state[None, v], states[run, :n, v]])
        acceleration = np.diff(early, axis=0) / h
        velocity = early[:-1] + 0.5 * h * acceleration
        runs.append(Trajectory(held, np.arange(n) * h, position, velocity, acceleration, sensors[run, :n]))
    return runs


def _address(held: HeldArm, dof: int) -> int:
    return int(held.model.jnt_qposadr[held.model.dof_jntid[dof]])
