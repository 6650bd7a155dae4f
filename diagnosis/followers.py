"""Channels at the arm that go where the motor goes: which way round they are, without a model.

What the joint winds up is little beside the turn, and slow motion is far below the resonance. So the arm's angle is the
motor's, and its acceleration the motor's angle twice differentiated, wherever the motor turns far; a motor that rubs or
cogs, by which a model driven by the torque is misled, turns no sign round.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.problem import Observed, Output, PreparedRun
from jointscope.diagnosis.responses import channel_key

Vector = NDArray[np.float64]

PLAIN = 0.4  # mean cosine beyond which a channel plainly follows, or plainly runs against it
SLOW = (0.3, 5.0)  # Hz, in which accelerations are compared


def followers_polarities(runs: tuple[PreparedRun, ...]) -> dict[tuple[object, ...], float]:
    """+1 for each kind of channel at the arm that plainly follows the motor's angle, -1 for what runs against it.

    Kinds of which the recordings don't tell are left out.
    """
    found: dict[tuple[object, ...], list[float]] = {}
    for run in runs:
        motor = run.observed
        if motor is None or motor.side != "motor" or motor.rate_signal or motor.commanded:
            continue
        for output in run.outputs:
            agreement = None
            if output.location != "motor" and output.quantity in ("angle", "position"):
                agreement = _turned(motor, output)
            elif output.location == "arm" and output.quantity in ("linear-acceleration", "angular-acceleration"):
                agreement = _accelerated(motor, output)
            if agreement is not None:
                found.setdefault(channel_key(run, output), []).append(agreement)
    means = {key: float(np.mean(values)) for key, values in found.items()}
    return {key: float(np.sign(mean)) for key, mean in means.items() if abs(mean) > PLAIN}


def beside_own_position(
    runs: tuple[PreparedRun, ...],
) -> dict[tuple[object, ...], tuple[tuple[object, ...], float]]:
    """Of each kind of acceleration that plainly is a position's second derivative or runs against it: that kind, and +1 or -1.

    Whatever hits or holds the body, a model without it would turn its acceleration round; its own position would not.
    """
    found: dict[tuple[object, ...], list[float]] = {}
    whose: dict[tuple[object, ...], tuple[object, ...]] = {}
    for run in runs:
        for output in run.outputs:
            if output.quantity not in ("linear-acceleration", "angular-acceleration", "acceleration"):
                continue
            own = [o for o in run.outputs if o.location == output.location and o.quantity in ("angle", "position")]
            if not own or output.location == "motor":
                continue
            agreement = _slow_alike(output, _differentiated_twice(own[0], output.times))
            if agreement is not None:
                found.setdefault(channel_key(run, output), []).append(agreement)
                whose[channel_key(run, output)] = channel_key(run, own[0])
    means = {key: float(np.mean(values)) for key, values in found.items()}
    return {key: (whose[key], float(np.sign(mean))) for key, mean in means.items() if abs(mean) > PLAIN}


def _differentiated_twice(position: Output, times: Vector) -> Vector:
    kept = position.mask
    data = np.interp(position.times, position.times[kept], position.data[kept]) if np.any(kept) else position.data
    return np.interp(times, position.times, np.gradient(np.gradient(data)) * position.rate**2)


def _turned(motor: Observed, output: Output) -> float | None:
    """Correlation of an angle with the motor's."""
    turned, data = motor.signal(output.times)[output.mask], output.data[output.mask]
    if data.size < 2 or not (np.std(turned) > 0.0 and np.std(data) > 0.0):
        return None
    return float(np.corrcoef(turned, data)[0, 1])


def _accelerated(motor: Observed, output: Output) -> float | None:
    """Cosine between an acceleration along the arm's path and the motor's angle twice differentiated, both slow."""
    return _slow_alike(output, motor.signal(output.times, 2))


def _slow_alike(output: Output, expected: Vector) -> float | None:
    """Cosine between an acceleration along the path and what is expected of it, both slow."""
    if output.direction == "radial" or output.gravity != 0.0 or output.times.size < 8:
        return None
    window = np.hanning(output.times.size)
    f = np.fft.rfftfreq(output.times.size, 1.0 / output.rate)
    slow = (f > SLOW[0]) & (f < SLOW[1])
    data = np.fft.rfft(window * np.where(output.mask, output.data, 0.0))[slow]
    turned = np.fft.rfft(window * expected)[slow]
    if output.low_cutoff:
        turned = turned * (1j * f[slow] / (1j * f[slow] + output.low_cutoff))
    size = float(np.linalg.norm(data) * np.linalg.norm(turned))
    return float(np.real(np.vdot(turned, data))) / size if size > 0.0 else None
