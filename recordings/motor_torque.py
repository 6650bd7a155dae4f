"""The electromagnetic torque on the motor shaft, from whatever the drive recorded of it.

i_k = -i_q sin(p theta_m - 2 pi k/3), k = 0, 1, 2 (phases u, v, w), and T_e = K_t i_q.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import RefusedError
from jointscope.recordings.bandlimited import resampled
from jointscope.recordings.campaign import Nameplate, Run, Signal

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class MotorTorque:
    """T_e at the samples of the device that recorded it.

    Attributes:
        values: Shape (n,), in ``unit``.
        unit: ``N m``; ``A`` where the torque constant is missing (then only ratios per ampere are identifiable);
            ``1`` where the channel's own scale is unknown.
        signed: False where only |T_e| is known (one or two phases, or phases without the motor's angle).
        source: The signal it came from (of several phases the first): its clock, rate and role.
    """

    values: Real
    unit: Literal["N m", "A", "1"]
    signed: bool
    source: Signal

    @property
    def sampling_rate(self) -> float:
        """[Hz]."""
        return self.source.sampling_rate

    @property
    def times(self) -> Real:
        """On the run's clock [s], shape (n,)."""
        return self.source.times


def motor_torque(run: Run, rig: Nameplate) -> MotorTorque | None:
    """T_e of ``run`` on the motor shaft, or ``None`` where nothing of it was recorded.

    A torque channel is preferred to a current, a current to phase currents. A voltage is no torque.

    Raises:
        RefusedError: The recording needs a nameplate value that ``rig`` lacks.
    """
    torques = _inputs_first(run.select("torque", location="motor"))
    if torques:
        return _from_torque(run, rig, torques[0])
    currents = _inputs_first(run.select("current", location="motor"))
    if currents:
        return _from_current(currents[0].samples * _peak(currents[0]), rig, currents[0], signed=True)
    phases = run.select("phase-current", location="motor")
    return _from_phases(run, rig, phases) if phases else None


def _inputs_first(signals: tuple[Signal, ...]) -> list[Signal]:
    return sorted(signals, key=lambda signal: signal.channel.role != "input")


def _from_torque(run: Run, rig: Nameplate, signal: Signal) -> MotorTorque:
    values = signal.samples
    if signal.channel.side == "output":
        if rig.reduction_ratio is None:
            raise RefusedError(
                f"run {run.id}: {signal.channel.column} is a torque at the output; rig.reduction_ratio leads to the motor"
            )
        values = values / rig.reduction_ratio
    return MotorTorque(values=values, unit="N m" if signal.channel.calibrated else "1", signed=True, source=signal)


def _peak(signal: Signal) -> float:
    return math.sqrt(2.0) if signal.channel.per == "rms" else 1.0


def _from_current(current: Real, rig: Nameplate, signal: Signal, *, signed: bool) -> MotorTorque:
    if not signal.channel.calibrated:
        return MotorTorque(values=current, unit="1", signed=signed, source=signal)
    if rig.torque_constant is None:
        return MotorTorque(values=current, unit="A", signed=signed, source=signal)
    return MotorTorque(values=rig.torque_constant * current, unit="N m", signed=signed, source=signal)


def _from_phases(run: Run, rig: Nameplate, phases: tuple[Signal, ...]) -> MotorTorque:
    first = phases[0]
    same = [p for p in phases if p.device == first.device][:3]
    currents = [p.samples * _peak(p) for p in same]
    if len(currents) == 1:
        return _from_current(envelope(currents[0]), rig, first, signed=False)
    if len(currents) == 2:
        currents.append(-currents[0] - currents[1])
    angles = run.select("angle", location="motor")
    if len(same) < 3 or not angles:
        magnitude = np.sqrt(2.0 / 3.0 * np.sum(np.square(currents), axis=0))
        return _from_current(magnitude, rig, first, signed=False)
    if rig.pole_pairs is None:
        raise RefusedError(f"run {run.id}: phase currents need rig.pole_pairs to become a torque")
    angle = resampled(angles[0].samples, angles[0].sampling_rate, angles[0].stream.start, first.times)
    return _from_current(quadrature_current(currents, rig.pole_pairs * angle), rig, first, signed=True)


def quadrature_current(phases: list[Real], electrical_angle: Real) -> Real:
    """i_q = -(2/3) sum_k i_k sin(p theta_m - 2 pi k/3) [A], shape (n,), from phases u, v, w of that shape."""
    turn = 2.0 * math.pi / 3.0
    return np.asarray(
        -2.0 / 3.0 * sum(i * np.sin(electrical_angle - k * turn) for k, i in enumerate(phases)), dtype=np.float64
    )


def envelope(phase: Real) -> Real:
    """|i_q| [A] from one phase, shape (n,): the modulus of its analytic signal (Hilbert).

    Right only while the rotor turns, and away from the ends of the record.
    """
    from scipy.signal import hilbert

    filled = np.where(np.isfinite(phase), phase, 0.0)
    return np.asarray(np.abs(hilbert(filled)), dtype=np.float64)
