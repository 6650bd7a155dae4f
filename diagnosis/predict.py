"""Predictions of one run: against what was recorded (with the observer), and from the inputs alone."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis import kernel
from jointscope.diagnosis.acquisition import driven_torque, load_input, shifted
from jointscope.diagnosis.assembly import Assembly, assemble, initial_state, observer_corner, rests
from jointscope.diagnosis.channels import observe
from jointscope.diagnosis.vibration import disturbance
from jointscope.recordings.drift import FOLLOWING, drift_corner, drift_free

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect
    from jointscope.diagnosis.problem import Output, PreparedRun, Problem

Vector = NDArray[np.float64]


def predict_outputs(
    run: PreparedRun, theta: Vector, effects: tuple[ActiveEffect, ...], problem: Problem
) -> tuple[Vector, ...]:
    """What the model says of each of ``run.outputs``, given the inputs (and, in observer form, the observed angle).

    Args:
        run: A run of ``problem``.
        theta: Base parameters in the order of ``problem.base.names``, shape (n_theta,).
        effects: Physics and acquisition beside the base.
        problem: The campaign as prepared.

    Returns:
        One array per output, of the shape of its ``data``; not finite where the simulation diverged.
    """
    assembly = build(run, theta, effects, problem)
    places = rests(assembly)
    if len(places) == 1:
        return _from_rest(assembly, None)
    begun = run.begun
    missed = [_missed(begun, _from_rest(build(begun, theta, effects, problem), place)) for place in places]
    return _from_rest(assembly, places[int(np.argmin(missed))])


def _from_rest(assembly: Assembly, rest: float | None) -> tuple[Vector, ...]:
    run = assembly.run
    states = integrate(assembly, rest)
    predicted = [_zeroed(observe(states, assembly, run, output), output) for output in run.outputs]
    if assembly.chain.vibration[1] != 0.0:
        predicted = disturbance(assembly, run, predicted)
    return tuple(predicted)


def _missed(run: PreparedRun, predicted: tuple[Vector, ...]) -> float:
    """Sum over outputs of the logarithm of their squared error, infinite where one is not finite."""
    squares = [
        float(np.mean(np.square((o.data - y)[o.mask])))
        for o, y in zip(run.outputs, predicted, strict=True)
        if o.mask.any()
    ]
    return sum(math.log(s + 1e-300) if math.isfinite(s) else math.inf for s in squares)


def _zeroed(y: Vector, output: Output) -> Vector:
    """A channel without a known zero takes the one that fits."""
    return y + float(np.mean((output.data - y)[output.mask])) if output.floating and output.mask.any() else y


def free_prediction(
    run: PreparedRun, theta: Vector, effects: tuple[ActiveEffect, ...], problem: Problem
) -> tuple[Vector, ...]:
    """Every declared output from the inputs alone, each at its stream's rate, in recorded form.

    A speed command closes the drive's loop, with a logged torque as the measured input above the loop's drift. Angles
    and speeds of a sweep that nothing holds come without what lies below the sweep (:mod:`jointscope.recordings.drift`).

    Returns:
        One array per ``run.declared``, in SI on the channel's own zero: angles start at the run's arm angle.
    """
    assembly = build(run, theta, effects, problem, free=True)
    states = integrate(assembly)
    predicted = tuple(observe(states, assembly, run, output) for output in run.declared)
    corner = drift_corner(run.run, problem.rig)
    if corner is None:
        return predicted
    return tuple(
        drift_free(y, corner, output.rate) if output.quantity in FOLLOWING else y
        for y, output in zip(predicted, run.declared, strict=True)
    )


def build(
    run: PreparedRun, theta: Vector, effects: tuple[ActiveEffect, ...], problem: Problem, *, free: bool = False
) -> Assembly:
    """The run's model with ``effects`` in it."""
    assembly = assemble(run, np.asarray(theta, dtype=np.float64), problem, free=free)
    for effect in effects:
        effect.apply(assembly)
    return assembly


