"""The simulator's own error: FRFs of the stepped and measured model against the closed form, 0.5-100 Hz."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from jointscope.models.joint import Complex, hammer_accelerance, load_acceleration_per_torque
from jointscope.models.parameters import Rig
from jointscope.models.rig import brake, rig_spec
from jointscope.sim import stepping
from jointscope.sim.measurement import Device
from jointscope.sim.pulse import Pulse

Real = NDArray[np.float64]

MAGNITUDE_LIMIT = 1e-3  # relative
PHASE_LIMIT = 0.1  # deg
FREQUENCIES = np.arange(0.5, 100.25, 0.5)  # Hz
_PULSE = Pulse(start=0.2, contact_time=4e-3, peak=1.0)
_MOTOR_RECORD = 30.0  # s; the rigid body coasts down with J/(b_m + b_l) = 3 s: 5e-5 of its speed is left
_HAMMER_RECORD = 2.5  # s


@dataclass(frozen=True, kw_only=True)
class Deviation:
    """Worst deviation of an FRF from the closed form over 0.5-100 Hz.

    Attributes:
        magnitude_error: |H|/|G| - 1, its largest magnitude [-].
        phase_error_deg: arg(H/G), its largest magnitude [deg].
    """

    magnitude_error: float
    phase_error_deg: float

    @property
    def within_limits(self) -> bool:
        """Both at most 0.1 % and 0.1 degree."""
        return self.magnitude_error <= MAGNITUDE_LIMIT and self.phase_error_deg <= PHASE_LIMIT


@dataclass(frozen=True, kw_only=True)
class Calibration:
    """The simulator's own error for the motor's torque and for the hammer."""

    motor: Deviation
    hammer: Deviation

    @property
    def passed(self) -> bool:
        """Both within 0.1 % and 0.1 degree."""
        return self.motor.within_limits and self.hammer.within_limits


def calibrate(rig: Rig, timestep: float = stepping.TIMESTEP) -> Calibration:
    """Drive the rig's models with one pulse each through the functions that every simulated run passes.

    The torque is sampled at 500 Hz by one device and the acceleration at 1024 Hz by another, without noise; the
    FRF of these samples and that of the stepping grid itself are both compared, and the worse counts. Gravity is off,
    because the closed form knows none.

    Args:
        rig: Its arm at rest in a horizontal plane.
        timestep: h [s].
    """
    level = replace(rig, gravity=0.0)
    spec = rig_spec(level)
    s = np.asarray(2j * np.pi * FREQUENCIES, dtype=np.complex128)
    per_torque = load_acceleration_per_torque(rig.joint, s) * rig.joint.efficiency * rig.joint.reduction_ratio
    return Calibration(
        motor=_deviation(
            level,
            stepping.machine(spec, timestep),
            "motor",
            Device(sampling_rate=500.0),
            _MOTOR_RECORD,
            per_torque,
        ),
        hammer=_deviation(
            level,
            stepping.machine(brake(spec, 0.0), timestep),
            "hammer",
            Device(sampling_rate=1024.0),
            _HAMMER_RECORD,
            hammer_accelerance(rig.joint, s) * rig.hammer_radius,
        ),
    )


def _deviation(
    rig: Rig, machine: stepping.Machine, actuator: str, device: Device, duration: float, closed_form: Complex
) -> Deviation:
    times = stepping.grid(duration, machine.timestep)
    inputs = stepping.stack_inputs(machine, {actuator: _PULSE.force(times)}, len(times))
    trace = stepping.step(machine, np.zeros(machine.model.nq), inputs)
    excitation = trace.inputs[actuator]
    response = trace.signals["accelerometer"][:, 2] / rig.accelerometer_radius

    grid = _spectrum(response, 1.0 / machine.timestep) / _spectrum(excitation, 1.0 / machine.timestep)
    daq = Device(sampling_rate=1024.0)
    sampled = [
        _spectrum(d.sample(values, machine.timestep, d.stamps(duration)), d.sampling_rate)
        for d, values in ((daq, response), (device, excitation))
    ]
    ratios = np.concatenate([grid / closed_form, sampled[0] / sampled[1] / closed_form])
    return Deviation(
        magnitude_error=float(np.abs(np.abs(ratios) - 1.0).max()),
        phase_error_deg=float(np.degrees(np.abs(np.angle(ratios)).max())),
    )


def _spectrum(samples: Real, rate: float) -> Complex:
    """Fourier integral of ``samples``, shape (n,), at :data:`FREQUENCIES`."""
    spacing = FREQUENCIES[1] - FREQUENCIES[0]
    chirp = signal.CZT(
        len(samples),
        m=len(FREQUENCIES),
        w=np.exp(-2j * np.pi * spacing / rate),
        a=np.exp(2j * np.pi * FREQUENCIES[0] / rate),
    )
    return np.asarray(chirp(samples), dtype=np.complex128) / rate
