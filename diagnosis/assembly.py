"""One run's model put together: base parameters and effects as the kernel's numbers, and the chain of acquisition.

Effects write into an :class:`Assembly`; nothing else knows both an effect's parameters and the kernel's layout.
"""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis import kernel

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import Output, PreparedRun, Problem

Vector = NDArray[np.float64]

BASE_NAMES = (
    "stiffness",
    "damping",
    "load_inertia",
    "motor_inertia",
    "motor_damping",
    "load_damping",
    "gravity_moment",
    "efficiency",
    "torque_scale",
    "torque_offset",
    "torque_age",
    "drive_gain",
    "drive_integral",
    "drive_acceleration",
    "drive_velocity",
    "drive_limit",
    "drive_trust",
)
BASE_INDEX = {name: index for index, name in enumerate(BASE_NAMES)}

OBSERVER_HZ = 3.0  # below every resonance of a joint, above the drift of a torque log
RIGID_OBSERVER_HZ = 20.0  # of a free inertia without a joint: no resonance to keep clear of
RATE_SHARE = 0.04  # of the sampling rate that an observer's corner may be at most
COMMAND_HZ = 0.3  # where the drive's command stands for the motor's speed: it is followed only so closely
LAW_HZ = 1.0  # where the drive's law, read backwards from its torque, stands for the motor's angle
OBSERVER_ZETA = 0.8


SAME_RADIUS = 1e-3  # m


def beyond(radius: float, elbow: float, curve: float = 1.0) -> float:
    """Share ((r - r_e)+)^curve / r by which a point at ``radius`` [m] follows a bend at ``elbow`` [m]; of a torque nought."""
    return max(0.0, radius - elbow) ** curve / radius if math.isfinite(radius) and radius > 0.0 else 0.0


@dataclass
class Sensor:
    """What an accelerometer does to what it is to read; the neutral values do nothing.

    Attributes:
        tilt: Its axis from tangential towards radial [rad].
        resonance: Of its mount [Hz], ``inf`` without.
        resonance_damping: Damping ratio of that [-].
        bandwidth: First-order [Hz], ``inf`` without.
        saturation: Level at which it clips [m/s^2 or rad/s^2], ``inf`` without.
        knee: How sharply it does, y / (1 + |y/level|^knee)^(1/knee) [-].
        gain: True over stated sensitivity [-].
    """

    tilt: float = 0.0
    resonance: float = math.inf
    resonance_damping: float = 0.05
    bandwidth: float = math.inf
    saturation: float = math.inf
    knee: float = math.inf
    gain: float = 1.0


@dataclass
class Chain:
    """What the instruments do to the signals; the neutral values do nothing.

    Attributes:
        delay: The devices that are not the DAQ stamp late by this [s].
        encoder_delay: The arm's encoder is read late by this against the motor's, on one device [s].
        clock: Their clock runs fast by this [-] (1e-6 = 1 ppm).
        sensor: Of every accelerometer.
        sensors_at: Of those on the arm at a radius [m] alone.
        force_gain: True over stated sensitivity of the hammer's force [-].
        torque_gain: True over stated torque constant or efficiency [-].
        heat: Share by which the torque constant has fallen in the end where the torque stays at half its largest [-], and the
            time constant of that [s].
        thinning: What cold grease drags more [N m s/rad], and the time after which a third of it is left [s].
        relaxing: Stiffness of a spring to ground that lets go by and by [N m/rad], and its time constant [s].
        lags: Time constants of the stages through which the torque follows the logged one [s].
        loop: Time constant of a current loop of the second order [s], 0 without.
        loop_damping: Its damping ratio [-], that of the magnitude optimum where no law says otherwise.
        log_rate: Rate at which the torque log was held or averaged [Hz], ``inf`` without.
        log_kind: ``"held"``, ``"seen-held"``, ``"averaged"``, ``"averaged-held"``, ``"aliased"`` or
            ``"folded"``.
        log_age: Of a value of that log when it is first written [s].
        log_line: Frequency of a line that the log has and nothing acts by [Hz], 0 without.
        vibration: Frequency [Hz] and amplitude [N m] of an outside disturbance.
        vibration_mount: Whether it shakes the mount (amplitude in m/s^2 or rad/s^2) rather than pushing the arm.
    """

    delay: float = 0.0
    encoder_delay: float = 0.0
    clock: float = 0.0
    sensor: Sensor = field(default_factory=Sensor)
    sensors_at: dict[float, Sensor] = field(default_factory=dict)
    force_gain: float = 1.0
    torque_gain: float = 1.0
    heat: tuple[float, float] = (0.0, 1.0)
    thinning: tuple[float, float] = (0.0, 1.0)
    relaxing: tuple[float, float] = (0.0, 1.0)
    lags: tuple[float, ...] = ()
    loop: float = 0.0
    loop_damping: float = math.sqrt(0.5)
    log_rate: float = math.inf
    log_kind: str = "averaged"
    log_age: float = 0.0
    log_line: float = 0.0
    vibration: tuple[float, float] = (1.0, 0.0)
    vibration_mount: bool = False

    def sensors(self, output: Output) -> tuple[Sensor, ...]:
        """What an accelerometer's signal passes: what all of them do, and what the one at its radius does."""
        if output.location == "motor" or output.radius is None or not self.sensors_at:
            return (self.sensor,)
        return (self.sensor, *(own for r, own in self.sensors_at.items() if abs(r - output.radius) < SAME_RADIUS))


