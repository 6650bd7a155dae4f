r"""The instruments' faults: inputs as the machine felt them, outputs as the faulty device wrote them down.

what happened at t is stamped (1 + ppm 1e-6) t + delay by the device that is not the DAQ
accelerometer: cos(tilt) tangential + sin(tilt) radial, times its gain, through its mount, clipped
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from jointscope.models.parameters import STANDARD_GRAVITY
from jointscope.recordings.bandlimited import bandlimited
from jointscope.recordings.campaign import Run, Signal
from jointscope.recordings.drift import FOLLOWING
from jointscope.sim.effects.torque_log import relogged, unfolded
from jointscope.sim.measurement import Clock
from jointscope.sim.physics import Acquisition, Record
from jointscope.sim.stepping import Trace

Real = NDArray[np.float64]
Law = Mapping[str, Any]

INSTRUMENTS = (  # in the order in which a signal passes them
    "link-sensor", "bend-sensors", "mount-sensor", "sensor-tilt", "accelerometer-gain", "sensor-resonance", "sensor-bandwidth",
    "sensor-saturation", "delay", "encoder-delay", "clock-drift", "force-gain", "torque-log", "drive-lag",
)  # fmt: skip
ACCELERATIONS = ("linear-acceleration", "angular-acceleration", "acceleration")
_MOTOR_TORQUES = ("torque", "current", "phase-current", "voltage", "force")


def instruments(laws: Sequence[Law], run: Run, rig: Mapping[str, Any], torque_offset: float = 0.0) -> Acquisition:
    """The acquisition of one run.

    Args:
        laws: Entries of ``effects.json`` whose kind is in ``INSTRUMENTS``.
        run: The run.
        rig: The description's ``rig``.
        torque_offset: What the logged motor torque lacks, on the motor shaft, or the force that carries a single
            inertia [N m, N or the log's unit].
    """
    late = Clock(
        delay=sum(float(law["delay"]) for law in laws if law["kind"] == "delay"),
        ppm=sum(float(law["ppm"]) for law in laws if law["kind"] == "clock-drift"),
    )
    arm_encoder = sum(float(law["delay"]) for law in laws if law["kind"] == "encoder-delay")
    daq = daq_of(run)
    vertical = rig["plane"] == "vertical" and rig["motion"] == "rotational"

    def clock(signal: Signal) -> Clock:
        device = Clock() if signal.device == daq else late
        if signal.channel.location == "motor" or signal.channel.quantity not in FOLLOWING:
            return device
        return replace(device, delay=device.delay + arm_encoder)

    def acted(signal: Signal, record: Record) -> Record:
        at_motor = signal.channel.location == "motor" and signal.channel.quantity in _MOTOR_TORQUES
        if not at_motor and signal.channel.quantity in ("force", "torque"):
            gain = math.prod(float(law["gain"]) for law in laws if law["kind"] == "force-gain")
            force = _scaled(_contact_only(signal, record, run), 1.0 / gain)
            carried = rig["topology"] == "single-dof" and run.experiment != "hammer"
            return _raised(force, torque_offset) if carried else force
        for law in laws:
            if at_motor and law["kind"] == "torque-log":
                log = float(law["rate"]), str(law["form"]), float(law.get("age", 0.0))
                logged = record(signal.times)
                samples = (
                    unfolded(logged, signal.sampling_rate, float(law["line"]), log[2])
                    if "line" in law
                    else relogged(logged, signal.sampling_rate, *log)
                )
                record = bandlimited(samples, signal.sampling_rate, signal.stream.start)
        record = _shifted(record, clock(signal))
        if at_motor:
            for law in laws:
                if law["kind"] == "drive-lag":
                    time_constant = float(law["time_constant"])
                    record = (
                        _looped(record, time_constant, float(law["damping"]))
                        if "damping" in law
                        else _lagged(record, time_constant)
                    )
            record = _raised(record, torque_offset)
        return record

    def seen(signal: Signal, values: Real, trace: Trace) -> Real:
        if signal.channel.quantity not in ACCELERATIONS:
            return values
        for law in sorted(laws, key=lambda law: INSTRUMENTS.index(law["kind"])):
            if not _meant(law, signal):
                continue
            if law["kind"] == "bend-sensors":
                values = _bent(law, run, signal, values, trace)
            else:
                values = _through(law, signal, values, trace, STANDARD_GRAVITY if vertical else 0.0)
        return values

    def kept(signal: Signal, samples: Real) -> Real:
        if signal.channel.quantity in ACCELERATIONS:
            for law in laws:
                if law["kind"] == "sensor-saturation" and _meant(law, signal):
                    samples = _saturated(samples, law["level"], law.get("knee"))
        return samples

    bent = next((law for law in laws if law["kind"] == "link-sensor"), {})
    return Acquisition(acted=acted, clock=clock, seen=seen, kept=kept, moved=lambda radius: _moved(bent, radius))


def _meant(law: Law, signal: Signal) -> bool:
    """Whether a law that is of one accelerometer is of this one: by its radius on the arm [m]."""
    if "radius" not in law:
        return True
    channel = signal.channel
    return channel.location != "motor" and abs((channel.radius or math.inf) - float(law["radius"])) < _SAME


def _saturated(samples: NDArray[np.float64], level: float, knee: float | None) -> NDArray[np.float64]:
    """Clipped at +-level, or compressed towards it: the p-norm of 1/y and 1/level, p the knee."""
    if knee is None:
        return np.clip(samples, -level, level)
    return np.asarray(samples * np.exp(-np.logaddexp(0.0, knee * np.log(np.abs(samples) / level + 1e-300)) / knee))


def daq_of(run: Run) -> int:
    """The device that samples the mechanics: with the accelerometers, else with the hammer, else the fastest."""
    for wanted in (ACCELERATIONS, ("force",)):
        for signal in run.signals:
            if signal.channel.quantity in wanted and signal.channel.location != "motor":
                return signal.device
    return int(np.argmax([stream.sampling_rate for stream in run.streams]))


def _scaled(record: Record, factor: float) -> Record:
    return lambda times, derivative=0: factor * record(times, derivative)


def _raised(record: Record, offset: float) -> Record:
    return lambda times, derivative=0: record(times, derivative) + (0.0 if derivative else offset)


def _shifted(record: Record, clock: Clock) -> Record:
    if clock == Clock():
        return record
    rate = 1.0 + 1e-6 * clock.ppm
    return lambda times, derivative=0: rate**derivative * record(rate * times + clock.delay, derivative)


def _lagged(record: Record, time_constant: float) -> Record:
    """1/(1 + s tau) on a uniform grid, exact between straight lines, settled at the first value."""

    def lagged(times: Real, derivative: int = 0) -> Real:
        u = record(times, derivative)
        return np.asarray(u[0] + _delayed(u - u[0], times, time_constant).real, dtype=np.float64)

    return lagged


def _looped(record: Record, time_constant: float, damping: float) -> Record:
    """1/(1 + s t + (s t / 2 zeta)^2): the sum of its two first-order stages, complex where it rings."""
    apart = 1.0 - 1.0 / complex(damping) ** 2
    spread = np.sqrt(apart if abs(apart) > 1e-6 else 1e-6 + 0.0j)  # of a double pole, two that are nearly one
    p, q = (2.0 * damping**2 / time_constant * (-1.0 + side * spread) for side in (1.0, -1.0))

    def looped(times: Real, derivative: int = 0) -> Real:
        u = record(times, derivative)
        v = u - u[0]
        stages = q / (q - p) * _delayed(v, times, -1.0 / p) + p / (p - q) * _delayed(v, times, -1.0 / q)
        return np.asarray(u[0] + stages.real, dtype=np.float64)

    return looped


def _delayed(u: Real, times: Real, time_constant: complex) -> NDArray[np.complex128]:
    steps = time_constant * (len(times) - 1) / float(times[-1] - times[0])
    kept = np.exp(-1.0 / steps)
    now = 1.0 - steps * (1.0 - kept)
    return np.asarray(lfilter([now, 1.0 - kept - now], [1.0, -kept], u), dtype=np.complex128)


_SAME = 1e-3  # m
_CONTACT_SHARE, _CONTACT_NOISE, _CONTACT_MARGIN, _LONGEST_CONTACT = 0.005, 6.0, 0.008, 0.25


def _contact_only(signal: Signal, record: Record, run: Run) -> Record:
    """A hammer pushes in contact only: elsewhere its cell's noise is no force. Other forces stay as they are."""
    samples = signal.samples
    hammer = run.experiment == "hammer" and signal.channel.quantity == "force" and signal.channel.location == "arm"
    if not hammer or samples.size < 64:
        return record
    finite = samples[np.isfinite(samples)]
    rest = float(np.median(finite))
    noise = 1.4826 * float(np.median(np.abs(finite - rest)))
    size = np.abs(np.nan_to_num(samples - rest))
    touching = size > max(_CONTACT_NOISE * noise, _CONTACT_SHARE * float(size.max()))
    if not touching.any() or touching.mean() > _LONGEST_CONTACT:
        return record
    margin = max(2, round(_CONTACT_MARGIN * signal.sampling_rate))
    touching = np.convolve(touching, np.ones(2 * margin + 1), mode="same") > 0.5
    return bandlimited(np.where(touching, samples - rest, 0.0), signal.sampling_rate, signal.stream.start)


def _through(law: Law, signal: Signal, values: Real, trace: Trace, gravity: float) -> Real:
    """One law's share in what an accelerometer sees."""
    kind, channel, h = law["kind"], signal.channel, trace.timestep
    if kind == "accelerometer-gain":
        return float(law["gain"]) * values
    if kind == "sensor-resonance":
        return _mount(values, law["frequency"], law["damping"], h)
    if kind == "sensor-bandwidth":
        return _bandwidth(values, law["frequency"], h)
    if channel.location == "motor":
        return values
    radius = channel.radius or 1.0
    if kind == "link-sensor" and channel.direction == "tangential":
        scale = radius if channel.quantity == "linear-acceleration" else 1.0
        follows = float(law["shape"]) * (_moved(law, radius) / radius if channel.radius else 1.0)
        return np.asarray(values + follows * scale * trace.signals["link acceleration"])
    if kind == "mount-sensor" and channel.direction == "tangential":
        linear = channel.quantity == "linear-acceleration"
        lever = (float(law["turn"]) - 1.0) * (radius if linear else 1.0) + (float(law["slide"]) if linear else 0.0)
        return np.asarray(values + lever * trace.signals["base acceleration"])
    if kind == "sensor-tilt" and channel.quantity == "linear-acceleration":
        q, v = trace.signals["arm angle"], trace.signals["arm speed"]
        cos, sin = math.cos(law["angle"]), math.sin(law["angle"])
        if channel.direction == "radial":
            return np.asarray(
                cos * values - sin * (radius * trace.signals["arm acceleration"] + gravity * np.cos(q))
            )
        return np.asarray(cos * values + sin * (gravity * np.sin(q) - radius * v**2))
    return values


def _moved(law: Law, radius: float) -> float:
    """By how much of its mode an arm moves at ``radius`` [m]: a power of how far beyond its elbow or clamp that is."""
    return float(max(0.0, radius - float(law.get("elbow", 0.0))) ** float(law.get("curve", 1.0)))


def _bent(law: Law, run: Run, signal: Signal, values: Real, trace: Trace) -> Real:
    """What an accelerometer on the arm reads of the joint's mode and of every further one, by its place among them."""
    placed = [
        (s.device, s.channel.column)
        for s in run.signals
        if s.channel.quantity in ACCELERATIONS
        and s.channel.location != "motor"
        and s.channel.direction == "tangential"
    ]
    if (signal.device, signal.channel.column) not in placed:
        return values
    k = placed.index((signal.device, signal.channel.column))
    if k >= len(law["shapes"]):
        return values
    scale = (signal.channel.radius or 1.0) if signal.channel.quantity == "linear-acceleration" else 1.0
    own = trace.signals["arm acceleration"] + trace.signals.get("base acceleration", 0.0)
    modes = (float(mode["shares"][k]) * trace.signals[f"{mode['joint']} acceleration"] for mode in law["modes"])
    return np.asarray(values + scale * ((float(law["shapes"][k]) - 1.0) * own + sum(modes)))


def _mount(values: Real, frequency: float, damping: float, timestep: float) -> Real:
    """w^2/(s^2 + 2 zeta w s + w^2), bilinear and prewarped, settled at the first value."""
    k = math.tan(math.pi * min(frequency * timestep, 0.45))
    a = np.array([1.0 + 2.0 * damping * k + k * k, 2.0 * (k * k - 1.0), 1.0 - 2.0 * damping * k + k * k])
    return np.asarray(values[0] + lfilter(k * k * np.array([1.0, 2.0, 1.0]), a, values - values[0]))


def _bandwidth(values: Real, frequency: float, timestep: float) -> Real:
    """1/(1 + s/w), bilinear and prewarped, settled at the first value."""
    k = math.tan(math.pi * min(frequency * timestep, 0.45))
    return np.asarray(values[0] + lfilter([k, k], [1.0 + k, k - 1.0], values - values[0]))
