"""The single-joint bench's measurement chain: DAQ for force and acceleration, PLC for the drive, phase currents."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from jointscope.sim.measurement import Clock, Converter, Device
from jointscope.sim.measurement_log import TorqueLog
from jointscope.sim.measurement_sensors import Encoder

AccelerometerAxis = Literal["tangential", "radial"]


@dataclass(frozen=True, kw_only=True)
class Accelerometer:
    """An IEPE accelerometer on the arm.

    Attributes:
        low_cutoff: First-order high-pass [Hz].
        converter: Range [m/s^2], bits and noise [m/s^2 rms].
        axes: Which of its axes are recorded.
    """

    low_cutoff: float = 0.5
    converter: Converter = field(default_factory=lambda: Converter(full_scale=490.0, noise_rms=0.02))
    axes: tuple[AccelerometerAxis, ...] = ("tangential",)


@dataclass(frozen=True, kw_only=True)
class Electrical:
    """The motor's electrical figures; the paper prints them for its other motor (Table 3).

    Attributes:
        torque_constant: K_t [N m/A].
        pole_pairs: [-].
    """

    torque_constant: float = 0.458
    pole_pairs: int = 5


@dataclass(frozen=True, kw_only=True)
class CurrentProbes:
    """Three phase currents on a device of their own.

    Attributes:
        device: 10 kHz.
        converter: Range, bits and noise [A].
    """

    device: Device = field(default_factory=lambda: Device(sampling_rate=10_000.0))
    converter: Converter = field(default_factory=lambda: Converter(full_scale=20.0, bits=16, noise_rms=0.005))


@dataclass(frozen=True, kw_only=True)
class Chain:
    """Everything between the rig and the campaign.

    Attributes:
        daq: Samples force and acceleration.
        accelerometer: On the arm.
        force_cell: Of the hammer [N].
        plc: Logs the drive's torque, motor angle and speed command.
        torque_log: How the torque gets into the PLC's log; ``None`` where the drive doesn't say it.
        torque_converter: [N m] on the motor shaft.
        encoder: On the motor shaft.
        currents: ``None`` where nobody measures them.
        electrical: Of the motor.
    """

    daq: Device = field(default_factory=lambda: Device(sampling_rate=1024.0))
    accelerometer: Accelerometer = field(default_factory=Accelerometer)
    force_cell: Converter = field(default_factory=lambda: Converter(full_scale=2000.0, noise_rms=0.2))
    plc: Device = field(default_factory=lambda: Device(sampling_rate=500.0))
    torque_log: TorqueLog | None = field(default_factory=TorqueLog)
    torque_converter: Converter = field(
        default_factory=lambda: Converter(full_scale=10.0, bits=16, noise_rms=0.002)
    )
    encoder: Encoder = field(default_factory=Encoder)
    currents: CurrentProbes | None = None
    electrical: Electrical = field(default_factory=Electrical)

    def reach(self, timestep: float) -> float:
        """How long the rig must be simulated beyond the record [s], so that every filter has its other half."""
        devices = [self.daq, self.plc] + ([self.currents.device] if self.currents else [])
        drift = max(1e-6 * abs(device.clock.ppm) for device in devices)  # s per s
        return max(device.reach(timestep) for device in devices) + 10.0 * drift


def noiseless(plc_clock: Clock | None = None) -> Chain:
    """A chain of ideal converters and sensors: filters and rates only, accelerometer still ac-coupled.

    Args:
        plc_clock: Of the PLC against the DAQ.
    """
    fine = Converter(full_scale=1e4, bits=48)
    return Chain(
        accelerometer=Accelerometer(converter=fine),
        force_cell=fine,
        torque_converter=fine,
        plc=Device(sampling_rate=500.0, clock=plc_clock or Clock()),
        encoder=Encoder(counts_per_turn=2.0**40),
    )
