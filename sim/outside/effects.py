"""Every law that a case may conceal, by ``name@location``."""

from __future__ import annotations

from typing import Final

from jointscope.sim.outside import (
    effects_drive,
    effects_friction,
    effects_recording,
    effects_structure,
    effects_transmission,
)
from jointscope.sim.outside.effect import Maker

MAKERS: Final[dict[str, Maker]] = {
    **effects_friction.MAKERS,
    **effects_transmission.MAKERS,
    **effects_drive.MAKERS,
    **effects_structure.MAKERS,
    **effects_recording.MAKERS,
}
