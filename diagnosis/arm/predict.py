"""What an arm's channels read under a hypothesis: effects put into the joints' rows, the kernel stepped, sensors applied."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import lru_cache
from typing import TYPE_CHECKING, cast

import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp

from jointscope.diagnosis.arm import kernel
from jointscope.diagnosis.arm.problem import ArmProblem, ArmRun
from jointscope.diagnosis.arm.small import run_small
from jointscope.diagnosis.assembly import OBSERVER_HZ, OBSERVER_ZETA
from jointscope.diagnosis.channels import mount_resonance
from jointscope.recordings.drift import FOLLOWING, below_sweep, drift_free

if TYPE_CHECKING:
    from jointscope.diagnosis.arm.plant import Links, Mount, Reduced
    from jointscope.diagnosis.effects.spec import ActiveEffect
    from jointscope.diagnosis.objective import Predict
    from jointscope.diagnosis.problem import Output, PreparedRun, Problem

Vector = NDArray[np.float64]

TIE_HZ = OBSERVER_HZ  # keeps a measured torque on the recorded path; the noise model knows this observer
LOOSE_HZ = 0.2  # the same where only the command is known
TIE_RATIO = OBSERVER_ZETA
ROWS = {
    "stiffness": kernel.STIFFNESS, "damping": kernel.DAMPING, "rotor_inertia": kernel.ROTOR_INERTIA,
    "motor_damping": kernel.ROTOR_DAMPING, "drive_stiffness": kernel.DRIVE_STIFFNESS,
    "drive_damping": kernel.DRIVE_DAMPING, "load_damping": kernel.LINK_DAMPING,
}  # fmt: skip


@dataclass(eq=False)
class ArmAssembly:
    """One run's model while effects are put into it.

    Attributes:
        P: Joints' rows and the mount's, shape (n + 1, kernel.COLUMNS).
        elastic: Which reducers are springs, shape (n,).
        links: In which the links' inertia is another than the file says.
        mount: How the mount gives way, if it does.
        gain: Factor on the motor's torque.
        lag: Of the motor's torque behind the log [s].
        offset: Added to the motor's torque [N m].
        late: By which devices other than the DAQ stamp late [s].
        readings: Factor on what the accelerometers read.
        one_of: The same of some of them, by where they sit.
        ringing: Resonance [Hz] and damping [-] of the accelerometers' own mounts, by where they sit, "" of all.
        levels: At which the accelerometers clip [m/s^2], by where they sit, "" of all.
    """

    run: ArmRun
    problem: ArmProblem
    P: Vector
    elastic: NDArray[np.bool_]
    links: Links
    mount: Mount | None = None
    gain: float = 1.0
    lag: float = 0.0
    offset: float = 0.0
    late: float = 0.0
    readings: float = 1.0
    one_of: dict[str, float] = field(default_factory=dict)
    ringing: dict[str, tuple[float, float]] = field(default_factory=dict)
    levels: dict[str, float] = field(default_factory=dict)


def assembled(run: ArmRun, theta: Vector, effects: tuple[ActiveEffect, ...], problem: ArmProblem) -> ArmAssembly:
    """The run's model with ``effects`` in it."""
    n = len(problem.facts.joints)
    P = np.zeros((n + 1, kernel.COLUMNS))
    for name, column in ROWS.items():
        P[:n, column] = theta[problem.place(name, 0) :][:n]
    P[:, kernel.STRIBECK_SPEED] = P[:, kernel.SOFT_WIDTH] = 1.0
    assembly = ArmAssembly(
        run, problem, P, problem.mask(run), problem.links(theta), offset=float(theta[problem.offset_place])
    )
    for effect in effects:
        effect.apply(cast("object", assembly))  # type: ignore[arg-type]
    return assembly


@dataclass(frozen=True, eq=False)
class Motion:
    """What the kernel found.

    Attributes:
        readings: Accelerometers before coupling [m/s^2], shape (steps + 1, o).
        rotor: Angle of the driven rotor from its rest, at the output [rad], shape (steps + 1,).
    """

    readings: Vector
    rotor: Vector


