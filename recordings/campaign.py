"""The campaign as frozen data: what was recorded, where, in which unit, at which rate (format ``jointscope-campaign/1``).

Reading lives in ``reader``, writing in ``writer``. Samples are held in SI (or per the channel's own unit where its
scale is unknown, ``unit = "1"``); what the file held is described by the channel's fields.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

FORMAT = "jointscope-campaign/1"

Topology = Literal["two-inertia", "single-dof", "arm"]
Motion = Literal["rotational", "translational"]
Plane = Literal["vertical", "horizontal"]
Experiment = Literal["hammer", "torque-sweep", "speed-motion", "free"]
Quantity = Literal[
    "force", "torque", "phase-current", "current", "voltage", "linear-acceleration", "angular-acceleration",
    "angle", "angular-velocity", "speed-command", "position", "velocity", "acceleration", "frf",
]  # fmt: skip
Location = Literal["arm", "motor", "load", "base", "neighbour"]
Role = Literal["input", "output"]
Hold = Literal["brake", "brake-with-play", "drive", "locked", "free"]

FORCES: Final = ("torque", "current", "voltage", "force")  # what drives a rig, in any unit
ANGLE_OF: Final[dict[str, Quantity]] = {"angular-velocity": "angle", "velocity": "position"}
SLIDING: Final = ("position", "velocity", "acceleration")  # in metres, wherever they are read


def gearing(quantity: str, location: str, ratio: float) -> float:
    """What a motion channel reads per unit of motion at the output: n on the motor's shaft, which turns, else 1.

    A ``position`` at the motor of a translational rig is where the screw puts the carriage [m], not the shaft's angle.
    """
    return ratio if location == "motor" and quantity not in SLIDING else 1.0


@dataclass(frozen=True, kw_only=True)
class Nameplate:
    """What the lab knows of the rig beforehand (``[rig]``); ``None`` where the campaign is silent. Units as in the format."""

    topology: Topology
    motion: Motion
    plane: Plane = "vertical"
    reduction_ratio: float | None = None
    motor_inertia: float | None = None
    reducer_inertia: float | None = None
    motor_damping: float | None = None
    load_damping: float | None = None
    arm_mass: float | None = None
    arm_com_radius: float | None = None
    efficiency: float | None = None
    torque_constant: float | None = None
    pole_pairs: int | None = None
    ground_spring: bool | None = None
    stiffness_reference: float | None = None
    inertia_reference: float | None = None
    damping_reference: float | None = None

    def grounded(self, *, held: bool) -> bool:
        """Whether a spring ties a single inertia to the ground; where the rig doesn't say, if its motor is ``held``."""
        return held if self.ground_spring is None else self.ground_spring


@dataclass(frozen=True, kw_only=True, eq=False)
class Channel:
    """One recorded signal: what it measures, and its samples in SI.

    Attributes:
        samples: SI values, shape (n,), read-only; complex for an ``frf``; ``None`` where a declared column is absent
            from its file; NaN only where the stream says ``gaps = "mask"``.
        taken_off: Level at rest that was subtracted from the samples [SI]; see ``recordings.zeroed``.
        unit: The unit in the file. With ``unit == "1"`` and no ``scale`` the samples are uncalibrated.
    """

    column: str
    quantity: Quantity
    unit: str
    location: Location
    role: Role
    samples: NDArray[np.float64] | NDArray[np.complex128] | None = field(default=None, repr=False)
    radius: float | None = None
    direction: Literal["tangential", "radial"] = "tangential"
    coupling: Literal["dc", "ac"] = "dc"
    low_cutoff: float | None = None
    full_scale: float | None = None
    scale: float | None = None
    sensitivity: float | None = None
    counts_per_turn: float | None = None
    rated_torque: float | None = None
    rated_current: float | None = None
    side: Literal["motor", "output"] = "motor"
    per: Literal["peak", "rms"] = "peak"
    form: Literal["accelerance", "mobility", "receptance"] | None = None
    reference_radius: float | None = None  # of an FRF's force [m]; the response's own ``radius`` where silent
    averages: int | None = None
    coherence: NDArray[np.float64] | None = field(default=None, repr=False)
    joint: str | None = None
    site: str | None = None
    body: str | None = None
    point: tuple[float, float, float] | None = None
    axis: tuple[float, float, float] | None = None
    taken_off: float = 0.0
    file_unit: str | None = None  # the file's own unit label, as found; only ever compared with ``unit``

    @property
    def calibrated(self) -> bool:
        """Whether the samples are in SI rather than in a unit of unknown scale."""
        return self.unit != "1" or self.scale is not None


