"""MuJoCo in a compiled loop: forces of laws that MJCF has no element for are added step by step, at engine speed.

The loop calls ``mj_step`` of the very library that the Python bindings have loaded, on their own model and data, so
there is no second physics here; Python is out of the way (about 0.7 million steps a second for the bare rig).

Order of one step: read angles and speeds, the drive's torque (held over its own cycle), the laws' forces, ``mj_step``.
Speeds belong to half a step earlier (MuJoCo's Euler step is a leapfrog); they are centred with the last acceleration
before a law or the drive sees them.
"""

from __future__ import annotations

import functools
import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import llvmlite.binding as llvm
import mujoco
import numba
import numpy as np
from numba import types
from numpy.typing import NDArray

Real = NDArray[np.float64]
LoopLaw = Callable[[Real, Real, Real, Real], None]

TIMESTEP: Final = 1e-4  # s; 0.07 % and 0.06 degrees at 100 Hz in the motor's response
SLOTS: Final = 4  # laws at once; an unused slot holds the empty law
LAW_PARAMETERS: Final = 48
LAW_STATES: Final = 48

# What a law sees, by index: s[T] and so on. Everything at the joint output, SI.
T: Final = 0  # time in the run [s]; negative while the rig settles
Q_S: Final = 1  # motor angle over n [rad]
W_S: Final = 2
Q: Final = 3  # arm angle [rad]
W: Final = 4
WINDUP: Final = 5  # q_s - q [rad]
WINDUP_RATE: Final = 6
TAU: Final = 7  # the drive's commanded torque, eta n T_e [N m]
PUSH: Final = 8  # external torque on the arm [N m]
T_S: Final = 9  # torque through the transmission; the laws' part of it is one step old [N m]
A_S: Final = 10  # accelerations, one step old [rad/s^2]
A_L: Final = 11
H: Final = 12  # the step [s]
SESSION: Final = 13  # time since the session began [s]
Q0: Final = 14  # the arm's angle at the start of the run [rad]
STATES: Final = 16

# What a law gives, by index: f[MOTOR] and so on, added up over the laws.
MOTOR: Final = 0  # torque on the motor side [N m]
LOAD: Final = 1  # torque on the arm [N m]
TRANSMISSION: Final = 2  # added to T_S [N m]
SHAKE: Final = 3  # upward acceleration of the foundation [m/s^2]
PICKUP: Final = 4  # added to the accelerometer's reading [m/s^2]
FORCES: Final = 8

_POINTER = types.CPointer(types.float64)  # type: ignore[no-untyped-call]
_SIGNATURE = types.void(_POINTER, _POINTER, _POINTER, _POINTER)
_mj_step = types.ExternalFunction("mj_step", types.void(types.uintp, types.uintp))


@functools.cache
def _load_engine() -> None:
    folder = Path(mujoco.__file__).parent
    found = sorted(
        path for pattern in ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll") for path in folder.glob(pattern)
    )
    if not found:
        raise OSError(f"{folder}: holds no MuJoCo library; reinstall mujoco")
    llvm.load_library_permanently(str(found[0]))


def nothing(p: Real, x: Real, s: Real, f: Real) -> None:
    """The empty law."""


@functools.cache
def compiled(law: LoopLaw) -> LoopLaw:
    """``law(p, x, s, f)`` compiled: parameters p, own states x, the machine's state s, forces f (all float64 pointers)."""
    pointers: LoopLaw = numba.cfunc(_SIGNATURE, cache=True, error_model="numpy")(law)
    return pointers


@dataclass(frozen=True)
class Slot:
    """A law at work in a run, with its parameters as the loop wants them."""

    law: LoopLaw
    parameters: tuple[float, ...]


@dataclass(frozen=True, eq=False)
class Drive:
    """The motor's drive: a torque programme with a weak position hold, or a speed loop; PI and limit at its own cycle.

    Attributes:
        kind: 0 brake, 1 torque programme, 2 speed loop, 3 a recorded torque, tied loosely to a recorded motor angle.
        programme: Torque on the motor shaft [N m] or motor speed over n [rad/s], on the stepping grid, shape (n,).
        gains: Proportional and integral (or rate and position) gain, per output unit.
        limit: Largest torque on the motor shaft [N m].
        cycle: Steps between two updates of the drive.
        resolution: Of the motor's encoder, at the output [rad].
        reference: Kind 3: the motor angle that was recorded, over n [rad], shape (n,).
    """

    kind: int
    programme: Real
    gains: tuple[float, float] = (0.0, 0.0)
    limit: float = np.inf
    cycle: int = 1
    resolution: float = 0.0
    reference: Real = field(default_factory=lambda: np.zeros(1))


