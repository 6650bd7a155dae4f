"""The simulation's own numerics: the largest step at which the same model gives what it gives at a far finer one."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.experiments.own_model.content import Content
from jointscope.experiments.own_model.wanted import Change
from jointscope.experiments.own_model.xml_document import Draft, Sources
from jointscope.models.effects.building import EXACT, STUCK
from jointscope.recordings.campaign import Run

Real = NDArray[np.float64]
Step = Callable[[Sequence[Change], Sequence[Run]], list[dict[str, Real]]]

FINE = 1e-4  # s: RK4's error in a reducer's frequency response is below 0.04 % up to 100 Hz
LADDER = (1e-3, 5e-4, 2e-4, FINE)  # s
CONVERGED = 0.005  # RMS difference over RMS that a step may leave


def numerics_change(sources: Sources, content: Content, step: Step, runs: Sequence[Run]) -> Change | None:
    """The settings that the model needs, or ``None`` where its own will do.

    Args:
        sources: The model's text.
        content: What it holds.
        step: Outputs of runs with changes made.
        runs: Of every kind one is stepped.
    """
    if sources.urdf:
        return None
    few = list({(run.experiment, run.brake): run for run in runs}.values())
    own = float(content.system.timestep)
    frictional = any(c.frictionloss > 0.0 for c in content.carriers)
    exact = step([_settings(sources, content, FINE, frictional=frictional)], few)
    off = _difference(step([], few), exact)
    if off < CONVERGED:
        return None
    candidates: list[float | None] = [None] if frictional else []  # the friction solver alone first
    candidates += [h for h in LADDER if h <= own * 1.0000001] or [FINE]
    for timestep in candidates[:-1]:
        left = _difference(step([_settings(sources, content, timestep, frictional=frictional)], few), exact)
        if left < CONVERGED:
            return _settings(sources, content, timestep, frictional=frictional, off=off)
    return _settings(sources, content, candidates[-1], frictional=frictional, off=off)


def _difference(some: list[dict[str, Real]], others: list[dict[str, Real]]) -> float:
    """Largest RMS difference of a channel over its RMS about its mean [-]."""
    worst = 0.0
    for a, b in zip(some, others, strict=True):
        for column, y in b.items():
            size = float(np.sqrt(np.mean((y - y.mean()) ** 2)))
            if size > 0.0:
                gap = float(np.sqrt(np.mean((a[column] - y) ** 2)))
                worst = max(worst, gap / size if np.isfinite(gap) else np.inf)
    return worst


def _settings(
    sources: Sources, content: Content, timestep: float | None, *, frictional: bool, off: float = 0.0
) -> Change:
    """RK4 at ``timestep`` [s] (``None``: the model's own integrator and step), and dry friction that holds when stuck."""
    own = content.system.model.opt
    name = str(mujoco.mjtIntegrator(int(own.integrator)).name).removeprefix("mjINT_")

    def edit(draft: Draft) -> None:
        if timestep is not None:
            _put_option(draft, timestep, float(own.timestep), name)
        for carrier in content.carriers:
            if frictional and carrier.frictionloss > 0.0:
                element = sources.element(carrier.kind, carrier.name)
                draft.put(element, "solreffriction", f"{STUCK[0]:g} {STUCK[1]:g}")
                draft.put(element, "solimpfriction", " ".join(f"{v:g}" for v in EXACT))

    cure = "a friction solver that lets nothing creep" if timestep is None else f"RK4 at {timestep:g} s"
    reason = (
        f"with {name} at {own.timestep:g} s the model is {100.0 * off:.2g} % off itself at {FINE:g} s; {cure} is within "
        f"{100.0 * CONVERGED:g} %"
    )
    return Change("numerics", "numerics", reason, edit)


def _put_option(draft: Draft, timestep: float, own: float, integrator: str) -> None:
    written = [t for t in draft.sources.select("option")]
    if not written:
        draft.add(draft.sources.tags[0], f'<option timestep="{timestep:g}" integrator="RK4"/>', element="option")
        return
    for attribute, value, old in (("timestep", f"{timestep:g}", f"{own:g}"), ("integrator", "RK4", integrator)):
        tag = next((t for t in reversed(written) if attribute in t.attributes), written[-1])
        draft.put(tag, attribute, value, old=old)
