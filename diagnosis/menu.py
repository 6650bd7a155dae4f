"""Recordings that a laboratory can add, planned in its own levels, rates and sensors: what is struck, driven, moved.

Each item is a handful of takes, given as functions of time, so that any simulator can carry them out. Only what the
joint's model can foretell is planned here; the rest of the menu (hanging masses, preload, blocked output) is words.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.channels import ACCELERATIONS
from jointscope.recordings.campaign import Channel, Experiment, Run, Signal, Stream

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import Problem

Vector = NDArray[np.float64]
Programme = Callable[[Vector], Vector]

HIT_SECONDS = 1.2
DRIVEN_SECONDS = 3.0
HOLD_HZ = 0.6  # of the loose position hold under a torque programme
LIVELY = 80.0  # Hz, upper end of sweeps and multisines
PLACEHOLDER = (
    1e-9  # of an output that is yet to be foretold: a record that never moves would be left out as too coarse
)
WIND_UP_SHARE = (
    0.3  # of the largest torque in the recordings: what a planned torque asks of a joint that never was driven
)


@dataclass(frozen=True, eq=False)
class Lab:
    """What a laboratory has, read from its recordings.

    Attributes:
        accelerometer, arm, hammer: Channels as declared; ``None`` where there is none.
        daq_rate, log_rate: [Hz].
        pulse: Duration of its hits [s].
        force: Largest peak of its hits [the channel's unit].
        angle: Arm angle of most runs [rad].
        torque: Amplitude of a torque programme at the joint output [N m].
        speed: Peak arm speed of a motion [rad/s].
        drives: Whether the motor can be driven with torque and motor angle logged.
        vertical: Whether posture changes the weight's torque.
    """

    accelerometer: Channel | None
    arm: Channel | None
    hammer: Channel | None
    daq_rate: float
    log_rate: float
    pulse: float
    force: float
    angle: float
    torque: float
    speed: float
    drives: bool
    vertical: bool
    ratio: float


def still(times: Vector) -> Vector:
    """Nothing at all."""
    return np.zeros(times.size)


@dataclass(frozen=True, kw_only=True, eq=False)
class Take:
    """One planned run.

    Attributes:
        duration: [s].
        count: How often it is made.
        angle: Of the arm at the start [rad].
        brake: Whether the motor is held.
        force: Of the hammer on its channel [its unit].
        torque: On top of a loose position hold, n T_e before the efficiency [N m at the output].
        speed: Commanded, at the output [rad/s]; where given, a speed loop drives the motor.
        radius: The accelerometer's, in terms of where it sits now.
        one_device: Whether the drive's signals are logged by the DAQ itself.
    """

    experiment: Experiment
    duration: float
    count: int = 1
    angle: float = 0.0
    brake: bool = False
    force: Programme = field(default=still, repr=False)
    torque: Programme = field(default=still, repr=False)
    speed: Programme | None = field(default=None, repr=False)
    struck: bool = False
    radius: float = 1.0
    one_device: bool = False


def _first(problem: Problem, wanted: Callable[[Signal], bool]) -> Signal | None:
    """The signal that stands for its kind, whatever the order of runs and channels: tangential, outermost, fastest."""
    found = [s for run in problem.runs for s in run.run.signals if s.channel.samples is not None and wanted(s)]

    def standing(s: Signal) -> tuple[bool, float, float, float]:
        channel = s.channel
        return (
            channel.direction != "tangential",
            -(channel.radius or 0.0),
            -s.sampling_rate,
            -float(np.max(np.abs(s.samples))),
        )

    return min(found, key=standing, default=None)


def _on_arm(s: Signal, *quantities: str) -> bool:
    return s.channel.location in ("arm", "load") and s.channel.quantity in quantities


def _pulse(force: Vector, rate: float) -> float:
    """Duration of a hit [s]: of what exceeds a tenth of its peak."""
    size = np.abs(force)
    return max(float(np.sum(size > 0.1 * size.max())), 2.0) / rate


def lab_of(problem: Problem) -> Lab:
    """The laboratory behind a campaign."""
    output = [s for run in problem.runs for s in run.run.signals if s.channel.samples is not None]
    accelerometer = _first(problem, lambda s: _on_arm(s, *ACCELERATIONS) and s.channel.role == "output")
    arm = _first(problem, lambda s: _on_arm(s, "angle", "position") and s.channel.role == "output")
    hammers = [run for run in problem.runs if run.run.experiment == "hammer"]
    hits = [s for run in hammers for s in run.run.signals if _on_arm(s, "force") and s.channel.samples is not None]
    hardest = max(hits, key=lambda s: float(np.max(np.abs(s.samples))), default=None)
    mechanics = accelerometer or arm
    log = max((s.sampling_rate for s in output if s.channel.location == "motor"), default=1000.0)
    driven = [run for run in problem.runs if run.motor is not None and run.motor_moves]
    two = problem.rig.topology == "two-inertia" and problem.rig.motion == "rotational"
    known = problem.rig.motor_inertia is not None and problem.rig.reduction_ratio is not None
    sweeps = [run for run in driven if run.run.experiment == "torque-sweep"]
    torque = max((float(np.ptp(run.motor_half)) / 2.0 for run in sweeps), default=0.0)
    commanded = any(run.command is not None for run in problem.runs)

    def declared(s: Signal | None) -> Channel | None:
        return None if s is None else replace(s.channel, samples=None)

    return Lab(
        accelerometer=declared(accelerometer),
        arm=declared(arm),
        hammer=declared(hardest),
        daq_rate=1000.0 if mechanics is None else mechanics.sampling_rate,
        log_rate=log,
        pulse=0.006
        if hardest is None
        else float(np.clip(_pulse(hardest.samples, hardest.sampling_rate), 0.002, 0.03)),
        force=0.0 if hardest is None else float(np.max(np.abs(hardest.samples))),
        angle=float(np.median([run.initial_angle for run in problem.runs])),
        torque=torque or WIND_UP_SHARE * problem.scales.torque,
        speed=max(problem.scales.speed if commanded else 0.0, 0.5),
        drives=two and problem.torque_calibrated and (bool(driven) or known),
        vertical=problem.rig.plane == "vertical" and problem.rig.motion == "rotational",
        ratio=problem.rig.reduction_ratio or 1.0,
    )


# --- programmes ------------------------------------------------------------------------------------------------------


def hit(peak: float, pulse: float, at: float = 0.05) -> Programme:
    """Half a sine of ``peak`` over ``pulse`` [s]."""

    def force(times: Vector) -> Vector:
        inside = (times > at) & (times < at + pulse)
        return np.where(inside, peak * np.sin(np.pi * (times - at) / pulse), 0.0)

    return force


def chirp(amplitude: float, duration: float, low: float = 2.0, high: float = LIVELY) -> Programme:
    """A logarithmic sweep, faded over 0.1 s at either end."""

    def torque(times: Vector) -> Vector:
        rate = math.log(high / low) / duration
        phase = 2.0 * np.pi * low * np.expm1(rate * np.clip(times, 0.0, duration)) / rate
        fade = np.clip(times / 0.1, 0.0, 1.0) * np.clip((duration - times) / 0.1, 0.0, 1.0)
        return np.asarray(amplitude * np.sin(phase) * fade)

    return torque


def multisine(amplitude: float, period: float = 1.0, high: float = LIVELY) -> Programme:
    """Odd harmonics of 1/period up to ``high`` with Schroeder's phases; peak about ``amplitude``, faded in over 0.2 s."""
    orders = np.arange(1, max(2, int(high * period)), 2)
    k = np.arange(orders.size)
    phases = -np.pi * k * (k + 1) / orders.size
    size = amplitude / (1.7 * math.sqrt(orders.size / 2.0))

    def torque(times: Vector) -> Vector:
        waves = np.sin(2.0 * np.pi * orders[:, None] * times[None, :] / period + phases[:, None])
        return np.asarray(size * waves.sum(axis=0) * np.clip(times / 0.2, 0.0, 1.0))

    return torque


def speeds(steps: tuple[float, ...], duration: float) -> Programme:
    """Constant speeds one after the other [rad/s], at rest at both ends, corners rounded over 60 ms."""
    edges = np.linspace(0.1, duration - 0.1, len(steps) + 1)

    def speed(times: Vector) -> Vector:
        value = np.zeros(times.size)
        previous = 0.0
        for edge, target in zip(edges, (*steps, 0.0), strict=True):
            part = np.clip((times - edge) / 0.06, 0.0, 1.0)
            value += (target - previous) * part * part * (3.0 - 2.0 * part)
            previous = target
        return value

    return speed


# --- the menu --------------------------------------------------------------------------------------------------------


def planned(lab: Lab) -> dict[str, tuple[Take, ...]]:
    """The items of the menu that this laboratory can carry out and the model can foretell, by their keys."""
    items: dict[str, tuple[Take, ...]] = {}
    struck = lab.hammer is not None and lab.force > 0.0 and (lab.accelerometer is not None or lab.arm is not None)

    def strike(level: float, **changes: object) -> Take:
        first = Take(
            experiment="hammer",
            duration=HIT_SECONDS,
            count=5,
            angle=lab.angle,
            brake=True,
            struck=True,
            force=hit(level * lab.force, lab.pulse),
        )
        return replace(first, **changes)  # type: ignore[arg-type]

    def drive(torque: Programme, **changes: object) -> Take:
        first = Take(experiment="torque-sweep", duration=DRIVEN_SECONDS, count=2, angle=lab.angle, torque=torque)
        return replace(first, **changes)  # type: ignore[arg-type]

    def move(*steps: float, duration: float = 4.0) -> Take:
        return Take(
            experiment="speed-motion",
            duration=duration,
            count=2,
            angle=0.0 if lab.vertical else lab.angle,
            speed=speeds(steps, duration),
        )

    if struck:
        items["levels"] = (strike(0.08), strike(0.4), strike(-1.0), strike(2.0))
        if lab.accelerometer is not None and lab.accelerometer.radius:
            items["sensor-moved"] = (strike(0.5, radius=0.5), strike(1.0, radius=0.5))
        if lab.vertical:
            items["posture"] = (strike(0.3, angle=0.0), strike(0.3, angle=1.3), strike(1.0, angle=-1.0))
    if lab.drives:
        amplitude = lab.torque
        if struck:
            items["brake"] = (strike(0.3, brake=False), strike(1.0, brake=False))
        items["multisine"] = (drive(multisine(2.0 * amplitude)), drive(multisine(0.4 * amplitude)))
        sweep = chirp(amplitude, DRIVEN_SECONDS)
        items["logging-rate"] = (drive(sweep, one_device=True, count=3),)
        items["sweep-levels"] = (
            drive(chirp(2.0 * amplitude, DRIVEN_SECONDS)),
            drive(chirp(0.3 * amplitude, DRIVEN_SECONDS)),
        )
        v = lab.speed
        items["slow-ramp"] = (
            move(0.02 * v, 0.1 * v, 0.4 * v, -0.4 * v, -0.1 * v, -0.02 * v),
            move(0.05 * v, -0.05 * v, 0.2 * v, -0.2 * v),
        )
        items["constant-speeds"] = (move(0.3 * v, -0.3 * v, duration=4.0), move(0.8 * v, -0.8 * v, duration=4.0))
    return items


def as_run(take: Take, lab: Lab, signals: Mapping[str, Vector] | None = None, name: str = "planned") -> Run:
    """The planned take as a recorded run.

    Args:
        signals: ``force``, ``acceleration``, ``arm`` at the DAQ's rate, ``torque`` (on the motor shaft) and ``motor``
            (the motor's own angle) at the log's; zeros where absent.
    """
    given = dict(signals or {})
    log_rate = max(lab.daq_rate, lab.log_rate) if take.one_device else lab.log_rate
    daq_rate = log_rate if take.one_device else lab.daq_rate
    daq_times = np.arange(int(take.duration * daq_rate)) / daq_rate
    log_times = np.arange(int(take.duration * log_rate)) / log_rate
    daq: list[Channel] = []
    if take.struck and lab.hammer is not None:
        daq.append(replace(lab.hammer, column="force", samples=given.get("force", take.force(daq_times))))
    for channel, key in ((lab.accelerometer, "acceleration"), (lab.arm, "arm")):
        if channel is not None:
            radius = None if channel.radius is None else channel.radius * take.radius
            samples = given.get(key, PLACEHOLDER * np.sin(46.0 * daq_times))
            daq.append(replace(channel, column=key, radius=radius, samples=samples))
    log: list[Channel] = []
    if not take.brake:
        zero = np.zeros(log_times.size)
        log.append(
            Channel(
                column="torque", quantity="torque", unit="N m", location="motor", role="input",
                samples=given.get("torque", zero),
            )
        )  # fmt: skip
        log.append(
            Channel(
                column="motor", quantity="angle", unit="rad", location="motor", role="output",
                samples=given.get("motor", zero),
            )
        )  # fmt: skip
    groups = [(daq_rate, [*daq, *log])] if take.one_device else [(daq_rate, daq), (log_rate, log)]
    streams = tuple(
        Stream(file=f"{name}-{k}.npz", sampling_rate=rate, length=len(group[0].samples), channels=tuple(group))  # type: ignore[arg-type]
        for k, (rate, group) in enumerate(groups)
        if group
    )
    return Run(id=name, experiment=take.experiment, streams=streams, brake=take.brake, arm_angle=take.angle)