@dataclass(frozen=True, kw_only=True, eq=False)
class Stream:
    """One acquisition device of a run: its clock and its channels.

    Attributes:
        file: Path inside the campaign.
        sampling_rate: [Hz]; for FRFs the inverse of the line spacing has no meaning and ``frequency`` holds the axis.
        start: First sample on the run's clock [s].
        start_uncertainty: Standard deviation of ``start`` [s]; ``inf`` for ``start = "unknown"``; 0 when exact.
        length: Number of samples; 0 where no declared column is in the file.
        frequency: Frequency axis of an FRF stream [Hz], shape (n,); ``None`` for time data.
        jitter: Largest distance of the file's time stamps from the uniform grid the samples were put on [s].
    """

    file: str
    sampling_rate: float
    start: float = 0.0
    start_uncertainty: float = 0.0
    length: int = 0
    channels: tuple[Channel, ...] = ()
    time: str | None = None
    window: tuple[float, float] | None = None
    gaps: Literal["refuse", "mask"] = "refuse"
    sync: str | None = None
    frequency: NDArray[np.float64] | None = field(default=None, repr=False)
    jitter: float = 0.0

    @property
    def times(self) -> NDArray[np.float64]:
        """Sample times on the run's clock [s], shape (length,)."""
        return self.start + np.arange(self.length) / self.sampling_rate


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """One take.

    Attributes:
        arm_angle: At the start, from the horizontal, positive upwards [rad]; 0 where the campaign is silent.
        brake: Whether the motor shaft is held.
    """

    id: str
    experiment: Experiment
    streams: tuple[Stream, ...]
    brake: bool = False
    arm_angle: float = 0.0
    repeat_of: str | None = None
    role: Literal["estimate", "validate"] | None = None
    initial: Literal["rest", "estimate"] = "rest"
    joint: str | None = None
    posture: dict[str, float] = field(default_factory=dict)
    payload_mass: float | None = None
    payload_com: tuple[float, float, float] | None = None
    hold: dict[str, Hold] = field(default_factory=dict)  # per joint; a single-joint rig's own hold is under ""

    @property
    def motor_held(self) -> bool:
        """Whether a brake or a lock holds the shaft of a single joint's motor."""
        return self.brake or self.hold.get("", "drive") in ("brake", "brake-with-play", "locked")

    @property
    def signals(self) -> tuple[Signal, ...]:
        """Every channel with its stream, in file order."""
        return tuple(
            Signal(stream=stream, channel=channel, device=device)
            for device, stream in enumerate(self.streams)
            for channel in stream.channels
        )

    def select(
        self,
        quantity: Quantity | None = None,
        *,
        location: Location | None = None,
        role: Role | None = None,
        recorded: bool = True,
    ) -> tuple[Signal, ...]:
        """Signals that match every criterion given; with ``recorded`` only those that hold samples."""
        return tuple(
            signal
            for signal in self.signals
            if (quantity is None or signal.channel.quantity == quantity)
            and (location is None or signal.channel.location == location)
            and (role is None or signal.channel.role == role)
            and (not recorded or signal.channel.samples is not None)
        )

    def angle_beside(self, speed: Signal) -> Signal | None:
        """The output angle that the device of ``speed`` recorded at its place: the sensor that the speed comes from."""
        quantity, place = ANGLE_OF.get(speed.channel.quantity), speed.channel.location
        beside = self.select(quantity, location=place, role="output") if quantity else ()
        return next((angle for angle in beside if angle.device == speed.device), None)


@dataclass(frozen=True, kw_only=True, eq=False)
class Signal:
    """A channel seen with its device's clock.

    Attributes:
        device: Index of the stream in the run: signals of one device share a clock.
    """

    stream: Stream
    channel: Channel
    device: int

    @property
    def samples(self) -> NDArray[np.float64]:
        """SI samples, shape (n,).

        Raises:
            ValueError: The declared column was not in the file.
        """
        if self.channel.samples is None:
            raise ValueError(f"{self.stream.file}: {self.channel.column} was declared but not recorded")
        return self.channel.samples  # type: ignore[return-value]

    @property
    def sampling_rate(self) -> float:
        """[Hz]."""
        return self.stream.sampling_rate

    @property
    def times(self) -> NDArray[np.float64]:
        """On the run's clock [s], shape (n,)."""
        return self.stream.times


@dataclass(frozen=True, kw_only=True, eq=False)
class Campaign:
    """A set of recordings of one rig.

    Attributes:
        path: The directory, for messages and relative files only.
        mjcf: Arm campaigns: path of the model inside the campaign.
    """

    path: Path
    rig: Nameplate
    runs: tuple[Run, ...]
    title: str = ""
    notes: str = ""
    mjcf: str | None = None
    urdf: str | None = None
    joints: tuple[str, ...] = ()


def with_channels(run: Run, instead: Mapping[int, Channel]) -> Run:
    """The run with other channels in the place of some, by ``id`` of those; itself where it has none of them."""
    if not any(id(c) in instead for stream in run.streams for c in stream.channels):
        return run
    streams = tuple(
        replace(stream, channels=tuple(instead.get(id(c), c) for c in stream.channels)) for stream in run.streams
    )
    return replace(run, streams=streams)
