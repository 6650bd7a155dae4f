"""What inference works on: runs on their simulation grids, the channels that are compared, parameters and typical sizes."""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.assembly import BASE_NAMES, OBSERVER_HZ
from jointscope.diagnosis.inputs import Drive
from jointscope.recordings.bandlimited import Bandlimited
from jointscope.recordings.campaign import FORCES, Nameplate, Run

if TYPE_CHECKING:
    from jointscope.diagnosis.drive_angle import DriveLaw
    from jointscope.diagnosis.relog import Relogged

BEGUN = 0.2  # s: some periods of a joint
Vector = NDArray[np.float64]
Mode = Literal["braked", "observer", "closed-loop", "torque-driven", "prescribed-motor", "prescribed-load"]


@dataclass(frozen=True, eq=False)
class Output:
    """One channel that is compared.

    Attributes:
        quantity, location, direction, radius, low_cutoff, full_scale: As in the campaign.
        device: Stream it was recorded by.
        late: Whether that device is not the DAQ, so that a delay or clock drift moves it.
        rate: Sampling rate [Hz].
        times: Of its samples on the run's clock [s], shape (n,).
        data: What is compared, SI, polarity put right; angles counted so that the first one is the run's arm angle
            (times n at the motor), shape (n,).
        mask: Which samples are scored, shape (n,).
        gravity: g that this sensor sees [m/s^2]; 0 where it does not.
        high_pass: Corner below which data and prediction are both cut [Hz], or ``None``.
        polarity: +1, or -1 where the channel was found inverted.
        offset: See :meth:`recorded`.
        scale: Recorded units per SI where the unit is unknown, as the base has it.
        calibrated: Whether its unit is known.
        observed: Whether this is the angle that the observer follows: the comparison is its innovation.
        followed_to: Corner of the observer below which the model follows the recorded angle [Hz].
        floating: Whether its zero is unknown (an angle of a run that does not start at rest): the prediction is moved by
            the mean difference.
        channel: Position of (stream, channel) in the run.
        step: The recorder's, where the record was thinned and no longer sits on its grid [the channel's unit].
        recorded_rate: Before it was thinned [Hz]; ``None`` where it was not.
        taken_off: Mean square of what the recorded channel holds beyond its thinned ``data``, which no model predicts [the
            channel's unit squared]; 0 for angles, inputs, and where it was not thinned.
    """

    quantity: str
    location: str
    device: int
    late: bool
    rate: float
    times: Vector
    data: Vector
    mask: NDArray[np.bool_]
    radius: float | None = None
    direction: str = "tangential"
    low_cutoff: float | None = None
    full_scale: float | None = None
    gravity: float = 0.0
    high_pass: float | None = None
    polarity: float = 1.0
    offset: float = 0.0
    scale: float = 1.0
    calibrated: bool = True
    observed: bool = False
    followed_to: float = OBSERVER_HZ
    floating: bool = False
    channel: tuple[int, int] = (0, 0)
    step: float | None = None
    recorded_rate: float | None = None
    taken_off: float = 0.0

    def recorded(self, y: Vector) -> Vector:
        """What the record holds where ``data`` is ``y``: polarity scale (y + offset), same shape."""
        return np.asarray(self.polarity * self.scale * (np.asarray(y, dtype=np.float64) + self.offset))


@dataclass(frozen=True, eq=False)
class Observed:
    """The angle or speed that the observer follows, at the joint output.

    Attributes:
        side: Where it was measured.
        rate_signal: Whether it is a speed.
        signal: Its value [rad or rad/s at the output], angles from the arm's initial angle.
        device: Stream it was recorded by.
        commanded: Whether it is what the drive was asked for, or what its law says, for want of a recorded one.
        law: That law, where there is one.
    """

    side: Literal["motor", "arm"]
    rate_signal: bool
    signal: Bandlimited
    device: int
    commanded: bool = False
    law: DriveLaw | None = None


