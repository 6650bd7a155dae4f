"""How series are told apart: each has a colour for either theme, and a dash or mark that works without colour."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Look:
    """Appearance of a series.

    Attributes:
        light, dark: Colours on a light and on a dark page.
        dash: Lengths of strokes and gaps [px]; empty for a solid line.
        width: Of the line [px].
    """

    light: str
    dark: str
    dash: tuple[float, ...] = ()
    width: float = 1.5


LOOKS: dict[str, Look] = {
    "recorded": Look("#1f4e79", "#8fc1ee", width=1.8),
    "base": Look("#c2334d", "#ff8fa0", (6, 3)),
    "corrected": Look("#14786e", "#5fd3bf", (9, 3, 2, 3), 1.7),
    "noise": Look("#6b7280", "#a3adba", (1.5, 2.5)),
    "quiet": Look("#8d99ae", "#7d8898", width=0.9),
    "reference": Look("#1c2430", "#e6e9ee", (3, 2)),
    "faint": Look("#7fa3c7", "#4f7aa3", width=0.8),
    "band": Look("#e7a3ad", "#8a4450"),
    "level-1": Look("#0b3c6f", "#b8dcff", width=1.6),
    "level-2": Look("#2f7fc1", "#6fb1ea", (7, 2), 1.5),
    "level-3": Look("#6d4fb3", "#b9a4f2", (2, 2), 1.5),
    "level-4": Look("#8a5a00", "#e2b04a", (10, 3, 2, 3, 2, 3), 1.5),
    "motor-order": Look("#c2334d", "#ff8fa0", (5, 4), 1.2),
    "motor-order-2": Look("#c2334d", "#ff8fa0", (12, 5), 1.2),
    "output-order": Look("#14786e", "#5fd3bf", (1.5, 3), 1.4),
}
"""By role. ``level-1`` is the weakest excitation."""


def level_look(rank: int) -> str:
    """Look of the ``rank``-th level from below; there are four, later ones share the last."""
    return f"level-{min(rank + 1, 4)}"
