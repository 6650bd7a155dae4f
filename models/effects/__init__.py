"""A diagnosed effect put back into MuJoCo: MJCF where it has an element for it, small loadable data where it has none.

:func:`augment` turns the content of a diagnosis' ``model.json`` into an MjSpec and a description; :func:`write_augmented`
writes ``base.xml``, ``augmented.xml`` and ``effects.json``, which ``sim.effects`` steps.
"""

from __future__ import annotations

from jointscope.models.effects.augment import FORMAT, Augmented, alone, augment
from jointscope.models.effects.files import AUGMENTED, BASE, DESCRIPTION, read_description, write_augmented

__all__ = [
    "AUGMENTED",
    "BASE",
    "DESCRIPTION",
    "FORMAT",
    "Augmented",
    "alone",
    "augment",
    "read_description",
    "write_augmented",
]
