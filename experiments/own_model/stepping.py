"""Edited texts of a model put where MuJoCo finds everything they refer to, and stepped over a campaign's runs."""

from __future__ import annotations

import os
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.errors import JointscopeError
from jointscope.experiments.own_model.scoring import outputs_of
from jointscope.experiments.own_model.xml_document import Draft, Sources, read_sources
from jointscope.recordings.campaign import Campaign, Run
from jointscope.sim.effects import loop_of, physics_of
from jointscope.sim.effects.instruments import INSTRUMENTS
from jointscope.sim.own_model import OwnJoint, load_own
from jointscope.sim.own_stepping import own_run

Real = NDArray[np.float64]

_OF_A_JOINT = ("joint", "joint1", "joint2", "jointinparent")


def place(sources: Sources, texts: Sequence[bytes], folder: Path) -> Path:
    """Write ``texts`` under ``folder`` as the model's files lie to each other; meshes and textures are linked.

    Returns:
        The main file.
    """
    root = Path(os.path.commonpath([str(sources.root), *(str(asset.parent) for asset in sources.assets)]))
    for file, text in zip(sources.files, texts, strict=True):
        target = folder / file.relative_to(root)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(text)
    for asset in sources.assets:
        target = folder / asset.relative_to(root)
        target.parent.mkdir(parents=True, exist_ok=True)
        if not target.exists():
            target.symlink_to(asset)
    return folder / sources.files[0].relative_to(root)


@dataclass(frozen=True, eq=False)
class Bench:
    """What every variant of a model is stepped under.

    Attributes:
        campaign: The recordings.
        description: Content of ``effects.json``: the drive's loop, the torque's offset and the laws of the effects.
        workers: Runs at a time.
    """

    campaign: Campaign
    description: Mapping[str, Any]
    workers: int = 2

    def step(
        self, spec: mujoco.MjSpec, joint: OwnJoint, runs: Sequence[Run], *, effects: bool
    ) -> list[dict[str, Real]]:
        """Outputs of ``runs`` by column.

        Args:
            spec: The variant.
            joint: Which joint is which in it.
            runs: Of the campaign.
            effects: Whether the laws of effects.json act; the torque's offset and the drive's loop always do.
        """
        laws = self.laws(spec, joint) if effects else []
        physics = physics_of({**self.description, "laws": laws})
        loop = loop_of(self.description.get("drive"))

        def one(run: Run) -> dict[str, Real]:
            try:
                made = own_run(self.campaign, run, spec, joint, physics=physics(run), loop=loop)
            except (mujoco.FatalError, FloatingPointError):
                return {s.channel.column: np.full(s.samples.shape, np.nan) for s in outputs_of(run)}
            return {s.channel.column: np.asarray(s.samples, dtype=np.float64) for s in outputs_of(made)}

        with ThreadPoolExecutor(max_workers=self.workers) as pool:
            return list(pool.map(one, runs))

    def laws(self, spec: mujoco.MjSpec, joint: OwnJoint) -> list[Mapping[str, Any]]:
        """Laws that this model's names let act: instruments always, forces where it carries the rig's names."""
        named = joint.link == "reducer" and (joint.rotor == "motor" or spec.joint("motor") is None)

        def acts(law: Mapping[str, Any]) -> bool:
            on_arm = law["kind"] == "friction-level" and law["at"] == "load"
            return law["kind"] in INSTRUMENTS or (named and (not on_arm or spec.tendon("arm") is not None))

        return [law for law in self.description.get("laws", []) if acts(law)]


def renamed(main: Path, joint: OwnJoint) -> OwnJoint:
    """Give motor and load the rig's names in the placed file ``main``, where that changes no meaning; else as it is.

    Laws of effects.json find their coordinates by the names ``motor`` and ``reducer`` (q - q_s).
    """
    names = {joint.link: "reducer", **({} if joint.rotor is None else {joint.rotor: "motor"})}
    if joint.sign != 1 or joint.rotor_ratio != 1.0 or joint.zero_offset != 0.0:
        return joint
    sources = read_sources(main)
    taken = {tag.name for tag in sources.select("joint")} - set(names)
    if taken & set(names.values()):
        return joint
    draft = Draft(sources)
    for tag in sources.tags:
        if tag.kind == "joint" and tag.name in names and "joint" not in tag.attributes:
            draft.put(tag, "name", names[tag.name])
        for key in _OF_A_JOINT:
            if key in tag.attributes and tag.attributes[key][0] in names:
                draft.put(tag, key, names[tag.attributes[key][0]])
    for file, text in zip(sources.files, draft.texts(), strict=True):
        file.write_bytes(text)
    try:
        load_own(main)
    except JointscopeError:
        return joint
    return replace(joint, link="reducer", rotor=None if joint.rotor is None else "motor")