def moved(assembly: ArmAssembly, *, tied: bool = True) -> Motion:
    """Step one run; ``tied`` to the recorded motor angle, else loosely to the commanded path. Diverged: not finite."""
    run, plant = assembly.run, assembly.run.plant
    table = plant.reduced(assembly.elastic, assembly.links, assembly.mount)
    P, kinds, x = rest_state(assembly, table)
    omega = 2.0 * math.pi * (TIE_HZ if tied else LOOSE_HZ)
    torque = _motor_torque(assembly)
    path, rate = _path(assembly, tied)
    driven = int(np.flatnonzero(table.joints == run.driven)[0]) if run.driven in table.joints else -1
    tie, tie_rate = run.tie * omega**2, 2.0 * TIE_RATIO * run.tie * omega
    tied_torque = tie * path + tie_rate * rate
    if table.moving < 0:
        u = run.load_half if driven < 0 else torque + tied_torque - P[driven, kernel.REST_TORQUE]
        found = run_small(table, P, kinds, driven, tie, tie_rate, u, run.grid_rate, run.steps)
        return Motion(found[:, :-1] + plant.static[0], found[:, -1])
    readings, rotor = np.empty((run.steps + 1, plant.static.shape[1])), np.zeros(run.steps + 1)
    good = kernel.travel(
        table.inverse, table.gravity, table.slope, table.product, table.motion, table.tilt, table.bias, table.static,
        table.hit, table.moving, plant.low, plant.step, P, kinds, driven, run.load_half, torque, tied_torque,
        tie, tie_rate, 1.0 / run.grid_rate, readings, rotor, x,
    )  # fmt: skip
    if not good:
        readings[:] = np.nan
        rotor[:] = np.nan
    return Motion(readings, rotor)


def _path(assembly: ArmAssembly, tied: bool) -> tuple[Vector, Vector]:
    """What the driven rotor is tied to and its rate, at half steps: the record, or the command, as of its own time."""
    run = assembly.run
    path, rate = (run.path, run.path_rate) if tied else (run.commanded, run.commanded_rate)
    by_command = not tied or all(probe >= 0 for probe in run.probes)
    if not assembly.late or not (run.late_command if by_command else run.late_observed):
        return path, rate
    place = np.clip(np.arange(len(path)) + 2.0 * run.grid_rate * assembly.late, 0.0, len(path) - 1.0)
    return _between(path, place), _between(rate, place)


def _motor_torque(assembly: ArmAssembly) -> Vector:
    """n eta T_e at half steps, gain, lag and offset applied [N m]."""
    run = assembly.run
    if run.driven < 0:
        return run.motor_half
    torque = run.motor_half
    if assembly.late and run.late_motor and run.motor is not None:
        half = run.t0 + np.arange(2 * run.steps + 1) / (2.0 * run.grid_rate)
        torque = assembly.problem.facts.efficiency * run.motor.signal(half + assembly.late)
    if assembly.lag > 0.0:
        pole = math.exp(-1.0 / (2.0 * run.grid_rate * assembly.lag))
        torque = dsp.lfilter([1.0 - pole], [1.0, -pole], torque, zi=[pole * torque[0]])[0]
    return np.ascontiguousarray(assembly.gain * torque + assembly.offset)


def rest_state(assembly: ArmAssembly, table: Reduced) -> tuple[Vector, NDArray[np.int64], Vector]:
    """Rows of the moving joints with their equilibrium, how their rotors are held, and the state at rest."""
    j = table.joints
    P = assembly.P[j].copy()
    place = -assembly.run.plant.low / assembly.run.plant.step if table.moving >= 0 else 0.0
    node = min(int(place), len(table.gravity) - 1)
    share = place - node if node + 1 < len(table.gravity) else 0.0
    after = table.gravity[min(node + 1, len(table.gravity) - 1)]
    P[:, kernel.REST_TORQUE] = (1.0 - share) * table.gravity[node] + share * after
    for row in P:
        row[kernel.REST_WIND_UP] = _wind_up(row)
    m = len(j)
    x = np.zeros(4 * m)
    x[2 * m : 3 * m] = P[:, kernel.REST_WIND_UP]
    return P, np.append(assembly.run.kinds, kernel.BRAKED)[j], x


def _wind_up(row: Vector) -> float:
    """Wind-up at which the reducer carries ``REST_TORQUE``, by bisection (the law rises with the wind-up)."""
    torque = float(row[kernel.REST_TORQUE])
    if row[kernel.GAP] == row[kernel.CUBIC] == row[kernel.SOFT_SHARE] == 0.0:
        return torque / float(row[kernel.STIFFNESS])
    if torque == 0.0:
        return 0.0
    sign = math.copysign(1.0, torque)
    low, high = 0.0, 3.0 * abs(torque) / float(row[kernel.STIFFNESS]) + float(row[kernel.GAP])
    for _ in range(60):
        middle = 0.5 * (low + high)
        if sign * kernel.reducer_torque(sign * middle, 0.0, row) < abs(torque):
            low = middle
        else:
            high = middle
    return sign * 0.5 * (low + high)


def peaks(run: ArmRun, theta: Vector, problem: ArmProblem) -> tuple[Vector, Vector, Vector]:
    """Peak rotor speed [rad/s], dynamic wind-up [rad] and torque [N m] of every joint, from small motion's responses.

    Shape (n,) each, from the linear model driven by the run's own input.
    """
    from jointscope.diagnosis.arm.modal import joint_motion

    return joint_motion(run, theta, problem)


# --- states to channels ----------------------------------------------------------------------------------------------


@lru_cache(maxsize=32)
def _low_pass(rate: float, grid: float) -> Vector:
    reach = round(24.0 * grid / rate)
    return np.asarray(dsp.firwin(2 * reach + 1, 0.46 * rate, fs=grid, window=("kaiser", 8.0)))


