"""Which rig and which experiments a case has, so that what it conceals can show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from jointscope.sim.outside.intent import Intent
from jointscope.sim.outside.rig import Rig, Slide, draw_rig

Experiments = Literal["H", "S", "M", "HS", "HM", "SM", "HSM"]  # hits, sweeps, motions

# Experiments of a rotating rig that show an effect; by label where the location matters.
SHOWN_IN: Final[dict[str, tuple[Experiments, ...]]] = {
    "coulomb-friction@motor": ("M", "HM", "SM", "HSM"), "coulomb-friction@load": ("H", "HM", "HSM"),
    "stribeck-friction@motor": ("M", "HM", "HSM"), "stribeck-friction@load": ("HM", "HSM"),
    "load-dependent-friction": ("M", "HM", "HSM"), "quadratic-damping": ("H", "HM", "HSM"),
    "backlash": ("H", "HS", "HSM"), "stiffness-nonlinearity": ("H", "HS", "HSM"), "hysteresis": ("H", "HS", "HSM"),
    "structural-damping": ("HS", "HSM"), "transmission-error": ("M", "HM", "HSM"),
    "torque-ripple": ("M", "SM", "HM", "HSM"), "drive-lag": ("S", "HS", "HSM"), "torque-gain": ("HS", "HSM", "HM"),
    "gravity": ("M", "HM", "HSM"), "payload": ("H", "HS", "HSM"), "link-flexibility": ("H", "HS", "HSM"),
    "base-compliance": ("H", "HS", "HSM"), "neighbour-flexibility": ("H", "HS", "HSM"),
    "end-stop": ("M", "HM", "HSM"), "stiffness-drift": ("H", "HS", "HSM"),
    "external-vibration": ("H", "HS", "HSM", "M"), "delay": ("S", "HS", "HSM"), "clock-drift": ("M", "HM", "HSM"),
    "sensor-tilt": ("HM", "HSM", "M"), "sensor-resonance": ("H", "HS", "HSM"),
    "sensor-saturation": ("H", "HS", "HSM"), "sensor-gain": ("HS", "HSM"), "torque-logging": ("S", "HS", "HSM"),
    "brake-slip": ("H", "HSM"), "one-sided-cable-drag": ("M", "HM", "HSM"),
    "encoder-eccentricity": ("M", "HM", "HSM"), "stiffness-per-motor-turn": ("M", "HM", "HSM"),
    "thixotropic-grease": ("M", "HM", "HSM"), "torque-constant-warms": ("S", "HS", "SM", "HSM"),
    "pickup-of-dI/dt": ("S", "HS", "HSM"), "iepe-rectified-baseline": ("H", "HS", "HSM"),
}  # fmt: skip
COMPLETE: Final[Experiments] = "HSM"
COMPLETE_WEIGHT: Final = 3.0  # of all three experiments against any other choice
VERTICAL: Final = {"load-dependent-friction", "sensor-tilt", "stiffness-per-motor-turn"}
HORIZONTAL: Final = {"payload", "brake-slip", "base-compliance", "neighbour-flexibility"}
RUBBING: Final = {"coulomb-friction@load", "stribeck-friction@load", "quadratic-damping@load"}
SPRINGS: Final = {"backlash", "stiffness-nonlinearity", "hysteresis"}

# What the nulls of a block are, in turn.
NULLS: Final[tuple[tuple[Experiments, Slide | None], ...]] = (
    ("H", None), ("HS", None), ("HSM", None), ("M", None), ("HM", None), ("S", None), ("HSM", None), ("H", None),
    ("HSM", None), ("H", "spring"), ("HS", None), ("M", "rigid"), ("HSM", None), ("HM", None),
)  # fmt: skip
TEXTBOOK_NULLS: Final = (2, 12)  # of those, on the paper's rig


@dataclass(frozen=True)
class Setup:
    """A rig and its experiments."""

    rig: Rig
    experiments: Experiments

    @property
    def rigid(self) -> bool:
        """Whether there is no spring at all."""
        return self.rig.slide == "rigid"


def draw_setup(intent: Intent, rng: np.random.Generator) -> Setup:
    """Rig and experiments for ``intent``."""
    names = intent.names
    experiments, slide = _experiments(intent, rng)
    vertical = bool(rng.random() < 0.5)
    if intent.kind == "null":
        vertical = (intent.place + intent.place // 3) % 2 == 0
    if names & VERTICAL:
        vertical = True
    elif names & HORIZONTAL:
        vertical = False
    if "backlash" in names and rng.random() < 0.75:
        vertical = False
    textbook = intent.kind == "null" and intent.place % len(NULLS) in TEXTBOOK_NULLS
    textbook = textbook or (intent.kind == "single" and bool(rng.random() < 0.08))
    if textbook and not names & HORIZONTAL:
        vertical = True
    return Setup(draw_rig(rng, vertical=vertical, textbook=textbook, slide=slide), experiments)


def _experiments(intent: Intent, rng: np.random.Generator) -> tuple[Experiments, Slide | None]:
    if intent.kind == "null":
        return NULLS[intent.place % len(NULLS)]
    shown = [SHOWN_IN.get(label) or SHOWN_IN[label.split("@")[0]] for label in intent.labels]
    options = [one for one in shown[0] if all(one in other for other in shown)] or [COMPLETE]
    weights = np.array([COMPLETE_WEIGHT if option == COMPLETE else 1.0 for option in options])
    chosen = options[int(rng.choice(len(options), p=weights / weights.sum()))]
    if intent.kind == "single" and rng.random() < 0.12:
        if set(intent.labels) & RUBBING:
            return "M", "rigid"
        if intent.names & SPRINGS:
            return "H", "spring"
    return chosen, None
