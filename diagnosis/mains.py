"""Hum of the mains: a line at a multiple of 50 or 60 Hz, as weak as cables pick it up, which is no physics of the joint.

A shaken floor and a ground loop look alike in one accelerometer. What tells them is the frequency, which the grid keeps
to 0.2 %, and the size: a line of the mains below 2 % of a channel's signal is taken for the recording's, and reported.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Collection

    from jointscope.diagnosis.search import Hypothesis

MAINS = (50.0, 60.0)  # Hz
KEPT_TO = 0.002  # of its frequency, to which a grid is kept
MULTIPLES = 6  # of it that cables pick up
HUM = 0.02  # of a channel's signal, rms, below which such a line is the recording's
VIBRATION = "external-vibration"


def of_mains(frequency: float) -> bool:
    """Whether a frequency [Hz] is a low multiple of the mains'."""
    return any(abs(frequency / (k * mains) - 1.0) < KEPT_TO for mains in MAINS for k in range(1, MULTIPLES + 1))


def line_of(hypothesis: Hypothesis) -> float | None:
    """Frequency [Hz] of the line from outside that a hypothesis holds, or ``None``."""
    _, effects = hypothesis.fit.coordinates.unpack(hypothesis.fit.x)
    return next((a.values[0] for a in effects if a.spec.name == VIBRATION), None)


def hums(hypothesis: Hypothesis, known: Collection[str]) -> bool:
    """Whether all that a hypothesis adds to the names ``known`` is a line of the mains."""
    added = {spec.name for spec in hypothesis.specs if f"{spec.name}@{spec.location}" not in known}
    line = line_of(hypothesis)
    return added == {VIBRATION} and line is not None and of_mains(line)