def _between(values: Vector, place: Vector) -> Vector:
    """Lagrange interpolation of third order at fractional places, shape of ``place``."""
    node = np.clip(np.floor(place).astype(int), 1, len(values) - 3)
    t = place - node
    return np.asarray(
        values[node - 1] * (-t * (t - 1.0) * (t - 2.0) / 6.0)
        + values[node] * ((t + 1.0) * (t - 1.0) * (t - 2.0) / 2.0)
        + values[node + 1] * (-t * (t + 1.0) * (t - 2.0) / 2.0)
        + values[node + 2] * (t * (t + 1.0) * (t - 1.0) / 6.0)
    )


def _read(values: Vector, output: Output, run: ArmRun, late: float) -> Vector:
    """A grid signal as the device samples it."""
    taps = _low_pass(output.rate, run.grid_rate)
    reach = (len(taps) - 1) // 2
    padded = np.concatenate([np.full(reach, values[0]), values, np.full(reach, values[-1])])
    first = (output.times[0] - run.t0) * run.grid_rate
    ratio = run.grid_rate / output.rate
    if not late and abs(first - round(first)) < 1e-6 and abs(ratio - round(ratio)) < 1e-9:
        begin = round(first)
        picked = dsp.upfirdn(taps, padded[begin:], 1, round(ratio))
        skip = 2 * reach / round(ratio)
        if skip == int(skip):
            found = picked[int(skip) : int(skip) + len(output.times)]
            return np.concatenate([found, np.full(len(output.times) - len(found), found[-1])])
    smooth = dsp.oaconvolve(padded, taps, mode="valid")
    place = (output.times - late - run.t0) * run.grid_rate
    return _between(smooth, np.clip(place, 0.0, len(values) - 1.0))


def _coupled(values: Vector, output: Output, rate: float) -> Vector:
    """AC coupling of first order, settled at the start."""
    if output.low_cutoff is None:
        return values
    b, a = _high_pass(output.low_cutoff, rate)
    return np.asarray(dsp.lfilter(b, a, values - values[0]))


@lru_cache(maxsize=32)
def _high_pass(corner: float, rate: float) -> tuple[Vector, Vector]:
    b, a = dsp.butter(1, corner, "highpass", fs=rate)
    return np.asarray(b), np.asarray(a)


def outputs_of(assembly: ArmAssembly, motion: Motion) -> tuple[Vector, ...]:
    """Every output of the run, shape of its data each."""
    run = assembly.run
    found = []
    for output, probe in zip(run.outputs, run.probes, strict=True):
        late = assembly.late if output.device != 0 else 0.0
        if probe < 0:
            turned = run.ratio * motion.rotor
            speed = output.quantity == "angular-velocity"
            found.append(_read(np.gradient(turned) * run.grid_rate if speed else turned, output, run, late))
        else:
            seat, felt = run.sensors[probe], np.ascontiguousarray(motion.readings[:, probe])
            own = assembly.ringing.get(seat) or assembly.ringing.get("")
            if own is not None and np.all(np.isfinite(felt)):
                felt = mount_resonance(felt, *own, run.grid_rate)
            gain = assembly.readings * assembly.one_of.get(seat, 1.0)
            felt = _coupled(felt, output, run.grid_rate)
            level = assembly.levels.get(seat, assembly.levels.get("", math.inf))
            found.append(np.clip(gain * _read(felt, output, run, late), -level, level))
    return tuple(found)


def predict_outputs(
    run: PreparedRun, theta: Vector, effects: tuple[ActiveEffect, ...], problem: Problem
) -> tuple[Vector, ...]:
    """The forward model that is fitted: one array per ``run.outputs``."""
    assembly = assembled(cast("ArmRun", run), theta, effects, cast("ArmProblem", problem))
    return outputs_of(assembly, moved(assembly))


def free_prediction(
    run: PreparedRun, theta: Vector, effects: tuple[ActiveEffect, ...], problem: Problem
) -> tuple[Vector, ...]:
    """From inputs alone: the driven rotor is tied to the commanded path instead of the recorded angle.

    The angle of a sweep comes without what lies below the sweep (:mod:`jointscope.recordings.drift`), whatever was
    commanded: of the drive's law that holds it there nothing is known.
    """
    assembly = assembled(cast("ArmRun", run), theta, effects, cast("ArmProblem", problem))
    predicted = outputs_of(assembly, moved(assembly, tied=False))
    corner = below_sweep(run.run) if run.run.experiment == "torque-sweep" else None
    if corner is None:
        return predicted
    return tuple(
        drift_free(y, corner, output.rate) if output.quantity in FOLLOWING else y
        for y, output in zip(predicted, run.outputs, strict=True)
    )


if TYPE_CHECKING:
    _: Predict = predict_outputs
