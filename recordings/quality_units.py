"""Units that contradict themselves: the file's own label against the declared unit, angles that can't be radians."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Final

import numpy as np

from jointscope.recordings.campaign import Run, Signal
from jointscope.recordings.finding import Finding
from jointscope.recordings.toml_text import channel_line
from jointscope.recordings.units import units_for

# how files spell the units of the closed list
_SPELLINGS: Final = {
    "n": "N", "newton": "N", "newtons": "N", "lbf": "lbf", "nm": "N m", "n.m": "N m", "n*m": "N m", "mnm": "mN m",
    "lbfft": "lbf ft", "a": "A", "v": "V", "mv": "mV", "m/s^2": "m/s^2", "m/s2": "m/s^2", "m/s²": "m/s^2",
    "m/s**2": "m/s^2", "g": "g_n", "gn": "g_n", "g_n": "g_n", "rad": "rad", "deg": "deg", "degree": "deg",
    "degrees": "deg", "°": "deg", "arcmin": "arcmin", "arcsec": "arcsec", "rpm": "rpm", "1/min": "rpm",
    "rad/s": "rad/s", "rad/s^2": "rad/s^2", "m": "m", "m/s": "m/s", "%": "%", "counts": "counts",
}  # fmt: skip
SPINS = "the arm would turn"
_TURNS = 2.0  # of an arm, beyond which an angle is hardly one of radians


def declared_by_label(label: str | None) -> str | None:
    """The unit of the format that a file's label means, or ``None`` where it isn't one of them."""
    return None if label is None else _SPELLINGS.get("".join(label.split()).lower())


def label_findings(run: Run, signal: Signal) -> Iterator[Finding]:
    """``suspicious-unit`` where a file's label contradicts the declaration, or an arm's angle is no radians."""
    channel = signal.channel
    meant = declared_by_label(channel.file_unit)
    if meant is not None and meant not in (channel.unit, "mV"):
        fits = meant in units_for(channel.quantity, channel.form)
        if not fits:
            detail = f"the file labels it {channel.file_unit!r}, no unit of {channel.quantity}: its scale can't be trusted"
            yield Finding("suspicious-unit", run.id, channel.column, detail)
        elif channel.unit != "1":
            detail = f"the file labels it {channel.file_unit!r}, declared is {channel.unit!r}"
            yield Finding("suspicious-unit", run.id, channel.column, detail, channel_line(channel, unit=meant))
    if channel.quantity == "angle" and channel.location == "arm" and channel.unit == "rad":
        span = float(np.nanmax(signal.samples) - np.nanmin(signal.samples))
        if span > _TURNS * 2.0 * math.pi:
            detail = f"{SPINS} {span / (2.0 * math.pi):.0f} times; in degrees it turns by {span:.0f}"
            yield Finding("suspicious-unit", run.id, channel.column, detail, channel_line(channel, unit="deg"))


def arm_angle_findings(run: Run) -> Iterator[Finding]:
    """``suspicious-unit`` where ``arm_angle`` is beyond a turn: degrees, written for radians."""
    if abs(run.arm_angle) > 2.0 * math.pi:
        right = math.radians(run.arm_angle)
        detail = f"arm_angle = {run.arm_angle:g} rad is {abs(run.arm_angle) / (2 * math.pi):.1f} turns; degrees?"
        yield Finding("suspicious-unit", run.id, "", detail, f"arm_angle = {right:.6g}")