@dataclass(frozen=True, eq=False)
class Motion:
    """What happened, every array on the stepping grid, shape (n,).

    Attributes:
        accelerometer: Proper acceleration at the sensor: along the arm outwards, and tangential [m/s^2], shape (n, 2).
        torque: What the drive commanded on the motor shaft [N m].
        motor: Motor angle over n [rad].
        arm: Arm angle [rad].
        windup: q_s - q [rad].
    """

    timestep: float
    accelerometer: Real = field(repr=False)
    torque: Real = field(repr=False)
    motor: Real = field(repr=False)
    arm: Real = field(repr=False)
    windup: Real = field(repr=False)


@dataclass(frozen=True, eq=False)
class Plant:
    """A compiled model and where its parts are.

    Attributes:
        model: Euler, damping explicit and centred (see ``mjcf.compile_plant``).
        held: Angle at which the brake holds the motor [rad]; meaningless when ``motor`` is a joint.
        ratio: eta n, torque at the output per torque on the motor shaft.
        hammer_radius: [m].
        stiffness: K of the base [N m/rad], for the start.
    """

    model: mujoco.MjModel
    held: float
    ratio: float
    hammer_radius: float
    stiffness: float


@numba.njit(cache=True, error_model="numpy")
def _march(
    model: int, data: int, qpos: Real, qvel: Real, qacc: Real, applied: Real, ctrl: Real, sensor: Real, gravity: Real,
    where: tuple[int, ...], laws: tuple[LoopLaw, ...], P: Real, X: Real, drive: Real, programme: Real,
    reference: Real, push: Real,
    numbers: tuple[float, ...], out: Real,
) -> None:  # fmt: skip
    jm, je, am, ah, acc, settle, kind, cycle, nv = where
    h, ratio, held, radius, K, c, kp, ki, limit, resolution, q0, session, g0 = numbers
    f = np.zeros(8)
    s = np.zeros(16)
    s[12] = h
    s[14] = q0
    n = push.size
    integral = drive[0]
    command = drive[0]
    start_motor = 0.0
    fade = np.exp(-150.0 * h)
    last = 0.0
    for k in range(-settle, n):
        s[0] = k * h
        s[13] = session + k * h
        e, ed = qpos[je], qvel[je] + 0.5 * h * qacc[je]
        if jm >= 0:
            qs, ws = qpos[jm], qvel[jm] + 0.5 * h * qacc[jm]
        else:
            qs, ws = held, 0.0
        s[1], s[2], s[3], s[4], s[5], s[6] = qs, ws, qs + e, ws + ed, -e, -ed
        s[11] = qacc[je]
        if jm >= 0:
            s[10] = qacc[jm]
            s[11] += qacc[jm]
        F = push[k] if k >= 0 else 0.0
        s[8] = F * radius
        # the drive
        if kind > 0 and (k + settle) % cycle == 0:
            seen = np.round(qs / resolution) * resolution if resolution > 0.0 else qs
            if k == 0:
                start_motor = seen
                integral = command
            if k < 0:  # settle on the arm's angle: a firm position loop
                integral += (q0 - s[3]) * drive[3] * h * cycle
                command = integral + (q0 - s[3]) * drive[1] - ws * drive[2]
            elif kind == 3:
                before = reference[k - 1] if k > 0 else reference[0]
                speed = (reference[k] - before) / h
                command = programme[k] + (reference[k] - qs) * ki + (speed - ws) * kp
            elif kind == 1:
                speed = (seen - last) / (h * cycle)
                command = integral + programme[k] + (start_motor - seen) * ki - speed * kp
            else:
                speed = (seen - last) / (h * cycle)
                error = programme[k] - speed
                integral += ki * error * h * cycle
                integral = min(max(integral, -limit), limit)
                command = integral + kp * error
            command = min(max(command, -limit), limit)
            last = seen
        s[7] = command * ratio
        s[9] = -K * e - c * ed + f[2]
        # the laws
        for i in range(8):
            f[i] = 0.0
        for i in range(4):
            laws[i](P[i].ctypes, X[i].ctypes, s.ctypes, f.ctypes)  # type: ignore[arg-type]
        for i in range(nv):
            applied[i] = 0.0
        applied[je] = f[1] + f[2]
        if jm >= 0:
            applied[jm] = f[0] + f[1]
            ctrl[am] = command
        ctrl[ah] = F
        if f[3] != 0.0 or gravity[2] != -g0:
            gravity[2] = -g0 - f[3]
        if k >= 0:
            out[k, 2] = command
            out[k, 3] = qs
            out[k, 4] = qs + e
            out[k, 5] = -e
        _mj_step(model, data)  # type: ignore[call-overload]
        if not abs(qacc[je]) < 1e8:  # it flies apart: stop before MuJoCo says so on every step
            out[:, :] = np.nan
            break
        if k >= 0:
            out[k, 0] = sensor[acc]
            out[k, 1] = sensor[acc + 2] + f[4]
        else:
            for i in range(nv):
                if i != jm:
                    qvel[i] *= fade
    gravity[2] = -g0


