"""What the run's output channels would have held: the machine's signals, seen, coupled, sampled and kept."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import RefusedError
from jointscope.recordings.campaign import FORCES, Campaign, Channel, Run, Signal, gearing
from jointscope.sim.measurement import Device
from jointscope.sim.measurement_sensors import iepe
from jointscope.sim.physics import Acquisition
from jointscope.sim.stepping import Trace

Real = NDArray[np.float64]

_KINDS = {
    "angle": "angle", "position": "angle", "angular-velocity": "speed", "velocity": "speed",
    "angular-acceleration": "acceleration", "acceleration": "acceleration",
}  # fmt: skip


def read_output(
    campaign: Campaign,
    run: Run,
    signal: Signal,
    trace: Trace,
    radii: dict[float, str],
    origin: float,
    acquisition: Acquisition,
) -> Real:
    """Samples of one output channel without noise, shape (n,), read-only.

    Args:
        campaign: For its nameplate.
        run: Whose output it is.
        signal: The channel.
        trace: What the machine did.
        radii: Accelerometers of the model by their radius [m].
        origin: Start of the trace on the run's clock [s].
        acquisition: The instruments.

    Raises:
        RefusedError: The channel measures something that the model does not have.
    """
    channel, stream = signal.channel, signal.stream
    values = acquisition.seen(signal, _ideal(campaign, run, signal, trace, radii), trace)
    if channel.coupling == "ac":
        values = iepe(values, trace.timestep, channel.low_cutoff) if channel.low_cutoff else values - values[0]
    true = acquisition.clock(signal).true_times(stream.times) - origin
    device = Device(sampling_rate=stream.sampling_rate)
    samples = acquisition.kept(signal, device.sample(values, trace.timestep, true))
    samples.setflags(write=False)
    return samples


def _ideal(campaign: Campaign, run: Run, signal: Signal, trace: Trace, radii: dict[float, str]) -> Real:
    channel, signals = signal.channel, trace.signals
    at_motor = channel.location == "motor"
    two = campaign.rig.topology == "two-inertia"
    if channel.quantity == "linear-acceleration" and channel.radius in radii:
        return signals[radii[channel.radius]][:, 2 if channel.direction == "tangential" else 0]
    absolute = channel.quantity in ("linear-acceleration", "angular-acceleration", "acceleration") and not at_motor
    if absolute:  # an accelerometer rides on the mount too, if that moves
        return np.asarray(signals["arm acceleration"] + signals.get("base acceleration", 0.0))
    if channel.quantity in _KINDS and channel.location in ("motor", "arm", "load"):
        side = "motor" if at_motor and two else "arm"
        name = f"{side} {_KINDS[channel.quantity]}"
        values = signals.get(name, np.zeros(len(trace.times)))  # a braked motor stands still
        return values * gearing(channel.quantity, "motor", ratio(campaign)) if at_motor else values
    if channel.quantity in ("force", "torque", "current", "voltage") and "load force" in signals:
        return signals["load force"] / (channel.radius or 1.0) / _per_unit(campaign, channel)
    torque = trace.inputs.get("motor", trace.inputs.get("motor on load"))
    if at_motor and torque is not None and channel.quantity in FORCES:
        return torque / _per_unit(campaign, channel)
    raise RefusedError(
        f"{signal.stream.file}: {channel.column!r} is a {channel.quantity} at {channel.location}, "
        "which replay does not read"
    )


def _per_unit(campaign: Campaign, channel: Channel) -> float:
    """Torque on the motor shaft per unit of a motor channel [N m]."""
    if channel.quantity == "current" and campaign.rig.torque_constant is not None and channel.calibrated:
        return campaign.rig.torque_constant * (2.0**0.5 if channel.per == "rms" else 1.0)
    return 1.0 / ratio(campaign) if channel.quantity == "torque" and channel.side == "output" else 1.0


def ratio(campaign: Campaign) -> float:
    """n; 1 on a single inertia whose nameplate is silent.

    Raises:
        RefusedError: A two-inertia nameplate lacks it.
    """
    n = campaign.rig.reduction_ratio
    if n is None and campaign.rig.topology == "two-inertia":
        raise RefusedError(f"{campaign.path}: [rig] reduction_ratio is needed to replay motor channels")
    return n or 1.0
