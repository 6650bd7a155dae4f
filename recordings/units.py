"""Units at the border: which unit fits which quantity, and how much SI one of it is (closed list of the format)."""

from __future__ import annotations

import math
from typing import Final

from jointscope.recordings.campaign import Channel, Quantity

STANDARD_GRAVITY: Final = 9.80665  # m/s^2, exact by definition
POUND_FORCE: Final = 4.4482216152605  # N, exact by definition
POUND_FORCE_FOOT: Final = POUND_FORCE * 0.3048  # N m

_FORCE = {"N": 1.0, "lbf": POUND_FORCE}
_TORQUE = {"N m": 1.0, "mN m": 1e-3, "lbf ft": POUND_FORCE_FOOT}
_LINEAR_ACCELERATION = {"m/s^2": 1.0, "g_n": STANDARD_GRAVITY}
_ANGLE = {"rad": 1.0, "deg": math.pi / 180.0, "arcmin": math.pi / 10_800.0, "arcsec": math.pi / 648_000.0}
_SPEED = {"rad/s": 1.0, "rpm": 2.0 * math.pi / 60.0}
_FRF = {
    "accelerance": {"m/s^2/N": 1.0, "g_n/N": STANDARD_GRAVITY, "rad/s^2/(N m)": 1.0},
    "mobility": {"m/s/N": 1.0, "rad/s/(N m)": 1.0},
    "receptance": {"m/N": 1.0, "rad/(N m)": 1.0},
}

FIXED: Final[dict[Quantity, dict[str, float]]] = {
    "force": _FORCE,
    "torque": _TORQUE,
    "phase-current": {"A": 1.0},
    "current": {"A": 1.0},
    "voltage": {"V": 1.0},
    "linear-acceleration": _LINEAR_ACCELERATION,
    "angular-acceleration": {"rad/s^2": 1.0},
    "angle": _ANGLE,
    "angular-velocity": _SPEED,
    "speed-command": {**_SPEED, "m/s": 1.0},  # the latter of a slide, whose motor is counted in metres
    "position": {"m": 1.0},
    "velocity": {"m/s": 1.0},
    "acceleration": _LINEAR_ACCELERATION,
}

_ANALOGUE: Final = ("force", "torque", "phase-current", "current", "voltage", "linear-acceleration",
                    "angular-acceleration", "angular-velocity", "position", "velocity", "acceleration")  # fmt: skip

# unit -> (quantities it fits, the key it can't do without)
_KEYED: Final[dict[str, dict[str, str]]] = {
    "mV": dict.fromkeys(_ANALOGUE, "sensitivity"),
    "counts": {"angle": "counts_per_turn"},
    "%": {"torque": "rated_torque", "current": "rated_current", "phase-current": "rated_current"},
    "permille": {"torque": "rated_torque", "current": "rated_current", "phase-current": "rated_current"},
}


def units_for(quantity: Quantity, form: str | None = None) -> tuple[str, ...]:
    """Every unit in which ``quantity`` may be declared; ``form`` is that of an FRF."""
    fixed = _FRF.get(form or "", {}) if quantity == "frf" else FIXED[quantity]
    return (*fixed, *(unit for unit, fits in _KEYED.items() if quantity in fits), "1")


def required_key(quantity: Quantity, unit: str) -> str | None:
    """The channel key without which ``unit`` has no scale, or ``None``."""
    return _KEYED.get(unit, {}).get(quantity)


def si_factor(channel: Channel) -> float:
    """SI per unit of the file; 1 for an uncalibrated channel.

    ``sensitivity`` is in mV per SI unit; ``counts_per_turn`` in counts per turn of the shaft the channel is on.

    Raises:
        KeyError: The unit doesn't fit the quantity.
    """
    if channel.unit == "1":
        return 1.0 if channel.scale is None else channel.scale
    fixed = _FRF[channel.form or ""] if channel.quantity == "frf" else FIXED[channel.quantity]
    if channel.unit in fixed:
        return fixed[channel.unit]
    value = getattr(channel, _KEYED[channel.unit][channel.quantity])
    if channel.unit == "mV":
        return 1.0 / float(value)
    if channel.unit == "counts":
        return 2.0 * math.pi / float(value)
    return float(value) / (100.0 if channel.unit == "%" else 1000.0)


def si_unit(channel: Channel) -> str:
    """The unit the channel's samples are in once read: SI, or ``"1"`` where its scale is unknown."""
    if not channel.calibrated:
        return "1"
    if channel.quantity == "frf":
        return next(iter(_FRF[channel.form or ""]))
    if channel.quantity == "speed-command" and channel.unit == "m/s":
        return "m/s"
    return next(iter(FIXED[channel.quantity]))


_MEANT: Final = {
    "g": "a bare g is ambiguous; write 'g_n' for 9.80665 m/s^2",
    "G": "a bare G is ambiguous; write 'g_n' for 9.80665 m/s^2",
}


def advice(quantity: Quantity, unit: str, form: str | None = None) -> str:
    """The way out for a unit that doesn't fit: one clause."""
    if unit in _MEANT:
        return _MEANT[unit]
    allowed = units_for(quantity, form)
    plain = {"".join(u.replace("^", "").split()).lower(): u for u in allowed}
    same = plain.get(
        "".join(unit.replace("^", "").replace("*", "").replace("·", "").replace("²", "2").split()).lower()
    )
    if same:
        return f"write {same!r}"
    return (
        f"one of {', '.join(allowed)} fits {quantity}; for any other unit say unit = '1' with scale = its SI value"
    )
