"""What can be concealed: a law with one knob for its size, and what it does to the joint and to the recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Final

import numpy as np

from jointscope.sim.outside.physics import Change
from jointscope.sim.outside.rig import Rig
from jointscope.sim.outside.setup import Experiments

UNTOUCHED: Final = 1.0


@dataclass(frozen=True, kw_only=True)
class Chain:
    """Faults of the recording; as it stands: none.

    Attributes:
        delay: Of the device that isn't the DAQ [s].
        ppm: How much its clock is fast [1e-6].
        tilt: Of the accelerometer's axis from tangential towards radially outward [rad].
        resonance: Of its mount [Hz]; 0: none.
        resonance_damping: Share of critical.
        level: Beyond which it clips [m/s^2].
        accelerometer_gain: Recorded over true.
        force_gain: Recorded over true.
        log_rate: At which the logged torque is renewed [Hz]; 0: at every sample.
        log_averaged: Whether each such value is the mean since the one before.
        eccentricity: Amplitude of the motor encoder's error per turn [rad].
        eccentric_phase: [rad].
        pickup: What the accelerometer reads of the drive torque's rate [m/s^2 per N m/s].
        rectified: Share of |a| by which its baseline is pulled down.
    """

    delay: float = 0.0
    ppm: float = 0.0
    tilt: float = 0.0
    resonance: float = 0.0
    resonance_damping: float = 0.0
    level: float = np.inf
    accelerometer_gain: float = UNTOUCHED
    force_gain: float = UNTOUCHED
    log_rate: float = 0.0
    log_averaged: bool = False
    eccentricity: float = 0.0
    eccentric_phase: float = 0.0
    pickup: float = 0.0
    rectified: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Build:
    """An effect of one size.

    Attributes:
        physics: Constants of the joint that it changes.
        chain: Fields of ``Chain`` that it changes.
        per_run: Constants that differ from run to run, by the run's place in the session.
        parameters: What the truth says of it, by the contract's names.
    """

    parameters: Mapping[str, float]
    physics: Mapping[str, Change] = field(default_factory=dict)
    chain: Mapping[str, float] = field(default_factory=dict)
    per_run: Callable[[int], Mapping[str, float]] | None = None


@dataclass(frozen=True)
class Law:
    """A law as drawn for one case, its size still free.

    Attributes:
        name: The law's own name.
        main: The contract's main parameter.
        build: The effect of size s; s = 1 is of middling size.
        least: Smallest s.
        most: Largest s.
        departs: Whether the equations differ from the textbook's under the effect's name.
    """

    name: str
    main: str
    build: Callable[[float], Build]
    least: float = 0.002
    most: float = 8.0
    departs: bool = False


@dataclass(frozen=True)
class Scene:
    """What a case goes through without its effect: the scales of sizes.

    Attributes:
        swing: Wind-up of the largest hits [rad].
        speed: Largest commanded speed [rad/s].
        poses: Arm angles at which it is hit [rad].
        lowest: Least angle in any motion [rad].
        highest: [rad].
        acceleration: Of the accelerometer, rms of the median hit [m/s^2].
        peak: Its largest [m/s^2].
        runs: How many.
    """

    rig: Rig
    experiments: Experiments
    swing: float
    speed: float
    poses: tuple[float, ...]
    lowest: float
    highest: float
    acceleration: float
    peak: float
    runs: int

    @property
    def hit(self) -> bool:
        """Whether there are hits."""
        return "H" in self.experiments

    @property
    def moved(self) -> bool:
        """Whether there are motions."""
        return "M" in self.experiments


Maker = Callable[[Scene, np.random.Generator], Law]
