"""The PLC's torque log: properly band-limited, or distorted in one of the ways such logs are."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from jointscope.sim.measurement import Device, MeasurementError, interpolate_grid

Real = NDArray[np.float64]
LogKind = Literal["band-limited", "hold", "average", "alias"]


@dataclass(frozen=True, kw_only=True)
class TorqueLog:
    """How the drive's torque gets into the log.

    Attributes:
        kind: ``band-limited``: as a sample should be. ``hold``: band-limited at ``rate``, and that value repeated until
            the next. ``average``: mean over the last 1/rate. ``alias``: the unfiltered torque at ``rate``, repeated.
        rate: At which the log is refreshed [Hz]; ``None`` for the device's own.
    """

    kind: LogKind = "band-limited"
    rate: float | None = None

    def __post_init__(self) -> None:
        if self.rate is not None and not self.rate > 0.0:
            raise MeasurementError(f"TorqueLog.rate = {self.rate}: must be positive")

    def sample(self, device: Device, torque: Real, timestep: float, stamps: Real) -> Real:
        """The log at ``stamps`` [s] of ``torque`` [N m], shape (m,), given on a grid of ``timestep`` [s]."""
        if self.kind == "band-limited":
            return device.sample(torque, timestep, stamps)
        rate = self.rate or device.sampling_rate
        refreshed = np.floor(stamps * rate + 1e-9) / rate  # the last time at which the log took a value
        if self.kind == "hold":
            slow = Device(sampling_rate=rate, anti_alias=device.anti_alias, clock=device.clock)
            return slow.sample(torque, timestep, refreshed)
        instants = device.clock.true_times(refreshed)
        if self.kind == "alias":
            return interpolate_grid(torque, timestep, instants)
        return _mean_before(torque, timestep, instants, 1.0 / rate)


def _mean_before(values: Real, timestep: float, times: Real, span: float) -> Real:
    """Mean over ``span`` [s] before each of ``times`` [s]; the first value holds before the grid."""
    deviation = values - values[0]
    steps = 0.5 * (deviation[1:] + deviation[:-1]) * timestep
    integral = np.concatenate([[0.0], np.cumsum(steps)])

    def up_to(instants: Real) -> Real:
        inside = np.clip(instants, 0.0, None)
        return interpolate_grid(integral, timestep, inside)

    return np.asarray(values[0] + (up_to(times) - up_to(times - span)) / span, dtype=np.float64)