def integrate(assembly: Assembly, rest: float | None = None) -> Vector:
    """The kernel's rows on the run's grid, shape (steps + 1, kernel.N_OUT); from ``rest`` in the play where it is given."""
    run, P, S = assembly.run, assembly.P, assembly.S
    motor = driven_torque(assembly)
    load = load_input(assembly)
    if S[kernel.LOAD_PRESCRIBED] or S[kernel.MOTOR] == kernel.MOTOR_PRESCRIBED:
        motor = run.motor_half  # the prescribed acceleration
    elif not run.motor_moves and run.motor is not None and S[kernel.AT_LOOP] < 0:
        load = load + motor  # a rigid axis: the motor acts on the one inertia
    x = initial_state(assembly, float(motor[0]), rest)
    observed, command, chain = run.observed_half, run.command_half, assembly.chain
    if run.command is not None and run.late_command and (chain.delay != 0.0 or chain.clock != 0.0):
        command = shifted(run.command.signal, run, chain)
    if run.observed is not None and run.late_observed and (chain.delay != 0.0 or chain.clock != 0.0):
        observed = shifted(run.observed.signal, run, chain)
    if S[kernel.AT_LOOP] >= 0:
        observed = _feed_forward(assembly, command)
        scale = assembly.base("torque_scale") * chain.torque_gain
        for entry in (kernel.LOOP_P, kernel.LOOP_I, kernel.LOOP_LIMIT):
            P[entry] *= scale
        x[S[kernel.AT_LOOP]] /= scale
    elif P[kernel.OBS_QS] != 0.0 or S[kernel.MOTOR] == kernel.MOTOR_PRESCRIBED:
        observed = observed + (x[0] - observed[0] if S[kernel.MOTOR] == kernel.MOTOR_PRESCRIBED else x[0] - x[2])
    out = np.empty((run.steps + 1, kernel.N_OUT))
    kernel.simulate(x, P, S, motor, load, observed, command, run.t0, 1.0 / run.grid_rate, out)
    return out


def _feed_forward(assembly: Assembly, command: Vector) -> Vector:
    """What the drive's law adds to its feedback, at half steps at the output [N m], shape (2 n + 1,)."""
    run = assembly.run
    factor = assembly.base("efficiency") * assembly.base("torque_scale") * assembly.chain.torque_gain
    acceleration, velocity = assembly.base("drive_acceleration"), assembly.base("drive_velocity")
    total = np.zeros(command.size)
    if velocity != 0.0:
        total += factor * velocity * command
    if acceleration != 0.0:
        rate = run.command_rate_half if command is run.command_half else np.gradient(command) * 2.0 * run.grid_rate
        total += factor * acceleration * rate
    return total


def inverse_force(
    run: PreparedRun, theta: Vector, effects: tuple[ActiveEffect, ...], problem: Problem
) -> tuple[Vector, Vector] | None:
    """(recorded, modelled) force of a single-dof run along its recorded motion, on the simulation grid [N m or N].

    The motion is low-passed at ``prescribed_path.INVERSE_CORNER`` with zero phase before it is differentiated, the recorded
    force alike; then both forces once more at the observer's corner (:func:`observer_corner`), up to which the fit
    weighs force errors alike. ``None`` where the run has no observed angle or the rig is not a single free inertia.
    """
    from dataclasses import replace

    from scipy.signal import butter, sosfiltfilt

    if run.observed is None or run.observed.rate_signal or run.motor_moves or run.spring:
        return None
    from jointscope.diagnosis.prescribed_path import INVERSE_CORNER

    half = run.t0 + np.arange(2 * run.steps + 1) / (2.0 * run.grid_rate)
    sections = butter(4, INVERSE_CORNER, fs=2.0 * run.grid_rate, output="sos")
    band = butter(4, observer_corner(run), fs=2.0 * run.grid_rate, output="sos")
    q = sosfiltfilt(sections, run.observed.signal(half))
    v = np.gradient(q) * 2.0 * run.grid_rate
    a = np.gradient(v) * 2.0 * run.grid_rate
    inverse = replace(
        run, mode="prescribed-load", observed=None, observed_half=q, command_half=v, motor_half=a, motor=None
    )
    assembly = build(inverse, theta, effects, problem)
    states = integrate(assembly)
    model = sosfiltfilt(band, np.repeat(states[:, kernel.X_TEXT], 2)[:-1])[::2]
    forward = build(run, theta, effects, problem)
    force = load_input(forward) + (driven_torque(forward) if run.motor is not None else 0.0)
    recorded = sosfiltfilt(band, sosfiltfilt(sections, force))[::2]
    edge = max(1, math.ceil(0.1 * run.grid_rate))
    return recorded[edge:-edge], model[edge:-edge]
