"""The runs of a session: hits at several levels, sweeps, motions, in random order."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jointscope.sim.outside.excitation import PROFILES, Profile, hit, motion, sweep
from jointscope.sim.outside.intent import Intent
from jointscope.sim.outside.physics import HELD, LOAD_SPEED, MOTOR_SPEED, TORQUE, Control
from jointscope.sim.outside.rig import Rig, log_uniform, rounded
from jointscope.sim.outside.setup import Setup

Real = NDArray[np.float64]

POSED: Final = {"base-compliance", "neighbour-flexibility"}  # told apart by their dependence on the pose
TURNING: Final = {"transmission-error", "torque-ripple", "encoder-eccentricity", "stiffness-per-motor-turn"}
SWEEPS: Final = {"HS": (4, 4), "HSM": (3, 4), "S": (5, 5), "SM": (4, 4)}
MOTIONS: Final = {"M": 6, "HM": 4, "HSM": 4, "SM": 4}
HITS: Final = {"H": (12, 16, 20), "HS": (12,), "HSM": (9, 12, 16), "HM": (12,)}
HOLD_FREQUENCY: Final = 0.6  # Hz, of the weak position hold in a sweep
START_OFFSET: Final = 0.8e-3  # s, at most, of a log whose start is uncertain
SCATTER: Final = 0.006  # of the torque that a hit of the recorded force gives; hard nulls 0.02


@dataclass(frozen=True, kw_only=True, eq=False)
class Take:
    """One run.

    Attributes:
        angle: The arm's at the start [rad].
        duration: Of the recording [s].
        programme: On half steps: a hit's force [N], a sweep's torque [N m] or a speed [rad/s].
        level: Which hits are repeats of each other; empty for other runs.
        offset: Start of the log against the DAQ's [s].
    """

    control: Control
    angle: float
    duration: float
    programme: Real = field(repr=False)
    level: str = ""
    offset: float = 0.0

    @property
    def hit(self) -> bool:
        """Whether the motor is held and the arm is hit."""
        return self.control.mode == HELD

    @property
    def swept(self) -> bool:
        """Whether it is a torque sweep."""
        return self.control.mode == TORQUE

    @property
    def travels(self) -> bool:
        """Whether it follows a speed programme."""
        return self.control.mode in (MOTOR_SPEED, LOAD_SPEED)


@dataclass(frozen=True, eq=False)
class Session:
    """The runs and the scales of what they do.

    Attributes:
        swing: Wind-up of the largest hits [rad].
        speed: Largest speed that is commanded [rad/s].
        poses: Arm angles at which it is hit and swept [rad].
    """

    takes: tuple[Take, ...]
    swing: float
    speed: float
    poses: tuple[float, ...]


def draw_session(
    intent: Intent, setup: Setup, daq_rate: float, uncertain: bool, rng: np.random.Generator
) -> Session:
    """The session of a case."""
    rig, experiments = setup.rig, setup.experiments
    swing = rig.rated_torque / rig.stiffness * float(rng.uniform(0.25, 0.6)) if rig.stiffness > 0.0 else 0.0
    if rig.slide == "spring":
        swing = log_uniform(rng, 3e-5, 3e-4)
    poses = _poses(intent, rig, rng)
    hits = _hits(intent, setup, swing, poses, daq_rate, rng) if "H" in experiments else []
    sweeps = _sweeps(setup, poses, rng) if experiments in SWEEPS else []
    motions, speed = _motions(intent, setup, rng)
    takes = [*hits, *sweeps, *motions]
    if uncertain:
        takes = [
            take if take.hit else replace(take, offset=START_OFFSET * float(rng.uniform(-1.0, 1.0)))
            for take in takes
        ]
    if experiments == "M" and rig.slide is None:
        swing = 0.4 * rig.rated_torque / rig.stiffness
    order = rng.permutation(len(takes))
    return Session(tuple(takes[i] for i in order), swing or 1e-4, speed, poses)


def _poses(intent: Intent, rig: Rig, rng: np.random.Generator) -> tuple[float, ...]:
    base = float(rng.choice((0.0, -0.6, 0.5, 0.3))) if rig.vertical else 0.0
    if intent.names & POSED:
        return (0.0, 0.7, 1.3) if rng.random() < 0.7 else (0.0,)
    return (base, rounded(base + rng.uniform(0.4, 0.9), 3)) if rng.random() < 0.3 else (base,)


def _hits(
    intent: Intent, setup: Setup, swing: float, poses: tuple[float, ...], rate: float, rng: np.random.Generator
) -> list[Take]:
    rig = setup.rig
    share = max(rig.damping / (2.0 * np.sqrt(max(rig.stiffness * rig.load_inertia, 1e-9))), 0.004)
    duration = float(np.clip(np.ceil(35.0 / (share * rig.own_rate)) / 10.0, 1.0, 2.2))
    both, levels = rng.random() < 0.4, int(rng.integers(3, 6))
    swings = np.geomspace(0.08, 1.0, levels) * swing
    takes = []
    for k in range(int(rng.choice(HITS[setup.experiments]))):
        level, sign = k % levels, -1.0 if both and (k // levels) % 2 else 1.0
        pose = (k // levels) % len(poses)
        force = hit(rng, rig, swings[level] * log_uniform(rng, 0.85, 1.15), duration, rate, sign)
        scatter = 1.0 + float(rng.normal()) * (0.02 if intent.hard else SCATTER)
        name = f"s-L{level}{'n' if sign < 0.0 else ''}{'b' * pose}"
        control = Control(mode=HELD, push=rig.hammer_radius * scatter)
        takes.append(Take(control=control, angle=poses[pose], duration=duration, programme=force, level=name))
    return takes


def _sweeps(setup: Setup, poses: tuple[float, ...], rng: np.random.Generator) -> list[Take]:
    rig = setup.rig
    inertia = rig.motor_inertia + rig.load_inertia
    hold = 2.0 * np.pi * HOLD_FREQUENCY * (1.0 + rig.gravity / inertia / 14.0)  # rad/s; stiffer against gravity
    few, many = SWEEPS[setup.experiments]
    count = int(rng.integers(few, many + 1))
    amplitudes = rig.rated_torque * np.geomspace(0.08, 0.4, max(count - 1, 2))
    takes = []
    for k in range(count):
        duration = float(rng.choice((3.0, 3.5, 4.0)))
        torque = sweep(rng, rig, float(amplitudes[min(k, count - 2)]), duration)
        control = Control(mode=TORQUE, hold=inertia * hold**2, hold_rate=1.4 * inertia * hold)
        takes.append(Take(control=control, angle=poses[k % len(poses)], duration=duration, programme=torque))
    return takes


def _motions(intent: Intent, setup: Setup, rng: np.random.Generator) -> tuple[list[Take], float]:
    """Motions, and the largest speed they are asked for [rad/s]."""
    rig = setup.rig
    sliding = rig.slide is not None
    driven = rig.load_inertia if sliding else rig.motor_inertia + rig.load_inertia
    acceleration = log_uniform(rng, 0.6, 2.0)
    speed = float(rng.uniform(0.15, 0.5))
    if not sliding:
        acceleration = min(rig.rated_torque * float(rng.uniform(0.25, 0.6)) / driven, 8.0)
        speed = float(rng.uniform(0.6, 2.2))
    speed = min(speed * (0.7 if rig.load_inertia > 15.0 else 1.0), 0.8 * acceleration)
    count = MOTIONS.get(setup.experiments, 0)
    profiles = _profiles(intent, count, rng)
    crossover = (
        2.0 * np.pi * float(rng.uniform(4.0, 8.0)) if sliding else float(rng.uniform(0.1, 0.2)) * rig.own_rate
    )
    gain = driven * crossover
    takes = []
    for k in range(count):
        duration = 10.0 if "clock-drift" in intent.names else float(rng.choice((4.0, 5.0, 6.0)))
        share = 1.0 if k < 2 else float(rng.uniform(0.35, 1.0))
        profile = profiles[k % len(profiles)]
        programme = motion(rng, profile, share * speed, acceleration, duration, float(rng.choice((-1.0, 1.0))))
        control = Control(
            mode=LOAD_SPEED if sliding else MOTOR_SPEED,
            proportional=gain,
            integral=gain * crossover / float(rng.uniform(4.0, 8.0)),
        )
        angle = float(rng.choice((-1.0, -0.5, 0.0, 0.4))) if rig.vertical else 0.0
        takes.append(Take(control=control, angle=angle, duration=duration, programme=programme))
    return takes, speed


def _profiles(intent: Intent, count: int, rng: np.random.Generator) -> list[Profile]:
    profiles = [PROFILES[i] for i in rng.permutation(len(PROFILES))]
    if "stribeck-friction" in intent.names:
        slow: list[Profile] = ["creep", "stairs"]
        profiles = [*slow, *(p for p in profiles if p not in slow)]
    if intent.names & TURNING and "steady" not in profiles[:count]:
        profiles = ["steady", "trap", "tri", "multi", *profiles]
    return profiles
