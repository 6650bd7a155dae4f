"""Runs whose motion is given rather than driven: the motor's, from which the arm follows; or the load's own, and its force.

A recorded motion is low-passed with zero phase before it is differentiated: above the corner its noise, multiplied by
the frequency squared, would be all there is.
"""

from __future__ import annotations

from dataclasses import replace

import mujoco
import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp

from jointscope.errors import RefusedError
from jointscope.recordings.bandlimited import bandlimited
from jointscope.recordings.campaign import Run, Signal, gearing
from jointscope.sim.bench import Setup, set_up
from jointscope.sim.physics import Physics, Record
from jointscope.sim.stepping import Trace, machine, read_out

Real = NDArray[np.float64]

CORNER = 60.0  # Hz, of the low-pass; at most 0.2 of the recording's rate
_HEAVY = (
    1e6  # kg m^2: an inertia that the rig moves off its path by millionths; MuJoCo takes no control above 1e10
)


def prescribed(run: Run) -> Signal | None:
    """The angle or position that is an input, if any."""
    found = (*run.select("angle", role="input"), *run.select("position", role="input"))
    return found[0] if found else None


def path_of(signal: Signal, ratio: float) -> Record:
    """The motion at the output [rad or m] as a smooth function of time."""
    rate, n = signal.sampling_rate, gearing(signal.channel.quantity, signal.channel.location, ratio)
    sections = dsp.butter(4, min(CORNER, 0.2 * rate), fs=rate, output="sos")
    return bandlimited(dsp.sosfiltfilt(sections, signal.samples / n), rate, signal.stream.start)


def moved_motor(
    spec: mujoco.MjSpec, path: Record, until: float, times: Real, timestep: float, physics: Physics
) -> tuple[Setup, Real]:
    """A rig whose motor follows ``path``, at rest at the path's first angle, and the motor's control.

    Args:
        spec: The rig.
        path: q_s [rad].
        until: Its last sample [s]; from there on the motor keeps its speed.
        times: Stepping grid on the run's clock [s], shape (n,).
        timestep: h [s].
        physics: What is added to the rig.

    Returns:
        The setup, and the control of actuator ``motor``, shape (n,).
    """
    rested = set_up(spec, float(path(times[:1])[0]), timestep, physics=physics)
    spec = spec.copy()
    physics.edit(spec)
    motor = spec.joint("motor")
    motor.armature, motor.frictionloss, motor.damping[:] = _HEAVY, 0.0, (0.0, 0.0, 0.0)
    moved = machine(spec, timestep)
    gear = float(moved.model.actuator("motor").gear[0])
    # second differences, so that the leapfrog returns the path itself
    around = path(np.concatenate([times[:1] - timestep, times, times[-1:] + timestep]))
    acceleration = np.where(times < until - timestep, np.diff(around, 2) / timestep**2, 0.0)
    speeds = np.zeros(moved.model.nv)
    speeds[moved.model.joint("motor").dofadr[0]] = (around[1] - around[0]) / timestep
    return (
        replace(rested, machine=moved, speeds=speeds, physics=replace(physics, edit=_done)),
        acceleration * _HEAVY / gear,
    )


def _done(spec: mujoco.MjSpec) -> None:
    """The edit has been made."""
    del spec


def load_force(spec: mujoco.MjSpec, path: Record, times: Real, timestep: float, physics: Physics) -> Trace:
    """Force [N m or N] that moves a single free inertia along ``path``, by inverse dynamics, as signal ``load force``.

    Args:
        spec: A single inertia's model.
        path: q [rad or m].
        times: Stepping grid on the run's clock [s], shape (n,).
        timestep: h [s].
        physics: What is added to the rig.

    Raises:
        RefusedError: The model has further coordinates, whose motion is not known.
    """
    physics.edit(spec)
    for element in (
        spec.joint("reducer"),
        spec.tendon("reducer spring"),
        spec.tendon("reducer low-torque spring"),
    ):
        if element is not None:
            element.stiffness[:], element.damping[:] = 0.0, 0.0
    free = machine(spec, timestep)
    model, data = free.model, mujoco.MjData(free.model)
    if model.nv != 1:
        raise RefusedError(
            f"{spec.modelname}: the load's motion is prescribed, that of a further mode is not known: no force to predict"
        )
    law = physics.law(model) if physics.law else None
    q, v, a = path(times), path(times, 1), path(times, 2)
    mujoco.mj_forward(model, data)
    constant = float(data.qfrc_actuator[0])  # weight along a slide, asymmetric friction: they pull without control
    needed, sensors = np.empty(len(times)), np.empty((len(times) + 1, model.nsensordata))
    for k in range(len(times)):
        data.qpos[0], data.qvel[0], data.qacc[0] = q[k], v[k], a[k]
        extra = float(law(k * timestep, data.qpos, data.qvel)[0]) if law is not None else 0.0
        mujoco.mj_inverse(model, data)
        needed[k] = data.qfrc_inverse[0] - extra - constant
        sensors[k] = data.sensordata
    sensors[-1] = sensors[-2]
    trace = read_out(free, np.zeros((len(times), model.nu)), sensors)
    signals = {**trace.signals, "arm angle": q, "arm speed": v, "arm acceleration": a, "load force": needed}
    return replace(trace, signals=signals)
