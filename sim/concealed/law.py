"""What a concealed effect is: a law, where it sits, how strong it may be, and how it enters the engine or the chain."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from jointscope.models.parameters import Rig
from jointscope.sim.concealed.engine import Slot

Real = NDArray[np.float64]
Kind = Literal["hammer", "torque-sweep", "speed-motion"]
Draw = Literal["development", "calibration", "test"]
Values = Mapping[str, float]
EVERY_DRAW: frozenset[Draw] = frozenset({"development", "calibration", "test"})
OPEN_DRAWS: frozenset[Draw] = frozenset({"development", "calibration"})
TEST_DRAW: frozenset[Draw] = frozenset({"test"})


@dataclass(frozen=True)
class Setting:
    """What a rig goes through in a case without its effect: the scales by which strengths are chosen.

    Attributes:
        rig: The true rig.
        kinds: Experiments of the case.
        devices: Whether there are two acquisition devices (the DAQ and the drive's own log).
        force: Largest hit [N].
        torque: Largest dynamic torque through the transmission, median over the runs [N m].
        drive_torque: Largest torque of the drive beside the holding torque, at the output [N m]; 0 without a drive.
        acceleration: Largest tangential acceleration at the sensor, median over the runs [m/s^2].
        speed: Largest arm speed, median over the runs that move most [rad/s].
        travel: The same for the arm's angle [rad].
        angle: The arm's angle at the start of most runs [rad].
        daq_rate: [Hz].
        log_rate: [Hz].
        runs: Number of runs.
    """

    rig: Rig
    kinds: frozenset[Kind]
    devices: bool
    force: float
    torque: float
    drive_torque: float
    acceleration: float
    speed: float
    travel: float
    angle: float
    daq_rate: float
    log_rate: float
    runs: int

    @property
    def windup(self) -> float:
        """Torque over K [rad]."""
        return self.torque / self.rig.joint.stiffness

    @property
    def frequency(self) -> float:
        """sqrt(K/J_L)/(2 pi), the joint's own with the motor held [Hz]."""
        return float(np.sqrt(self.rig.joint.stiffness / self.rig.joint.load_inertia) / (2.0 * np.pi))

    @property
    def moves(self) -> bool:
        """Whether a run travels."""
        return "speed-motion" in self.kinds


@dataclass(frozen=True)
class Moment:
    """Which run of the session an effect acts in.

    Attributes:
        index: The run's place in the session, 0 first.
        begin: When it begins [s] since the session began.
        braked: Whether the motor is held.
        duration: [s].
    """

    index: int
    runs: int
    begin: float
    braked: bool
    kind: Kind
    duration: float


Install = Callable[[ET.Element, Values, Setting, Moment], None]
InLoop = Callable[[Values, Setting, Moment], Slot]


@dataclass(frozen=True, kw_only=True)
class Law:
    """One law of one effect at one place.

    Attributes:
        effect: Its name in the contract, or a private name for what no catalogue lists.
        location: motor, transmission, load, base, neighbour or acquisition.
        law: The law's own name.
        departs: Whether the equations differ from the textbook's under the same name.
        draws: The draws it may appear in.
        main: The contract's main parameter, with its unit.
        strength: The parameter that is scaled to make a case easier or harder.
        span: Limits of that parameter, weakest first (the second may be the smaller).
        shape: The parameters, drawn for one case; ``strength`` is overwritten.
        units: Unit of each parameter that is reported.
        report: The reported parameters, where they aren't the law's own numbers.
        seen_in: Experiments of which the case needs at least one.
        excluded: Experiments in whose company the law makes no sense.
        two_devices: Whether the effect lies between two devices' clocks.
        travels: Whether the arm has to travel.
        gravity: Whether the rig has to be vertical.
        install: Edits the run's MJCF.
        loop: The law in the stepping loop.
        keeps_motor: Whether a braked run keeps its motor joint.
        chain: Parameters handed to the measurement chain, by that chain's names.
    """

    effect: str
    location: str
    law: str
    departs: bool
    main: str
    strength: str
    span: Callable[[Setting], tuple[float, float]]
    shape: Callable[[Setting, np.random.Generator], dict[str, float]]
    units: Mapping[str, str]
    report: Callable[[Values, Setting], dict[str, float]] | None = None
    seen_in: frozenset[Kind] = frozenset({"hammer", "torque-sweep", "speed-motion"})
    excluded: frozenset[Kind] = frozenset()
    two_devices: bool = False
    travels: bool = False
    gravity: bool = False
    draws: frozenset[Draw] = EVERY_DRAW
    install: Install | None = None
    loop: InLoop | None = None
    keeps_motor: bool = False
    chain: Callable[[Values, Moment], Mapping[str, float]] | None = None

    def applies(self, setting: Setting) -> bool:
        """Whether the case's experiments and devices can show the effect at all."""
        return bool(
            self.seen_in & setting.kinds
            and not self.excluded & setting.kinds
            and (setting.devices or not self.two_devices)
            and (setting.moves or not self.travels)
            and (setting.rig.gravity > 0.0 or not self.gravity)
        )


@dataclass(frozen=True)
class Effect:
    """A law with its numbers."""

    law: Law
    values: Mapping[str, float] = field(default_factory=dict)

    @property
    def label(self) -> str:
        """``name@location``."""
        return f"{self.law.effect}@{self.law.location}"

    def reported(self, setting: Setting) -> dict[str, float]:
        """The parameters under the contract's names."""
        if self.law.report is not None:
            return self.law.report(self.values, setting)
        return {name: self.values[name] for name in self.law.units}

    def scaled(self, strength: float) -> Effect:
        """The same with another strength."""
        return Effect(self.law, {**self.values, self.law.strength: strength})


def log_between(low: float, high: float, share: float) -> float:
    """The value a ``share`` of the way from ``low`` to ``high`` on a logarithmic scale."""
    return float(low * (high / low) ** share)
