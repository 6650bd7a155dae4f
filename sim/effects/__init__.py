"""A diagnosed model's ``effects.json`` as :class:`~jointscope.sim.physics.Physics`: what MJCF has no element for.

The laws are written from the description alone, in the coordinates of the MJCF beside it.
"""

from __future__ import annotations

from jointscope.sim.effects.description import loop_of, physics_of

__all__ = ["loop_of", "physics_of"]
