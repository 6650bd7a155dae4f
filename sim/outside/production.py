"""A whole draw of outside campaigns: resumable, sealed at the end, in the layout that ``prove`` reads.

There is no distance from the nearest rival here: ``z_d`` of the truth is z itself and ``nearest`` is empty, so a
proof's bands say how visible a case is, not how distinct from its look-alikes. z is an rms ratio, not a norm.
"""

from __future__ import annotations

import json
import multiprocessing
import os
import shutil
from collections.abc import Iterator, Mapping
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

from jointscope.atomic import replaced_file, write_text
from jointscope.errors import InputError, JointscopeError
from jointscope.progress import track
from jointscope.sim.concealed.seal import folder_digest, seal, unseal, write_seal
from jointscope.sim.outside.case import Case, Concealed, draw_case
from jointscope.sim.outside.intent import OrderKind, intent_of
from jointscope.sim.outside.paperwork import paper_of, write_case
from jointscope.sim.outside.sensing import Record

ORDER: Final = "draw.json"
PARTS: Final = ".parts"
ENGINE: Final = "outside"
REDRAWN: Final = 4  # times that a case which flies apart is drawn anew


@dataclass(frozen=True)
class Order:
    """What is asked for: one draw; ``draw`` only says what it is for, the laws are the same in all."""

    seed: int
    cases: int
    kind: OrderKind = "mixed"
    draw: str = "test"

    @property
    def as_json(self) -> dict[str, object]:
        """As it stands in the folder and in the truth."""
        return {**asdict(self), "engine": ENGINE}


def case_name(order: Order, index: int) -> str:
    """A name without meaning."""
    words = np.random.SeedSequence([order.seed, index, 7]).generate_state(1, np.uint64)
    return f"{int(words[0]) >> 24:010x}"


def produce(order: Order, folder: Path, workers: int = 1) -> str:
    """Write ``order``'s cases into ``folder`` and seal their truth; finished cases are kept when it is run again.

    Returns:
        SHA-256 of the seal.

    Raises:
        InputError: The folder holds another draw.
        JointscopeError: Cases failed; the others are kept.
    """
    folder.mkdir(parents=True, exist_ok=True)
    _claim(order, folder)
    (folder / PARTS).mkdir(exist_ok=True)
    todo = [i for i in range(order.cases) if not _finished(folder, case_name(order, i))]
    failed = [said for said in track(_work(order, folder, todo, workers), "concealing", len(todo)) if said]
    if failed:
        raise JointscopeError(f"{len(failed)} of {order.cases} cases failed, the others are kept: {failed[0]}")
    cases = {}
    for index in range(order.cases):
        part = folder / PARTS / f"{case_name(order, index)}.sealed"
        cases[case_name(order, index)] = unseal(part.read_bytes(), part)
    truth = {"format": "jointscope-truth/1", "order": order.as_json, "cases": dict(sorted(cases.items()))}
    return write_seal(folder, truth)


def _claim(order: Order, folder: Path) -> None:
    """The number of cases may grow; nothing else may change."""
    file = folder / ORDER
    if file.is_file():
        held = json.loads(file.read_text(encoding="utf-8"))
        for key, value in order.as_json.items():
            if key != "cases" and held.get(key) != value:
                raise InputError(file, key, f"this folder holds another draw than {value!r}", value=held.get(key),
                                 fix="choose another --out")  # fmt: skip
    elif any(folder.iterdir()):
        raise InputError(folder, None, "isn't empty and holds no draw", fix="choose another --out")
    write_text(file, json.dumps(order.as_json) + "\n")


def _finished(folder: Path, name: str) -> bool:
    return (folder / PARTS / f"{name}.sealed").is_file() and (folder / name / "campaign.toml").is_file()


def _work(order: Order, folder: Path, todo: list[int], workers: int) -> Iterator[str]:
    tasks = [(order, index, str(folder)) for index in todo]
    if workers <= 1 or len(tasks) <= 1:
        yield from map(_one, tasks)
        return
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(workers, len(tasks)), mp_context=context) as pool:
        yield from pool.map(_one, tasks)


def _one(task: tuple[Order, int, str]) -> str:
    """Make one case; what went wrong, or nothing."""
    order, index, folder = task
    name = case_name(order, index)
    directory = Path(folder) / name
    if directory.is_dir():  # written, but its truth was lost with the process
        shutil.rmtree(directory)
    try:
        truth = make_case(order, index, directory)
    except Exception as problem:  # of any kind: the other cases don't depend on it
        return f"case {index} of seed {order.seed} ({ENGINE}): {problem!r}"
    with replaced_file(Path(folder) / PARTS / f"{name}.sealed") as temporary:
        temporary.write_bytes(seal(truth))
    return ""


def make_case(order: Order, index: int, directory: Path) -> dict[str, Any]:
    """Draw case ``index``, write its campaign into ``directory``, return the truth about it."""
    case = _drawn(order, index)
    campaign, file_format = paper_of(case, np.random.default_rng(np.random.SeedSequence([order.seed, index, 13])))
    write_case(campaign, directory, file_format)
    return _truth(order, index, case, directory, [run.id for run in campaign.runs])


def _drawn(order: Order, index: int) -> Case:
    intent = intent_of(order.seed, order.kind, index)
    for again in range(REDRAWN):
        try:
            return draw_case(intent, np.random.SeedSequence([order.seed, index, 17, again]))
        except FloatingPointError:
            if again == REDRAWN - 1:
                raise
    raise AssertionError("unreachable")


def _truth(order: Order, index: int, case: Case, directory: Path, ids: list[str]) -> dict[str, Any]:
    rig, seen = case.setup.rig, case.visibility
    strength = None
    if seen is not None:
        strength = {"z": seen.z, "z_d": seen.z, "nearest": "", "materiality": seen.share}
    return {
        "case": directory.name,
        "index": index,
        "kind": case.intent.kind,
        "draw": order.draw,
        "engine": ENGINE,
        "experiments": case.setup.experiments,
        "hard": case.intent.hard,
        "motion": "translational" if rig.slide else "rotational",
        "channels": sorted({name for record in case.records for name in record}),
        "effects": [_effect(case, effect) for effect in case.effects],
        "strength": strength,
        "wanted": case.intent.band if case.effects else None,
        "parameters": {
            "stiffness": rig.stiffness, "inertia": rig.load_inertia, "damping": rig.damping,
            "motor_damping": rig.motor_damping, "load_damping": rig.load_damping,
        },
        "noise": asdict(case.noise),
        "floor": {
            run: _floor(clean, record) for run, clean, record in zip(ids, case.clean, case.records, strict=True)
        },
        "digest": folder_digest(directory),
    }  # fmt: skip


def _effect(case: Case, effect: Concealed) -> dict[str, Any]:
    name, location = effect.label.split("@")
    return {
        "effect": name, "location": location, "law": effect.law.name, "departs": effect.law.departs,
        "listed": case.intent.kind != "unlisted", "main": effect.law.main,
        "parameters": dict(effect.sized.build.parameters), "z": effect.sized.visibility.z, "size": effect.sized.size,
    }  # fmt: skip


def _floor(clean: Mapping[str, Any], record: Record) -> dict[str, float]:
    """Per output channel, the error of a perfect model over the recording (rms; angles less their first value)."""
    found: dict[str, float] = {}
    for name in ("acceleration", "arm", "motor"):
        if name in record:
            whole = record[name] - (record[name][0] if name != "acceleration" else 0.0)
            size = float(np.sqrt(np.mean(whole**2)))
            found[name] = float(np.sqrt(np.mean((record[name] - clean[name]) ** 2))) / max(size, 1e-300)
    return found