@dataclass(frozen=True, eq=False)
class PreparedRun:
    """One run on its simulation grid; half-step arrays have 2 n + 1 entries for n steps.

    Attributes:
        run: As recorded.
        index: Position in ``Problem.runs``.
        group: Runs of the same group repeat one excitation.
        role: As the campaign says.
        mode: How the model is driven.
        motor_moves: Whether the motor side is a degree of freedom.
        spring: Whether T_S acts (a free single mass has none).
        ratio: n.
        t0, grid_rate, steps: The grid: nodes at t0 + k / grid_rate, k = 0 ... steps.
        load_half, motor_half, command_half, observed_half: Inputs at half steps at the joint output; zeros where absent.
        command_rate_half: The speed command's rate [rad/s^2].
        load, motor, command: The same as functions of time, for effects that shift or filter them.
        late_motor, late_observed, late_command: Whether their device is not the DAQ.
        torque_factor: Motor torque at the output per unit of the motor channel.
        initial_angle: Arm angle at the start [rad].
        initial_speed: Speed at the start [rad/s]; zero unless the run says that it does not begin at rest.
        motor_zero: Recorded motor angle / n minus the model's q_s at the start [rad].
        outputs: What is compared.
        declared: Every channel that the run declares as output, for prediction.
        offsets: By device, how much later than its stream says its samples are taken [s], where that was aligned.
    """

    run: Run
    index: int
    group: str
    role: Literal["estimate", "validate"] | None
    mode: Mode
    motor_moves: bool
    spring: bool
    ratio: float
    t0: float
    grid_rate: float
    steps: int
    load_half: Vector
    motor_half: Vector
    command_half: Vector
    observed_half: Vector
    command_rate_half: Vector
    load: Drive | None
    motor: Drive | None
    command: Drive | None
    observed: Observed | None
    late_motor: bool
    late_observed: bool
    late_command: bool
    torque_factor: float
    initial_angle: float
    initial_speed: float
    motor_zero: float
    outputs: tuple[Output, ...]
    declared: tuple[Output, ...] = ()
    offsets: Mapping[int, float] = field(default_factory=dict)

    @property
    def turns(self) -> bool:
        """Whether the motor turns: as a degree of freedom, or as its record prescribes."""
        return self.motor_moves or self.mode == "prescribed-motor"

    def takes(self, output: Output) -> bool:
        """Whether ``output`` is the force that a prescribed motion took: the rig's answer, and not its drive's."""
        return self.mode.startswith("prescribed") and output.quantity in FORCES

    @property
    def answers(self) -> bool:
        """Whether the motor's torque is what a prescribed motion of it took, and is compared."""
        return self.mode == "prescribed-motor" and any(self.takes(output) for output in self.outputs)

    @property
    def time(self) -> Vector:
        """Grid nodes on the run's clock [s], shape (steps + 1,)."""
        return self.t0 + np.arange(self.steps + 1) / self.grid_rate

    @functools.cached_property
    def relogged(self) -> Relogged | None:
        """Its torque as further logs would have it; made when first asked for, ``None`` without a noisy log."""
        from jointscope.diagnosis.relog import relogged

        return relogged(self)

    @functools.cached_property
    def begun(self) -> PreparedRun:
        """Its first part, up to ``BEGUN`` after a hit, by which it is told where it was at rest."""
        from jointscope.diagnosis.opening import opening

        return opening(self, BEGUN)

    @property
    def load_force(self) -> Vector | None:
        """External torque on the arm at the nodes [N m], shape (steps + 1,)."""
        return None if self.load is None else self.load_half[::2]

    @property
    def motor_torque(self) -> Vector | None:
        """n T_e at the nodes [N m], shape (steps + 1,)."""
        return None if self.motor is None else self.motor_half[::2]

    @property
    def speed_command(self) -> Vector | None:
        """Commanded speed at the output at the nodes [rad/s], shape (steps + 1,)."""
        return None if self.command is None else self.command_half[::2]


@dataclass(frozen=True, eq=False)
class BaseSpec:
    """The base model's parameters, all at the joint output.

    Attributes:
        names: ``BASE_NAMES``.
        start, lower, upper, scale: Values, bounds and typical sizes, shape (n_theta,).
        free: Which are estimated, shape (n_theta,).
        nuisance: Which are not the joint's (the drive's law, unknown scales), shape (n_theta,).
        merged: Parameters that stand for a sum here, for instance damping -> damping_total.
    """

    names: tuple[str, ...]
    start: Vector
    lower: Vector
    upper: Vector
    scale: Vector
    free: NDArray[np.bool_]
    nuisance: NDArray[np.bool_]
    merged: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Scales:
    """Typical sizes in this campaign, from the base model at its start values.

    Attributes:
        torque: Peak dynamic torque through the transmission [N m].
        wind_up: Peak dynamic wind-up [rad].
        wind_up_rate: Its rate [rad/s].
        speed: Peak arm speed [rad/s].
        motor_speed: Peak motor speed at the output [rad/s].
        travel: Arm travel [rad].
        motor_torque: Peak motor torque at the output [N m]; 0 without.
        load_torque: Peak external torque [N m]; 0 without.
        acceleration: Peak linear (or angular) acceleration over the accelerometers [their unit]; 0 without.
        frequency: Resonance of the arm on the held motor [Hz].
        angle_low, angle_high: Range of arm angles [rad].
        held_low, held_high: The same of the runs whose motor is held; both 0 without any.
        wind_up_low, wind_up_high: Range of wind-up, weight included [rad].
        duration: Longest run [s].
    """

    torque: float
    wind_up: float
    wind_up_rate: float
    speed: float
    motor_speed: float
    travel: float
    motor_torque: float
    load_torque: float
    acceleration: float
    frequency: float
    angle_low: float
    angle_high: float
    held_low: float
    held_high: float
    wind_up_low: float
    wind_up_high: float
    duration: float


@dataclass(frozen=True)
class Own:
    """The base parameters of the joint that the recordings are about.

    Attributes:
        stiffness, damping, inertia: Their names.
        unit: kg m^2 (or kg) to one of ``inertia``.
    """

    stiffness: str
    damping: str
    inertia: str
    unit: float = 1.0


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything that inference needs.

    Attributes:
        rig: Nameplate.
        runs: In the campaign's order.
        base: Parameters.
        scales: Typical sizes.
        torque_calibrated: Whether absolute torque is known anywhere; else parameters are per unit of the input.
        findings: What was put right on the way (inverted channels) and what had to be assumed, one line each.
    """

    rig: Nameplate
    runs: tuple[PreparedRun, ...]
    base: BaseSpec
    scales: Scales
    torque_calibrated: bool = True
    findings: tuple[str, ...] = ()

    @property
    def own(self) -> Own:
        """Which parameters are the joint's own."""
        return Own("stiffness", "damping", "load_inertia")

    def theta(self, **values: float) -> Vector:
        """The start vector with some parameters replaced by name, shape (n_theta,)."""
        theta = self.base.start.copy()
        for name, value in values.items():
            theta[BASE_NAMES.index(name)] = value
        return theta


def recorded_angle(run: PreparedRun) -> Vector | None:
    """The angle at the joint output at the grid's half steps [rad], integrated where a speed was followed; ``None`` without."""
    if run.observed is None:
        return None
    if not run.observed.rate_signal:
        return run.observed_half
    return np.asarray(run.initial_angle + np.cumsum(run.observed_half) / (2.0 * run.grid_rate), dtype=np.float64)
