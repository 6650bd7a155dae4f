"""The gravity check: what the rig reads while it stands still, against arm_angle and m g r.

At rest at angle q an ideal dc accelerometer reads g cos(q) along the tangent and g sin(q) along the radius, and the
drive holds n eta T_e = m g r cos(q), give or take its friction.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from jointscope.errors import RefusedError
from jointscope.identification.quality_relation import Party, Relation
from jointscope.models.parameters import STANDARD_GRAVITY
from jointscope.recordings.campaign import Nameplate, Run, Signal
from jointscope.recordings.finding import Finding
from jointscope.recordings.motor_torque import motor_torque
from jointscope.recordings.quality_rest import quiet_start

_G = STANDARD_GRAVITY
TILT = 0.03  # of g: about what a mounting error of 2 degrees costs where it counts most


@dataclass(frozen=True, eq=False)
class Static:
    """A static reading and what gravity makes it [SI]."""

    signal: Signal
    read: float
    expected: float
    uncertainty: float


def static_relations(run: Run, rig: Nameplate) -> Iterator[Relation]:
    """Accelerometers against gravity, encoders against ``arm_angle``, the holding torque against m g r."""
    for static in static_accelerations(run, rig):
        if abs(static.expected) > 0.15 * _G:
            says = f"{static.signal.channel.column} at rest, {static.read:.3g} m/s^2 where gravity gives {static.expected:.3g}"
            gain = static.read / static.expected
            # a tilt or a gain of its own is no unit mistake: only what is far off has to be explained by one
            if not 0.2 < gain < 2.0 and abs(gain) > 0.05:
                yield Relation((Party(static.signal, 1),), gain, 0.93, 1.07, says)
            else:
                yield Relation((Party(static.signal, 1),), gain, 0.2, 2.0, says)
    yield from _encoders(run, rig)
    holding = holding_torque(run, rig)
    if holding is not None and holding.expected != 0.0:
        says = f"{holding.signal.channel.column} while holding the arm"
        yield Relation((Party(holding.signal, 1),), holding.read / holding.expected, 0.3, 3.0, says, hard=False)


def _at_rest(run: Run) -> bool:
    return run.initial == "rest"


def static_accelerations(run: Run, rig: Nameplate) -> list[Static]:
    """Readings of dc accelerometers on the arm before the excitation; none where gravity doesn't act."""
    if rig.plane != "vertical" or rig.motion != "rotational" or not _at_rest(run):
        return []
    found = []
    for signal in run.select("linear-acceleration", location="arm"):
        channel = signal.channel
        quiet = quiet_start(run, signal) if channel.coupling == "dc" and channel.calibrated else None
        if quiet is None or channel.site is not None or channel.point is not None:
            continue
        share = math.cos(run.arm_angle) if channel.direction == "tangential" else math.sin(run.arm_angle)
        uncertainty = 2.5 * float(np.std(quiet)) / math.sqrt(quiet.size)
        found.append(Static(signal, float(np.median(quiet)), _G * share, uncertainty))
    return found


def holding_torque(run: Run, rig: Nameplate) -> Static | None:
    """The drive's torque before the excitation, at the output, against m g r cos(q) [N m]."""
    held = run.brake or any(hold in ("brake", "locked", "free") for hold in run.hold.values())
    if rig.plane != "vertical" or rig.motion != "rotational" or held or not _at_rest(run):
        return None
    if rig.arm_mass is None or rig.arm_com_radius is None or rig.reduction_ratio is None:
        return None
    try:
        torque = motor_torque(run, rig)
    except RefusedError:
        return None
    if (
        torque is None
        or not torque.signed
        or torque.unit != "N m"
        or torque.source.channel.quantity == "phase-current"
    ):
        return None
    quiet = quiet_start(run, torque.source)
    expected = rig.arm_mass * _G * rig.arm_com_radius * math.cos(run.arm_angle)
    if quiet is None or abs(math.cos(run.arm_angle)) < 0.2:
        return None
    lever = float(np.median(torque.values[: quiet.size]) / np.median(torque.source.samples[: quiet.size]))
    scale = lever * rig.reduction_ratio * (rig.efficiency or 1.0)
    uncertainty = abs(scale) * 2.5 * float(np.std(quiet)) / math.sqrt(quiet.size)
    return Static(torque.source, scale * float(np.median(quiet)), expected, uncertainty)


def _encoders(run: Run, rig: Nameplate) -> Iterator[Relation]:
    """An absolute encoder reads arm_angle at the start. Others have a zero of their own, so only a plain factor counts."""
    if not _at_rest(run) or abs(run.arm_angle) < 0.1 or rig.motion != "rotational":
        return
    for signal in run.select("angle"):
        n = rig.reduction_ratio if signal.channel.location == "motor" else 1.0
        first = float(signal.samples[np.isfinite(signal.samples)][0])
        if n is None or signal.channel.role != "output" or not signal.channel.calibrated:
            continue
        gain = first / (n * run.arm_angle)
        plain = any(abs(gain * factor - 1.0) < 0.01 for factor in (-1.0, math.pi / 180.0, -math.pi / 180.0))
        if plain:
            says = f"{signal.channel.column} starts at {gain:.4g} times arm_angle{'' if n == 1.0 else ' n'}"
            yield Relation((Party(signal, 1),), gain, 0.9, 1.1, says, hard=False)


def gravity_findings(run: Run, rig: Nameplate, named: set[str]) -> Iterator[Finding]:
    """``gravity-mismatch`` of channels that no factor explains (those in ``named`` have been reported)."""
    for static in static_accelerations(run, rig):
        column = static.signal.channel.column
        deviation = static.read - static.expected
        if column in named or abs(deviation) <= max(TILT * _G, 6.0 * static.uncertainty):
            continue
        yield Finding("gravity-mismatch", run.id, column, _explained(static, run))
    holding = holding_torque(run, rig)
    if holding is None or holding.signal.channel.column in named:
        return
    share = holding.read / holding.expected
    if not 0.0 <= share <= 2.5:
        detail = (
            f"holds the arm with {holding.read:.3g} N m at the output where m g r cos(arm_angle) is "
            f"{holding.expected:.3g} N m: check the sign of arm_angle's axis, m g r, or friction that holds"
        )
        yield Finding("gravity-mismatch", run.id, holding.signal.channel.column, detail)


def _explained(static: Static, run: Run) -> str:
    channel = static.signal.channel
    head = f"reads {static.read:.3g} m/s^2 at rest where gravity gives {static.expected:.3g} at arm_angle = {run.arm_angle:.4g}"
    if abs(static.read) < 0.05 * _G and abs(static.expected) > 0.15 * _G:
        return f"{head}: an ac-coupled (IEPE) sensor reads nothing; declare coupling = 'ac' with its low_cutoff"
    if abs(static.read) <= _G:
        angle = math.acos(static.read / _G) if channel.direction == "tangential" else math.asin(static.read / _G)
        nominal = abs(run.arm_angle) if channel.direction == "tangential" else run.arm_angle
        return f"{head}: a tilt of {math.degrees(angle - nominal):.1f} deg or a gain of {_ratio(static)} would explain it"
    return f"{head}: more than gravity; a gain of {_ratio(static)} or an offset"


def _ratio(static: Static) -> str:
    return f"{static.read / static.expected:.3g}" if abs(static.expected) > 0.02 * _G else "any size"
