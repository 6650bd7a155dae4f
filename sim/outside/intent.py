"""Which case conceals what: stratified in blocks of 64, so that a case depends on the seed and its own index only."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

CaseKind = Literal["null", "single", "pair", "unlisted"]
OrderKind = Literal["mixed", "nulls", "singles", "pairs", "unlisted"]

BLOCK: Final = 64
SHARES: Final[dict[OrderKind, dict[CaseKind, int]]] = {
    "mixed": {"null": 14, "single": 36, "pair": 8, "unlisted": 6},
    "nulls": {"null": BLOCK},
    "singles": {"single": BLOCK},
    "pairs": {"pair": BLOCK},
    "unlisted": {"unlisted": BLOCK},
}

# Shortfalls of a model against the recordings, ``name@location``, each once in a block before any is repeated.
LISTED: Final = (
    "coulomb-friction@motor", "coulomb-friction@load", "stribeck-friction@motor", "stribeck-friction@load",
    "load-dependent-friction@transmission", "quadratic-damping@load", "backlash@transmission",
    "stiffness-nonlinearity@transmission", "hysteresis@transmission", "structural-damping@transmission",
    "transmission-error@transmission", "torque-ripple@motor", "drive-lag@motor", "torque-gain@motor", "gravity@load",
    "payload@load", "link-flexibility@load", "base-compliance@base", "neighbour-flexibility@neighbour",
    "end-stop@load", "stiffness-drift@transmission", "external-vibration@base", "delay@acquisition",
    "clock-drift@acquisition", "sensor-tilt@acquisition", "sensor-resonance@acquisition",
    "sensor-saturation@acquisition", "sensor-gain@acquisition", "torque-logging@acquisition",
)  # fmt: skip
REPEATED: Final = (
    "coulomb-friction@motor", "backlash@transmission", "hysteresis@transmission",
    "stiffness-nonlinearity@transmission", "transmission-error@transmission", "link-flexibility@load",
    "coulomb-friction@load",
)  # fmt: skip
UNLISTED: Final = (
    "brake-slip@motor", "one-sided-cable-drag@load", "encoder-eccentricity@acquisition",
    "stiffness-per-motor-turn@transmission", "thixotropic-grease@load", "torque-constant-warms@motor",
    "pickup-of-dI/dt@acquisition", "iepe-rectified-baseline@acquisition",
)  # fmt: skip
PAIRS: Final = (
    ("coulomb-friction@motor", "backlash@transmission"),
    ("coulomb-friction@motor", "transmission-error@transmission"),
    ("torque-ripple@motor", "stiffness-nonlinearity@transmission"),
    ("hysteresis@transmission", "delay@acquisition"),
    ("link-flexibility@load", "coulomb-friction@load"),
    ("drive-lag@motor", "coulomb-friction@motor"),
    ("quadratic-damping@load", "gravity@load"),
    ("load-dependent-friction@transmission", "sensor-tilt@acquisition"),
    ("stribeck-friction@motor", "external-vibration@base"),
    ("backlash@transmission", "sensor-gain@acquisition"),
    ("structural-damping@transmission", "torque-ripple@motor"),
)

Band = Literal["clear", "medium", "faint"]
BANDS: Final[dict[Band, tuple[float, float]]] = {"clear": (30.0, 90.0), "medium": (8.0, 30.0), "faint": (4.0, 8.0)}


@dataclass(frozen=True)
class Intent:
    """What one case is to be.

    Attributes:
        labels: ``name@location`` of what it conceals.
        band: How visible it should be; pairs and unlisted effects are never meant to be faint.
        place: Its place among the block's cases of its kind: nulls take their experiments in turn by it.
    """

    kind: CaseKind
    labels: tuple[str, ...]
    band: Band
    place: int

    @property
    def names(self) -> frozenset[str]:
        """The effects without their locations."""
        return frozenset(label.split("@")[0] for label in self.labels)

    @property
    def hard(self) -> bool:
        """A null with three times the accelerometer's noise, twice the torque's, and hits that scatter more."""
        return self.kind == "null" and self.place % 3 == 1


def intent_of(seed: int, kind: OrderKind, index: int) -> Intent:
    """What case ``index`` of a draw is to be."""
    rng = np.random.default_rng(np.random.SeedSequence([seed, index // BLOCK, 11]))
    intents: list[Intent] = []
    bands = rng.permutation(np.arange(BLOCK) % len(BANDS))
    for case_kind, count in SHARES[kind].items():
        for place, labels in enumerate(_labels(case_kind, count, rng)):
            band: Band = list(BANDS)[int(bands[len(intents)])]
            if case_kind in ("pair", "unlisted") and band == "faint":
                band = "medium"
            intents.append(Intent(case_kind, labels, band, place))
    return intents[int(rng.permutation(BLOCK)[index % BLOCK])]


def _labels(kind: CaseKind, count: int, rng: np.random.Generator) -> Sequence[tuple[str, ...]]:
    if kind == "null":
        return [()] * count
    if kind == "single":
        singles = [*_shuffled(LISTED, rng), *_shuffled(REPEATED, rng), *_shuffled(LISTED, rng)]
        return [(label,) for label in singles[:count]]
    rounds = range(1 + count // min(len(PAIRS), len(UNLISTED)))
    if kind == "pair":
        return [PAIRS[i] for _ in rounds for i in rng.permutation(len(PAIRS))][:count]
    return [(label,) for _ in rounds for label in _shuffled(UNLISTED, rng)][:count]


def _shuffled(labels: Sequence[str], rng: np.random.Generator) -> list[str]:
    return [labels[i] for i in rng.permutation(len(labels))]