@dataclass(frozen=True)
class Bends:
    """Modes of the arm beside the joint's own, driven by the torque on it in units of J_L.

    Attributes:
        frequencies, dampings: Of each mode [Hz], [-].
        shares: What each of the arm's accelerometers reads of each mode [-], one row per mode.
        shapes: What each of them reads of the joint's own [-].
    """

    frequencies: tuple[float, ...] = ()
    dampings: tuple[float, ...] = ()
    shares: tuple[tuple[float, ...], ...] = ()
    shapes: tuple[float, ...] = ()


@dataclass
class Assembly:
    """Everything that one simulation of one run needs.

    Attributes:
        P: The kernel's numbers, shape (kernel.N_P,).
        S: The kernel's switches, shape (kernel.N_S,).
        run: The run that is simulated.
        theta: Base parameters, in the order of ``BASE_NAMES``.
        problem: The campaign that the run belongs to.
        chain: The acquisition.
        bends: Further modes by superposition.
        elbow, curve: Radius beyond which the bending arm's sensors follow its mode [m], and the power by which they do [-].
    """

    P: Vector
    S: NDArray[np.int64]
    run: PreparedRun
    theta: Vector
    problem: Problem
    chain: Chain = field(default_factory=Chain)
    bends: Bends = Bends()
    elbow: float = 0.0
    curve: float = 1.0

    def base(self, name: str) -> float:
        """One base parameter."""
        return float(self.theta[BASE_INDEX[name]])

    @property
    def ratio(self) -> float:
        """n."""
        return self.run.ratio

    @property
    def translational(self) -> bool:
        """Whether weight is a constant force rather than a torque that turns with the arm."""
        return self.problem.rig.motion == "translational"

    @property
    def drive_factor(self) -> float:
        """Torque at the output per unit of the motor channel [N m]."""
        known = self.base("efficiency") * self.base("torque_scale") * self.chain.torque_gain
        return known * self.run.torque_factor

    @property
    def resonance(self) -> float:
        """Scaling frequency of the wind-up [rad/s]: the arm's on the held motor."""
        return math.sqrt(max(self.P[kernel.K], 1e-12) / self.P[kernel.J_L])

    def line(self, first: int, count: int, values: tuple[float, float, float, float]) -> None:
        """Add one periodic line (four numbers) to the block that starts at ``first``, of which ``count`` counts them."""
        used = int(self.S[count])
        if used >= 3:
            return
        self.P[first + 4 * used : first + 4 * used + 4] = values
        self.S[count] = used + 1


_OF_BASE = np.array([kernel.J_M, kernel.J_L, kernel.K, kernel.C, kernel.B_M, kernel.B_L])
_IN_BASE = np.array([BASE_INDEX[name] for name in (
    "motor_inertia", "load_inertia", "stiffness", "damping", "motor_damping", "load_damping",
)])  # fmt: skip