def march(
    plant: Plant,
    *,
    start: float,
    push: Real,
    drive: Drive,
    slots: Sequence[Slot] = (),
    session: float = 0.0,
    gravity: float,
    settle: float = 0.6,
) -> Motion:
    """Settle at ``start`` [rad] under gravity, then run over ``push`` [N] on the hammer's point.

    Args:
        plant: The compiled model.
        start: The arm's angle at the start [rad].
        push: Force on the arm on the stepping grid [N], shape (n,); it sets the run's length.
        drive: What the motor does.
        slots: Laws added in the loop, at most ``SLOTS``.
        session: When in the session the run begins [s].
        gravity: g of the base [m/s^2].
        settle: Time given to come to rest before t = 0 [s].
    """
    if len(slots) > SLOTS:
        raise ValueError(f"{len(slots)} laws at once: the loop takes {SLOTS}")
    _load_engine()
    model = plant.model
    data = mujoco.MjData(model)
    h = float(model.opt.timestep)
    motor = model.joint("motor").dofadr[0] if _has_joint(model, "motor") else -1
    reducer = model.joint("reducer").dofadr[0]
    pull = _start(plant, data, start, gravity, motor, reducer)
    laws = tuple(compiled(slot.law) for slot in slots) + (compiled(nothing),) * (SLOTS - len(slots))
    P, X = np.zeros((SLOTS, LAW_PARAMETERS)), np.zeros((SLOTS, LAW_STATES))
    for row, slot in zip(P, slots, strict=False):
        row[: len(slot.parameters)] = slot.parameters
    inertia = max(float(model.dof_armature[motor]), 1e-9) if motor >= 0 else 1.0
    whole = (inertia + pull[1]) / plant.ratio
    a = 40.0  # rad/s, triple pole of the loop that settles the rig
    hold = np.array([pull[0] / plant.ratio, whole * 3.0 * a**2, whole * 3.0 * a, whole * a**3])
    where = (
        int(motor), int(reducer), _actuator(model, "motor"), _actuator(model, "hammer"),
        int(model.sensor("accelerometer").adr[0]), round(settle / h), drive.kind if motor >= 0 else 0,
        drive.cycle, int(model.nv),
    )  # fmt: skip
    numbers = (
        h, plant.ratio, plant.held, plant.hammer_radius, *_native(model, reducer), *drive.gains,
        float(drive.limit), drive.resolution, start, session, gravity,
    )  # fmt: skip
    out = np.empty((push.size, 6))
    with warnings.catch_warnings():
        # numba calls a tuple of compiled functions experimental; the tests of the laws hold it to account
        warnings.simplefilter("ignore", numba.errors.NumbaExperimentalFeatureWarning)
        _march(
            model._address, data._address, data.qpos, data.qvel, data.qacc, data.qfrc_applied, data.ctrl,
            data.sensordata, model.opt.gravity, where, laws, P, X, hold, drive.programme, drive.reference, push, numbers, out,
        )  # fmt: skip
    if not np.isfinite(out).all():
        raise FloatingPointError("the simulation of a concealed case diverged")
    return Motion(
        timestep=h, accelerometer=out[:, :2], torque=out[:, 2], motor=out[:, 3], arm=out[:, 4], windup=out[:, 5]
    )


def _has_joint(model: mujoco.MjModel, name: str) -> bool:
    return bool(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name) >= 0)


def _native(model: mujoco.MjModel, reducer: int) -> tuple[float, float]:
    """Stiffness and damping that MuJoCo itself gives the reducer joint; 0 where a law replaces them."""
    return float(model.joint("reducer").stiffness[0]), float(model.dof_damping[reducer])


def _actuator(model: mujoco.MjModel, name: str) -> int:
    return int(mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, name))


def _start(
    plant: Plant, data: mujoco.MjData, start: float, gravity: float, motor: int, reducer: int
) -> tuple[float, float]:
    """Put the rig near its equilibrium; the gravity torque on the arm [N m] and the arm's inertia [kg m^2]."""
    model = plant.model
    if motor >= 0:
        data.qpos[model.joint("motor").qposadr[0]] = start
    mujoco.mj_forward(model, data)
    weight = float(data.qfrc_bias[reducer]) if gravity else 0.0
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    sag = -weight / plant.stiffness
    if motor >= 0:
        data.qpos[model.joint("motor").qposadr[0]] = start - sag
    data.qpos[model.joint("reducer").qposadr[0]] = sag
    mujoco.mj_forward(model, data)
    return weight, float(mass[reducer, reducer])
