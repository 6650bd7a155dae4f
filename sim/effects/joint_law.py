r"""One force law for a run: what the transmission, the motor and the arm feel beyond the MJCF.

reducer coordinate x = q - q_s:  T_S(Delta) + memories - what the MJCF's own spring gives
motor:                           ripple in proportion to the torque
dry friction:                    its level renewed before each step (excess at low speed, share of |T_S|), or bristles
arm:                             weight out of gravity's plane, a disturbance of known phase
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.sim.effects.transmission import MEMORIES, Spring, bristles
from jointscope.sim.stepping import Actuation, ForceLaw

Real = NDArray[np.float64]
Law = Mapping[str, Any]

MECHANICS = (
    "transmission-error", "gap-damping", "soft-middle", "power-spring", "stiffness-drift", *MEMORIES, "friction-level",
    "torque-ripple", "weight", "external-vibration", "table", "bristles", "stop-loss", "gear-friction",
)  # fmt: skip
_ON_SPRING = ("transmission-error", "gap-damping", "soft-middle", "power-spring", "stiffness-drift", *MEMORIES)


@dataclass(frozen=True, kw_only=True)
class Frame:
    """Where a run's laws count from.

    Attributes:
        arm_angle: Of the load at the start [rad].
        origin: Start of the replay on the run's clock [s].
        motor_zero: Encoder's count at the start less the arm angle, at the output [rad].
        run: Its id.
    """

    arm_angle: float
    origin: float
    motor_zero: float
    run: str


@dataclass
class _Command:
    """Torque that the motor was last told to give [N m]."""

    torque: float = 0.0


def joint_law(
    laws: Sequence[Law], spring: Mapping[str, float], frame: Frame
) -> tuple[Callable[[mujoco.MjModel], ForceLaw] | None, Callable[[float], Actuation] | None]:
    """The run's force law and what listens to its motor's command; ``None`` where nothing is needed.

    Args:
        laws: Entries of ``effects.json`` whose kind is in ``MECHANICS``.
        spring: Its ``spring``.
        frame: The run's.
    """
    laws = [law for law in laws if law["kind"] != "external-vibration" or frame.run in law.get("phases", {})]
    if not laws:
        return None, None
    last = _Command()
    listens = any(law["kind"] == "torque-ripple" for law in laws)

    def make(model: mujoco.MjModel) -> ForceLaw:
        return _JointLaw(model, laws, Spring(**spring), frame, last)

    def listen(timestep: float) -> Actuation:
        del timestep

        def actuation(t: float, command: float) -> float:
            last.torque = command
            return command

        return actuation

    return make, listen if listens else None


def _joint(model: mujoco.MjModel, name: str) -> int:
    """Address of a hinge or slide, -1 where it is not there."""
    found = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, name)
    return -1 if found < 0 else int(model.jnt_dofadr[found])


def _sprung(model: mujoco.MjModel, reducer: int) -> bool:
    """Whether the reducer's coordinate hangs on a spring, its own or a tendon's."""
    tendon = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, "reducer spring")
    own = bool(np.any(model.jnt_stiffness[model.jnt_dofadr == reducer] != 0.0))
    return own or (tendon >= 0 and bool(model.tendon_stiffness[tendon] != 0.0))


class _JointLaw:
    """Evaluated once per step in order of time; states belong to one take."""

    def __init__(
        self, model: mujoco.MjModel, laws: Sequence[Law], spring: Spring, frame: Frame, command: _Command
    ) -> None:
        self.model, self.spring, self.frame, self.command = model, spring, frame, command
        self.reducer, self.motor, self.base = (_joint(model, name) for name in ("reducer", "motor", "base"))
        self.held = frame.arm_angle  # q_s while no joint moves the motor; set at t = 0
        self.force = np.zeros(model.nv)
        by_kind = {kind: [law for law in laws if law["kind"] == kind] for kind in MECHANICS}
        self.lines = [(*_line(law), bool(law.get("reacts", False))) for law in by_kind["transmission-error"]]
        self.back = (0.0, 0.0)  # de/dq_s and de/dq of the errors that do no work
        self.memories = [MEMORIES[kind](law) for kind in MEMORIES for law in by_kind[kind]]
        self.drift = sum(float(law["rate"]) for law in by_kind["stiffness-drift"])
        self.tables = {
            (at, of): _table(law) for law in by_kind["table"] for at, of in [(str(law["at"]), str(law["of"]))]
        }
        self.on_spring = any(by_kind[kind] for kind in _ON_SPRING) or any(
            at == "transmission" for at, _ in self.tables
        )
        self.ripples = [
            (float(law["share"]), *_line({**law, "amplitude": 1.0})[1:]) for law in by_kind["torque-ripple"]
        ]
        self.pulls = [(float(law["moment"]), float(law["phase"])) for law in by_kind["weight"]]
        self.shakes = [
            (float(law["amplitude"]), 2.0 * math.pi * law["frequency"], float(law["phases"][frame.run]))
            for law in by_kind["external-vibration"]
            if not law.get("mount")
        ]
        self.bristles = [
            (law["at"] == "motor", bool(law.get("by_load", False)), bristles(law)) for law in by_kind["bristles"]
        ]
        self.stops = [
            (float(law["side"]), float(law["angle"]), float(law["damping"])) for law in by_kind["stop-loss"]
        ]
        self.levels = by_kind["friction-level"]
        self.share = (
            any(law["share"] for law in self.levels)
            or any(by_load for _, by_load, _ in self.bristles)
            or any(of in ("speed-by-load", "speed-by-torque") for _, of in self.tables)
        )
        arm = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TENDON, "arm")
        self.contacts: list[tuple[Real, int, float, bool, list[Law]]] = []
        for at, array, index in (
            ("motor", model.dof_frictionloss, self.motor),
            ("load", model.tendon_frictionloss, arm),
        ):
            changing = [law for law in self.levels if law["at"] == at]
            if changing and index >= 0:
                self.contacts.append((array, index, float(array[index]), at == "motor", changing))
        motor = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_ACTUATOR, "motor")
        self.gear = float(model.actuator_gear[motor, 0]) if motor >= 0 else 0.0
        self.direct = self.motor < 0 and not _sprung(model, self.reducer)
        gear = next(iter(by_kind["gear-friction"]), None)
        self.gear_friction = (0.0, 0.0) if gear is None else (float(gear["ahead"]), float(gear["motor_share"]))
        self.drives = np.zeros(model.nu)
        if arm >= 0:
            on_it = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_TENDON) & (model.actuator_trnid[:, 0] == arm)
            plain = model.actuator_gaintype == mujoco.mjtGain.mjGAIN_FIXED
            self.drives = np.where(on_it & plain, model.actuator_gear[:, 0] * model.actuator_gainprm[:, 0], 0.0)
        self.drive, self.rest = 0.0, 0.0

    def hear(self, data: mujoco.MjData) -> None:
        """Of a rigid axis what drives it in this step, and what its load takes beside its inertia, as of the last one [N m]."""
        self.drive = float(self.drives @ data.ctrl)
        self.rest = float(data.qfrc_bias[self.reducer] - data.qfrc_passive[self.reducer])

    def __call__(self, t: float, q: Real, qd: Real) -> Real:
        x, v = float(q[self.reducer]), float(qd[self.reducer])
        if self.motor >= 0:
            q_s, v_s = float(q[self.motor]), float(qd[self.motor])
        else:
            if t <= 0.0:
                self.held = self.frame.arm_angle - x
            q_s, v_s = self.held, 0.0
        force = self.force
        force[:] = 0.0
        torque = 0.0
        if self.direct:
            torque = self._through(v_s + v)
        elif self.on_spring or self.share:
            torque = self._transmission(t, q_s, v_s, x, v)
            if self.on_spring:
                force[self.reducer] = (1.0 - self.back[1]) * torque - self.spring.native(-x, -v)
        if self.motor >= 0:
            force[self.motor] -= sum(self.back) * torque
            for share, per_motor, _per_load, phase in self.ripples:
                angle = per_motor * (q_s + self.frame.motor_zero) + phase
                force[self.motor] += share * self.gear * self.command.torque * math.sin(angle)
        if self.motor >= 0:
            force[self.motor] += self._tabled("motor", angle=q_s, speed=v_s)
            force[self.motor] += abs(torque) * self._tabled("motor", **{"speed-by-load": v_s})
            force[self.motor] += torque * self._tabled("motor", **{"speed-by-torque": v_s})
            force[self.motor] -= self._bristled(True, torque, t, q_s, v_s)
        on_arm = self._tabled("load", angle=q_s + x, speed=v_s + v)
        on_arm += abs(torque) * self._tabled("load", **{"speed-by-load": v_s + v})
        on_arm += torque * self._tabled("load", **{"speed-by-torque": v_s + v})
        if self.direct:
            for share, per_motor, _per_load, phase in self.ripples:
                on_arm += share * self.drive * math.sin(per_motor * (q_s + x + self.frame.motor_zero) + phase)
        on_arm -= sum(moment * math.cos(q_s + x + phase) for moment, phase in self.pulls)
        on_arm -= self._bristled(False, torque, t, q_s + x, v_s + v)
        for side, angle, damping in self.stops:
            depth = side * (q_s + x - angle)
            if depth > 0.0:  # never a pull: the spring's own push is all that can be lost
                on_arm -= depth * damping * (v_s + v)
        if t > 0.0:  # the rig is put to rest without it
            on_arm += sum(a * math.sin(w * (t + self.frame.origin) + phase) for a, w, phase in self.shakes)
        if on_arm:
            force[self.reducer] += on_arm
            for coordinate in (self.motor, self.base):
                if coordinate >= 0:
                    force[coordinate] += on_arm
        for array, index, constant, at_motor, laws in self.contacts:
            speed = abs(v_s if at_motor else v_s + v)
            array[index] = constant + sum(_level(law, speed, torque) for law in laws)
        return force

    def _through(self, v: float) -> float:
        """Torque that passes a rigid axis's gear [N m].

        With r of the motor's inertia over the rest T (1 + r + k) = drive + r rest where the gear's friction k |T| is ahead
        of it, T (1 + r - r k) = drive + r rest where it is behind; k has the sign of T v.
        """
        ahead, r = self.gear_friction
        total = self.drive + r * self.rest
        k = math.copysign(abs(ahead), total * v)
        return total / (1.0 + r + (k if ahead >= 0.0 else -r * k))

    def _transmission(self, t: float, q_s: float, v_s: float, x: float, v: float) -> float:
        """T_S [N m]."""
        delta, rate = -x, -v
        by_motor, by_load = 0.0, 0.0
        for amplitude, per_motor, per_load, phase, reacts in self.lines:
            angle = per_motor * (q_s + self.frame.motor_zero) + per_load * (q_s + x) + phase
            delta += amplitude * math.sin(angle)
            slope = amplitude * math.cos(angle)
            rate += slope * (per_motor * v_s + per_load * (v_s + v))
            by_motor += slope * per_motor * reacts
            by_load += slope * per_load * reacts
        self.back = by_motor, by_load
        torque = self.spring.torque(delta, rate, 1.0 + self.drift * (t + self.frame.origin))
        for memory in self.memories:
            torque += memory(t, delta, rate)
        torque += delta * self._tabled("transmission", **{"stiffness-by-angle": q_s + x})
        return torque + self._tabled("transmission", **{"wind-up": delta, "wind-up-rate": rate})

    def _bristled(self, motor: bool, torque: float, t: float, position: float, rate: float) -> float:
        """Friction of the bristles at one side [N m]; ``torque`` is T_S."""
        return sum(
            part(t, position, rate) * (abs(torque) if by_load else 1.0)
            for at_motor, by_load, part in self.bristles
            if at_motor == motor
        )

    def _tabled(self, at: str, **variables: float) -> float:
        """Torque of the laws without a name at one place [N m]."""
        return sum(self.tables[at, of](value) for of, value in variables.items() if (at, of) in self.tables)


def _line(law: Law) -> tuple[float, float, float, float]:
    return float(law["amplitude"]), float(law["per_motor"]), float(law.get("per_load", 0.0)), float(law["phase"])


def _table(law: Law) -> Callable[[float], float]:
    """Straight between nodes, constant beyond them."""
    torque, low = [float(value) for value in law["torque"]], float(law["low"])
    step = (float(law["high"]) - low) / (len(torque) - 1)

    def read(variable: float) -> float:
        at = min(max((variable - low) / step, 0.0), len(torque) - 1.0)
        node = min(int(at), len(torque) - 2)
        return torque[node] + (at - node) * (torque[node + 1] - torque[node])

    return read


def _level(law: Law, speed: float, torque: float) -> float:
    """Dry friction beyond the model's own [N m]."""
    excess = law["excess"] * math.exp(-((speed / law["speed"]) ** law["exponent"])) if law["excess"] else 0.0
    return float(excess + law["share"] * abs(torque))
