"""From a trace to the streams of a run: sensors, devices and converters of the chain, one stream per device."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from jointscope.models.parameters import Rig
from jointscope.recordings.campaign import Channel, Stream
from jointscope.sim.chain import Chain
from jointscope.sim.measurement import Clock, Device
from jointscope.sim.measurement_sensors import iepe, phase_currents
from jointscope.sim.stepping import Trace

Real = NDArray[np.float64]

_AXIS = {"tangential": 2, "radial": 0}


def daq_stream(
    run: str,
    trace: Trace,
    rig: Rig,
    chain: Chain,
    duration: float,
    rng: np.random.Generator,
    *,
    with_force: bool = False,
    force_skew: float = 0.0,
) -> Stream:
    """Accelerometer, and the hammer's force where there is one, on the DAQ.

    Args:
        run: Id, names the file.
        trace: What the rig did.
        rig: For the radii.
        chain: Devices.
        duration: Of the record [s].
        rng: Of the noise.
        with_force: Whether the hammer is plugged in.
        force_skew: By which this take's force is stamped late against the acceleration [s].
    """
    device, h = chain.daq, trace.timestep
    stamps = device.stamps(duration)
    channels = []
    if with_force:
        skewed = Device(
            sampling_rate=device.sampling_rate,
            anti_alias=device.anti_alias,
            clock=Clock(delay=device.clock.delay + force_skew, ppm=device.clock.ppm),
        )
        force = chain.force_cell.convert(skewed.sample(trace.inputs["hammer"], h, stamps), rng)
        channels.append(
            Channel(
                column="force", quantity="force", unit="N", location="arm", role="input",
                radius=rig.hammer_radius, samples=_frozen(force),
            )
        )  # fmt: skip
    sensor = chain.accelerometer
    for axis in sensor.axes:
        felt = iepe(trace.signals["accelerometer"][:, _AXIS[axis]], h, sensor.low_cutoff)
        samples = sensor.converter.convert(device.sample(felt, h, stamps), rng)
        channels.append(
            Channel(
                column="acceleration" if axis == "tangential" else "radial_acceleration",
                quantity="linear-acceleration", unit="m/s^2", location="arm", role="output",
                radius=rig.accelerometer_radius, direction=axis, coupling="ac", low_cutoff=sensor.low_cutoff,
                full_scale=sensor.converter.full_scale, samples=_frozen(samples),
            )
        )  # fmt: skip
    return _stream(f"{run}.csv", device, stamps, channels)


def plc_stream(
    run: str,
    trace: Trace,
    rig: Rig,
    chain: Chain,
    duration: float,
    rng: np.random.Generator,
    *,
    speed_command: Callable[[float], float] | None = None,
) -> Stream:
    """Torque, motor angle and, in speed control, the command, as the PLC logs them.

    Args:
        run: Id, names the file.
        trace: What the rig did.
        rig: For the reduction ratio.
        chain: Devices.
        duration: Of the record [s].
        rng: Of the noise.
        speed_command: At the joint output [rad/s] as a function of time [s].
    """
    device, h = chain.plc, trace.timestep
    stamps = device.stamps(duration)
    angle = device.sample(rig.joint.reduction_ratio * trace.signals["motor angle"], h, stamps)
    channels = []
    if chain.torque_log is not None:
        torque = chain.torque_log.sample(device, trace.inputs["motor"], h, stamps)
        channels.append(
            Channel(
                column="torque", quantity="torque", unit="N m", location="motor", role="input",
                samples=_frozen(chain.torque_converter.convert(torque, rng)),
            )
        )  # fmt: skip
    channels.append(
        Channel(
            column="motor_angle", quantity="angle", unit="rad", location="motor", role="output",
            samples=_frozen(chain.encoder.read(angle)),
        )
    )  # fmt: skip
    if speed_command is not None:
        command = rig.joint.reduction_ratio * np.array([speed_command(t) for t in trace.times])
        channels.append(
            Channel(
                column="speed_command", quantity="speed-command", unit="rad/s", location="motor", role="input",
                samples=_frozen(np.round(device.sample(command, h, stamps), 9)),
            )
        )  # fmt: skip
    return _stream(f"{run}-plc.csv", device, stamps, channels)


def current_stream(
    run: str, trace: Trace, rig: Rig, chain: Chain, duration: float, rng: np.random.Generator
) -> Stream:
    """Three phase currents; ``chain.currents`` must be there. Arguments as of :func:`plc_stream`."""
    probes = chain.currents
    assert probes is not None
    stamps = probes.device.stamps(duration)
    motor = chain.electrical
    currents = phase_currents(
        trace.inputs["motor"],
        rig.joint.reduction_ratio * trace.signals["motor angle"],
        motor.torque_constant,
        motor.pole_pairs,
    )
    channels = [
        Channel(
            column=f"i_{phase}", quantity="phase-current", unit="A", location="motor", role="input",
            samples=_frozen(probes.converter.convert(probes.device.sample(current, trace.timestep, stamps), rng)),
        )
        for phase, current in zip("uvw", currents, strict=True)
    ]  # fmt: skip
    return _stream(f"{run}-currents.npz", probes.device, stamps, channels)


def _stream(file: str, device: Device, stamps: Real, channels: list[Channel]) -> Stream:
    return Stream(file=file, sampling_rate=device.sampling_rate, length=len(stamps), channels=tuple(channels))


def _frozen(samples: Real) -> Real:
    samples = np.array(samples)
    samples.setflags(write=False)
    return samples
