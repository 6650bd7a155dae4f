"""``base.xml``, ``augmented.xml`` and ``effects.json``: the diagnosed rig as files that anyone can load.

The MJCF stands alone: it holds every effect that MJCF has an element for. ``effects.json`` (format
``jointscope-effects/1``) says what became of each effect and holds, as plain numbers in SI at the joint output, the laws
that MJCF has no element for; :func:`jointscope.sim.effects.physics_of` steps them.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jointscope.atomic import write_text
from jointscope.errors import InputError
from jointscope.models.effects.augment import FORMAT, Augmented, alone, augment
from jointscope.models.rig import write_mjcf

AUGMENTED, BASE, DESCRIPTION = "augmented.xml", "base.xml", "effects.json"


def write_augmented(model: Mapping[str, Any], directory: Path) -> Augmented:
    """Write the three files into ``directory``.

    Args:
        model: Content of a diagnosis' ``model.json``; ``base_alone`` holds the base parameters that fit best without
            the effects, which ``base.xml`` gets.
        directory: Where to.

    Raises:
        InputError: The model can't be said in MuJoCo (see :func:`augment`).
    """
    built, base = augment(model), augment(alone(model))
    write_mjcf(base.spec, directory / BASE)
    write_mjcf(built.spec, directory / AUGMENTED)
    content = {
        **built.description,
        "model": AUGMENTED,
        "base": {
            "model": BASE,
            **{key: base.description[key] for key in ("rig", "spring", "laws", "drive", "torque_offset")},
        },
    }
    write_text(directory / DESCRIPTION, json.dumps(content, indent=2, allow_nan=False) + "\n")
    return built


def read_description(path: Path) -> dict[str, Any]:
    """Content of an ``effects.json``.

    Raises:
        InputError: There is none, or it is of another format.
    """
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            path, None, "no such file", fix="write one with: jointscope diagnose CAMPAIGN --out DIR"
        ) from None
    except ValueError as problem:
        raise InputError(path, None, f"not JSON: {problem}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        found = content.get("format") if isinstance(content, dict) else None
        raise InputError(path, "format", f"must be {FORMAT!r}", value=found)
    return content
