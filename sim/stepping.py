"""Stepping a MuJoCo model over input arrays and reading it out at the right times; everything simulated passes here.

MuJoCo's Euler step is a leapfrog once its damping is centred: the angle q_k belongs to t_k = k h, the velocity v_k to
t_k - h/2, and the acceleration a_k = (v_{k+1} - v_k)/h to t_k. Damping evaluated at v_k lags by h/2; adding h/2 times
each damping coefficient to the inertia of the same coordinate, (M + h D/2) a = f - D v_k, makes it the damping at t_k
exactly (v(t_k) = v_k + h a_k / 2) without touching the motion that is integrated. Second order, symmetric in time;
the error is measured by ``jointscope selfcheck`` and the choice argued in docs/decisions/2026-11-21-integrator.md.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import mujoco
import numpy as np
from mujoco import rollout
from numpy.typing import NDArray

Real = NDArray[np.float64]

TIMESTEP = 5e-5  # s
MOTOR_ON_LOAD = "motor on load"  # actuator of a single inertia whose motor is rigid with it
_FULL_STATE = mujoco.mjtState.mjSTATE_FULLPHYSICS
_VELOCITIES = (mujoco.mjtSensor.mjSENS_JOINTVEL, mujoco.mjtSensor.mjSENS_TENDONVEL)


@dataclass(frozen=True, eq=False)
class Machine:
    """A compiled model, ready to be stepped; its MjModel is never changed.

    Attributes:
        timestep: h [s].
        inputs: Column of each actuator, by name, in the input array.
        outputs: Columns of each sensor, by name, in the sensor array.
        velocities: Names of the sensors that read a velocity of one coordinate.
        held: Angle at which the brake holds the motor [rad]; 0 for a motor that is free.
    """

    model: mujoco.MjModel = field(repr=False)
    timestep: float
    inputs: Mapping[str, int]
    outputs: Mapping[str, slice]
    velocities: frozenset[str]
    held: float = 0.0


@dataclass(frozen=True, eq=False)
class Trace:
    """What a machine did, on the stepping grid.

    Attributes:
        times: t_k [s], shape (n,).
        inputs: What was commanded, by actuator name, shape (n,).
        signals: By sensor name, all at ``times``: shape (n,), or (n, 3) for accelerometers. A velocity sensor
            ``"x speed"`` also gives ``"x acceleration"``.
    """

    times: Real
    inputs: Mapping[str, Real]
    signals: Mapping[str, Real]

    @property
    def timestep(self) -> float:
        """h [s]."""
        return float(self.times[1] - self.times[0])


class ForceLaw(Protocol):
    """Generalized forces beyond the model, evaluated once per step in order of time, so it may keep states of its own."""

    def __call__(self, t: float, q: Real, qd: Real) -> Real:
        """Force on every coordinate [N m], shape (nv,), at time ``t`` [s], angles ``q`` [rad], speeds ``qd`` [rad/s]."""


@runtime_checkable
class Hearing(ForceLaw, Protocol):
    """A law that depends on what drives the machine."""

    def hear(self, data: mujoco.MjData) -> None:
        """The machine with this step's control and the last step's forces, shown before the law is asked."""


class Actuation(Protocol):
    """What stands between the torque that is commanded (and logged) and the torque that acts."""

    def __call__(self, t: float, command: float) -> float:
        """Torque on the motor shaft [N m], called once per step in order of time."""


class Controller(Protocol):
    """A drive: torque from what its encoder sees, called once per step in order of time."""

    def __call__(self, t: float, motor_angle: float) -> float:
        """Commanded torque on the motor shaft [N m] from the motor coordinate q_s [rad]."""


def machine(spec: mujoco.MjSpec, timestep: float = TIMESTEP, held: float = 0.0) -> Machine:
    """Compile a copy of ``spec`` for leapfrog stepping.

    Args:
        spec: Any MJCF; its integrator and step are replaced.
        timestep: h [s].
        held: See :class:`Machine`.
    """
    spec = spec.copy()
    spec.option.timestep = timestep
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER
    spec.option.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_EULERDAMP)
    centre_damping(spec, timestep)
    model = spec.compile()
    outputs = {
        model.sensor(i).name: slice(model.sensor_adr[i], model.sensor_adr[i] + model.sensor_dim[i])
        for i in range(model.nsensor)
    }
    return Machine(
        model=model,
        timestep=timestep,
        inputs={model.actuator(i).name: i for i in range(model.nu)},
        outputs=outputs,
        velocities=frozenset(
            model.sensor(i).name
            for i in range(model.nsensor)
            if mujoco.mjtSensor(int(model.sensor_type[i])) in _VELOCITIES
        ),
        held=held,
    )


def centre_damping(spec: mujoco.MjSpec, timestep: float) -> None:
    """Add h/2 times its linear damping to the inertia of every joint and fixed tendon (see the module's text)."""
    for element in (*spec.joints, *spec.tendons):
        if element.damping[0] > 0.0:
            element.armature += 0.5 * timestep * element.damping[0]


def step(
    machine: Machine, start: Real, inputs: Real, law: ForceLaw | None = None, speeds: Real | None = None
) -> Trace:
    """Step over ``inputs``.

    Args:
        machine: The compiled model.
        start: Angles at t = 0 [rad], shape (nq,).
        inputs: Control at t_k = k h, shape (n, number of actuators).
        law: Forces beyond the model.
        speeds: At t = 0 [rad/s], shape (nv,); zero where none are given.
    """
    if law is not None:
        return march(machine, start, inputs, law=law, speeds=speeds)
    data = begin(machine.model, start, speeds)
    state = np.empty(mujoco.mj_stateSize(machine.model, _FULL_STATE))
    mujoco.mj_getState(machine.model, data, state, _FULL_STATE)
    padded = np.concatenate([inputs, inputs[-1:]])  # one step more: a velocity is centred by its successor
    _, sensors = rollout.rollout(machine.model, data, state[np.newaxis], padded[np.newaxis])
    return read_out(machine, inputs, sensors[0])


def begin(model: mujoco.MjModel, start: Real, speeds: Real | None = None) -> mujoco.MjData:
    """Fresh data at angles ``start`` [rad], shape (nq,), and ``speeds``; every tendon that yields is relaxed there."""
    data = mujoco.MjData(model)
    data.qpos[:] = start
    if speeds is not None:
        data.qvel[:] = speeds
    if model.nplastic:
        mujoco.mj_fwdPosition(model, data)
        relax(model, data)
    return data


def relax(model: mujoco.MjModel, data: mujoco.MjData) -> None:
    """Let every tendon that yields rest where it is; its length must be up to date."""
    for tendon in np.flatnonzero(model.tendon_springyield > 0.0):
        first = model.tendon_plasticadr[tendon]
        data.plastic[first : first + 2] = data.ten_length[tendon] - model.tendon_lengthspring[tendon]


def march(
    machine: Machine,
    start: Real,
    inputs: Real,
    *,
    controller: Controller | None = None,
    actuation: Actuation | None = None,
    law: ForceLaw | None = None,
    speeds: Real | None = None,
) -> Trace:
    """Step by step in Python, for what reacts to the motion.

    Args:
        machine: The compiled model.
        start: Angles at t = 0 [rad], shape (nq,).
        inputs: Control at t_k, shape (n, number of actuators).
        controller: Replaces the input of the actuator ``motor``.
        actuation: Between the motor's command and the torque that acts.
        law: Forces beyond the model; it is given speeds at t_k, extrapolated from t_k - h/2 with the last acceleration.
        speeds: At t = 0 [rad/s], shape (nv,); zero where none are given.
    """
    model, h = machine.model, machine.timestep
    data = begin(model, start, speeds)
    n = len(inputs)
    commanded = np.concatenate([inputs, inputs[-1:]])
    motor = machine.inputs.get("motor", -1)
    driven = machine.inputs.get(MOTOR_ON_LOAD, -1) if motor < 0 else motor
    motor_coordinate = model.joint("motor" if motor >= 0 else "reducer").qposadr[0] if driven >= 0 else 0
    sensors = np.empty((n + 1, model.nsensordata))
    qpos, qvel, qacc, ctrl, applied = data.qpos, data.qvel, data.qacc, data.ctrl, data.qfrc_applied
    sensordata = data.sensordata
    hear = law.hear if isinstance(law, Hearing) else None
    for k in range(n + 1):
        t = k * h
        if controller is not None:
            commanded[k, driven] = controller(t, float(qpos[motor_coordinate]))
        ctrl[:] = commanded[k]
        if actuation is not None and motor >= 0:
            ctrl[motor] = actuation(t, commanded[k, motor])
        if hear is not None:
            hear(data)
        if law is not None:
            applied[:] = law(t, qpos, qvel + (0.5 * h) * qacc)
        mujoco.mj_step(model, data)
        sensors[k] = sensordata
    return read_out(machine, commanded[:n], sensors)


def read_out(machine: Machine, inputs: Real, sensors: Real) -> Trace:
    """Put every signal at t_k: after a step MuJoCo's sensors still belong to the state before it.

    Args:
        machine: Where the columns are.
        inputs: Shape (n, number of actuators).
        sensors: Sensor data of n + 1 steps, shape (n + 1, number of sensor values).
    """
    signals: dict[str, Real] = {}
    for name, columns in machine.outputs.items():
        values = sensors[:, columns.start] if columns.stop - columns.start == 1 else sensors[:, columns]
        if name in machine.velocities:
            signals[name] = 0.5 * (values[1:] + values[:-1])
            signals[name.removesuffix(" speed") + " acceleration"] = np.diff(values) / machine.timestep
        else:
            signals[name] = values[:-1] + (machine.held if name == "arm angle" else 0.0)
    return Trace(
        times=np.asarray(np.arange(len(inputs)) * machine.timestep, dtype=np.float64),
        inputs={name: inputs[:, column] for name, column in machine.inputs.items()},
        signals=signals,
    )


def zero_inputs(machine: Machine, steps: int) -> Real:
    """No control at all, shape (steps, number of actuators)."""
    return np.zeros((steps, machine.model.nu))


def stack_inputs(machine: Machine, columns: Mapping[str, Real | float], steps: int) -> Real:
    """An input array from named columns, the others zero, shape (steps, number of actuators)."""
    inputs = zero_inputs(machine, steps)
    for name, values in columns.items():
        inputs[:, machine.inputs[name]] = values
    return inputs


def grid(duration: float, timestep: float) -> Real:
    """t_k = k h from 0 to at least ``duration`` [s]."""
    return np.asarray(np.arange(int(np.ceil(duration / timestep - 1e-9)) + 1) * timestep, dtype=np.float64)