@functools.cache
def _plain() -> tuple[Vector, NDArray[np.int64]]:
    """Numbers and switches of a joint without any effect; to be copied."""
    P, S = np.zeros(kernel.N_P), np.zeros(kernel.N_S, dtype=np.int64)
    P[kernel.HYST_ANGLE] = 1.0
    P[kernel.FM_SPEED] = P[kernel.FL_SPEED] = 1.0
    P[kernel.FM_EXPONENT] = P[kernel.FL_EXPONENT] = 2.0
    P[kernel.STOP_EXPONENT] = P[kernel.STOP_SIDE] = 1.0
    P[kernel.LOOP_LIMIT] = 1e300
    S[[kernel.AT_LINK, kernel.AT_NEAR, kernel.AT_BASE, kernel.AT_BRANCH, kernel.AT_LOOP]] = -1
    S[kernel.N_X] = 4
    return P, S


def assemble(run: PreparedRun, theta: Vector, problem: Problem, *, free: bool = False) -> Assembly:
    """The base model of ``run`` at ``theta``; with ``free`` the model runs on inputs alone, without an observer."""
    P, S = _plain()
    P, S = P.copy(), S.copy()
    P[_OF_BASE] = theta[_IN_BASE]
    weight = kernel.G_COS if problem.rig.motion == "rotational" else kernel.G_CONST
    P[weight] = theta[BASE_INDEX["gravity_moment"]]
    P[kernel.MOTOR_ZERO] = run.motor_zero
    S[kernel.MOTOR] = kernel.MOTOR_FREE if run.motor_moves else kernel.MOTOR_HELD
    if run.mode == "prescribed-motor":
        S[kernel.MOTOR] = kernel.MOTOR_PRESCRIBED
    elif run.mode == "prescribed-load":
        S[kernel.LOAD_PRESCRIBED] = 1
    assembly = Assembly(P, S, run, theta, problem)
    if not run.spring:
        P[kernel.K] = P[kernel.C] = 0.0
        P[kernel.DIRECT] = 1.0
    observed = run.observed
    if observed is not None and not free:
        w0 = 2.0 * math.pi * observer_corner(run)
        if observed.rate_signal:
            P[kernel.OBS_2] = w0
        else:
            P[kernel.OBS_1], P[kernel.OBS_2] = 2.0 * OBSERVER_ZETA * w0, w0 * w0
        row = {("motor", False): kernel.OBS_QS, ("motor", True): kernel.OBS_VS, ("arm", False): kernel.OBS_Q}.get(
            (observed.side, observed.rate_signal), kernel.OBS_V
        )
        P[row] = 1.0
    elif run.speed_command is not None and (run.motor_moves or closes(run, theta)):
        close_loop(assembly)
    return assembly


def observer_corner(run: PreparedRun) -> float:
    """Corner of the observer that follows the recorded angle [Hz].

    Above the corner the innovation is the force error twice integrated, below it the force error itself: with a fast
    observer the fit weighs force errors alike at all frequencies up to the corner, and dry friction changes sign when
    the recorded motion does, not when a drifted model does. A joint's resonance sets the limit where there is one.
    """
    if run.observed is not None and run.observed.commanded:
        return COMMAND_HZ if run.observed.law is None else LAW_HZ
    if run.spring or run.motor_moves or run.observed is None:
        return OBSERVER_HZ
    return min(RIGID_OBSERVER_HZ, max(OBSERVER_HZ, RATE_SHARE * run.observed.signal.rate))


def closes(run: PreparedRun, theta: Vector) -> bool:
    """Whether a rigid axis is foretold inside its drive's loop: its torque was logged, and the law is known."""
    driven = run.motor is not None and run.speed_command is not None and not run.mode.startswith("prescribed")
    return driven and not run.spring and float(theta[BASE_INDEX["drive_gain"]]) > 0.0


