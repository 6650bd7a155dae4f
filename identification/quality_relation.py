"""A relation: one thing that channels of a run must agree on, as a gain that is 1 where nothing is wrong."""

from __future__ import annotations

from dataclasses import dataclass

from jointscope.recordings.campaign import Signal


@dataclass(frozen=True, eq=False)
class Party:
    """A signal in a relation: multiplying it by s multiplies the relation's gain by s**exponent."""

    signal: Signal
    exponent: int


@dataclass(frozen=True, eq=False)
class Relation:
    """One thing that channels must agree on.

    Attributes:
        gain: Measured over expected, with its sign; only the sign counts where ``high`` is infinite.
        low: Smallest gain that is no contradiction.
        high: Largest.
        says: What was compared, for the message.
        hard: Whether it can accuse a channel by itself; soft ones only break ties.
    """

    parties: tuple[Party, ...]
    gain: float
    low: float
    high: float
    says: str
    hard: bool = True

    def holds(self, gain: float | None = None) -> bool:
        """Whether the gain, or another one, is inside the window."""
        return self.low <= (self.gain if gain is None else gain) <= self.high