def close_loop(assembly: Assembly) -> None:
    """Let the drive's speed law hold the rigid body; a logged torque stays the input above the drift it would cause.

    The law is identified, the torque measured: what is left out of the law (a filter, a limit, a loop around it) must not
    stand for what is left out of the joint. A law that accounts for the whole log (``drive_trust`` = 1) is the drive: then it
    answers what the model does, as the drive would, where a torque replayed pushes a ripple or a friction out of step.
    """
    P, S, run = assembly.P, assembly.S, assembly.run
    S[kernel.AT_LOOP] = S[kernel.N_X]
    S[kernel.N_X] += 1
    factor = assembly.base("efficiency")
    gain = factor * max(assembly.base("drive_gain"), 1e-9)
    P[kernel.LOOP_P] = gain
    P[kernel.LOOP_I] = factor * assembly.base("drive_integral")
    total = P[kernel.J_L] if P[kernel.DIRECT] != 0.0 else P[kernel.J_M] + P[kernel.J_L]
    least = min(1.0, total * 2.0 * math.pi * COMMAND_HZ / gain)
    P[kernel.LOOP_MIX] = 1.0 if run.motor_torque is None else max(least, assembly.base("drive_trust"))
    if assembly.base("drive_limit") > 0.0:
        P[kernel.LOOP_LIMIT] = factor * assembly.base("drive_limit")


def held_weight(assembly: Assembly) -> float:
    """Torque on the transmission where the run begins at rest [N m]."""
    P, S, q0 = assembly.P, assembly.S, assembly.run.initial_angle
    weight = P[kernel.G_COS] * math.cos(q0) - P[kernel.G_SIN] * math.sin(q0) + P[kernel.G_CONST]
    if S[kernel.TABLE_SITE] == kernel.AT_LOAD:
        weight -= kernel.tabled(P, q0 if S[kernel.TABLE_OF] == kernel.OF_ANGLE else 0.0)
    return float(weight)


def rests(assembly: Assembly) -> tuple[float | None, ...]:
    """Places in the play [rad of wind-up] where a hit's run may begin; ``None`` is where the model puts it.

    What no weight holds against a flank stays where it was left: on either flank, or between them.
    """
    P, run = assembly.P, assembly.run
    if (
        P[kernel.GAP_HALF] == 0.0
        or P[kernel.GAP_CORNER] != 0.0
        or run.load is None
        or run.run.initial != "rest"
        or held_weight(assembly) != 0.0
    ):
        return (None,)
    return (None, P[kernel.GAP_CENTRE] - P[kernel.GAP_HALF], P[kernel.GAP_CENTRE] + P[kernel.GAP_HALF])


def initial_state(assembly: Assembly, first_torque: float, rest: float | None = None) -> Vector:
    """The state at rest, in equilibrium at the run's arm angle, shape (S[N_X],); the wind-up is ``rest`` where it is given."""
    P, S, run = assembly.P, assembly.S, assembly.run
    x = np.zeros(int(S[kernel.N_X]))
    q0 = run.initial_angle
    weight = held_weight(assembly)
    twist = _twist(P, S, weight) if run.spring else 0.0
    if rest is not None:
        twist = rest
    x[0] = q0 + twist if run.spring else q0
    for _ in range(8):  # the error depends on the motor's own angle: contracts by a order n << 1
        error = 0.0
        for i in range(int(S[kernel.N_TE])):
            amplitude, per_motor, per_load, phase = P[kernel.TE_0 + 4 * i : kernel.TE_0 + 4 * i + 4]
            error += amplitude * math.sin(per_motor * (x[0] + run.motor_zero) + per_load * q0 + phase)
        if error == 0.0 or not run.spring:
            break
        x[0] = q0 + twist - error
    x[2] = q0
    x[3] = run.initial_speed
    x[1] = run.initial_speed if run.motor_moves else 0.0
    if S[kernel.AT_BASE] >= 0:
        x[S[kernel.AT_BASE]] = -P[kernel.BASE_SHARE] / P[kernel.J_L] * weight / P[kernel.BASE_OMEGA] ** 2
    if S[kernel.AT_LOOP] >= 0 and P[kernel.LOOP_I] > 0.0:
        held = first_torque if run.motor_torque is not None else weight
        x[S[kernel.AT_LOOP]] = held / P[kernel.LOOP_I]
    return x


def _twist(P: Vector, S: NDArray[np.int64], weight: float) -> float:
    """Static wind-up under ``weight`` [N m], a tabled law of the transmission included [rad]."""
    twist = float(kernel.windup(P, weight))
    if S[kernel.TABLE_SITE] != kernel.AT_TRANSMISSION:
        return twist
    for _ in range(30):  # contracts while the table is softer than the spring
        extra = kernel.tabled(P, twist if S[kernel.TABLE_OF] == kernel.OF_WIND_UP else 0.0)
        twist = float(kernel.windup(P, weight - extra))
    return twist
