"""Cases of a six-axis arm: what is concealed at which joint, how strong, written and sealed like a draw of one joint.

Strength is chosen on the arm's own motion without the effect: play against the wind-up it takes part in, friction
against the torque that passes. A case is a campaign with the lab's MJCF inside; its truth names the joint.
"""

from __future__ import annotations

import json
import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from jointscope.atomic import write_text
from jointscope.models.arm.build import build_arm
from jointscope.progress import track
from jointscope.recordings.campaign import Campaign, Nameplate, Run
from jointscope.sim.arm.plan import JOINT
from jointscope.sim.concealed.arm_bench import NEIGHBOURS, ArmBench, draw_arm_bench
from jointscope.sim.concealed.arm_laws import ArmEffect
from jointscope.sim.concealed.arm_rehearsal import ArmTake, recorded_run, rehearse_arm
from jointscope.sim.concealed.paperwork import MOMENT, write_case
from jointscope.sim.concealed.seal import folder_digest, seal, unseal, write_seal

Real = NDArray[np.float64]
ArmKind = Literal["mixed", "nulls", "singles"]
NULLS = 0.34  # of a mixed draw
MODEL = "arm.xml"
SEEN = 0.03  # relative change of what is read that an effect aims at, at least
WISHES = (
    ("neighbour-flexibility", 0.22), ("backlash", 0.30), ("coulomb-friction", 0.22), ("stribeck-friction", 0.08),
    ("torque-gain", 0.06), ("stiffness-nonlinearity", 0.12),
)  # fmt: skip


@dataclass(frozen=True)
class ArmOrder:
    """What is asked for: one draw of arms."""

    seed: int
    cases: int
    kind: ArmKind


def produce_arms(order: ArmOrder, folder: Path) -> str:
    """Write ``order``'s cases into ``folder`` and seal their truth; finished cases are kept when it is run again.

    Returns:
        SHA-256 of the seal.
    """
    parts = folder / ".parts"
    parts.mkdir(parents=True, exist_ok=True)
    asked = {**asdict(order), "rig": "six-axis", "draw": "test"}
    write_text(folder / "draw.json", json.dumps(asked) + "\n")
    cases = {}
    for index in track(range(order.cases), "concealing", order.cases):
        name = f"arm-{index:04d}"
        part = parts / f"{name}.sealed"
        if not part.is_file():
            part.write_bytes(seal(make_arm_case(order, index, folder / name)))
        cases[name] = unseal(part.read_bytes(), part)
    return write_seal(folder, {"format": "jointscope-truth/1", "order": asked, "cases": cases})


def make_arm_case(order: ArmOrder, index: int, directory: Path) -> dict[str, Any]:
    """Write one case into a new ``directory``; its truth."""
    streams = np.random.SeedSequence([order.seed, index, 0xA23]).spawn(4)
    what, bench_rng, run_rng, noise_rng = (np.random.default_rng(s) for s in streams)
    null = order.kind == "nulls" or (order.kind == "mixed" and what.random() < NULLS)
    wish = None if null else str(what.choice([w for w, _ in WISHES], p=np.array([p for _, p in WISHES])))
    hidden = str(what.choice(NEIGHBOURS)) if wish == "neighbour-flexibility" else None
    bench = draw_arm_bench(bench_rng, hidden)
    effects: tuple[ArmEffect, ...] = ()
    share = 0.0
    if wish is not None:
        effects, share = _chosen(wish, bench, what)
    takes = rehearse_arm(bench, effects, run_rng)
    ids = noise_rng.permutation(900)[: len(takes)] + 100
    order_of_runs = noise_rng.permutation(len(takes))
    runs = tuple(recorded_run(takes[i], bench, effects, f"r{ids[i]}", noise_rng) for i in order_of_runs)
    write_case(_campaign(bench, runs), directory)
    lab = directory / MODEL
    lab.write_text(build_arm(bench.lab).xml, encoding="utf-8")
    for path in (lab, directory):
        os.utime(path, (MOMENT, MOMENT))
    hidden_truth = () if hidden is None else (_hidden(bench, hidden),)
    return {
        "case": directory.name,
        "kind": "null" if null else "single",
        "experiments": "HSM",
        "effects": [
            {**asdict(e), "values": dict(e.values), "listed": True, "departs": False}
            for e in (*effects, *hidden_truth)
        ],
        "strength": None if null else {"z": 1e3 * share, "z_d": 1e3 * share, "share": share, "nearest": ""},
        "floor": {},
        "joints": {row.name: {"stiffness": row.stiffness, "damping": row.damping} for row in bench.truth.joints},
        "digest": folder_digest(directory),
    }


def _campaign(bench: ArmBench, runs: tuple[Run, ...]) -> Campaign:
    lab = build_arm(bench.lab)
    row = bench.lab.joint(JOINT)
    plate = Nameplate(
        topology="arm", motion="rotational", plane="vertical", reduction_ratio=row.reduction_ratio,
        motor_inertia=row.motor_inertia, reducer_inertia=row.reducer_inertia, motor_damping=row.motor_damping,
        efficiency=1.0, stiffness_reference=row.stiffness,
    )  # fmt: skip
    names = tuple(j for j in bench.posture if lab.spec.joint(j) is not None)
    return Campaign(path=Path(), rig=plate, runs=runs, title="arm recordings", mjcf=MODEL, joints=names)


def _hidden(bench: ArmBench, joint: str) -> ArmEffect:
    """The joint that gives unknown to the lab, by its frequency with every other joint rigid [Hz]."""
    from jointscope.models.arm.reference import arm_reference

    arm = build_arm(bench.truth)
    inertia = float(arm_reference(arm).locked_inertia(bench.posture)[arm.index(joint)])
    K = bench.truth.joint(joint).stiffness
    return ArmEffect(
        effect="neighbour-flexibility", location="neighbour", joint=joint, law="reducer",
        values={"frequency": float(np.sqrt(K / inertia) / (2.0 * np.pi)), "stiffness": K},
    )  # fmt: skip


# --- how strong ------------------------------------------------------------------------------------------------------


def _chosen(wish: str, bench: ArmBench, rng: np.random.Generator) -> tuple[tuple[ArmEffect, ...], float]:
    """An effect of the wished kind, scaled until it changes what is read by at least ``SEEN``; with that share."""
    if wish == "neighbour-flexibility":
        return (), 1.0
    bare = rehearse_arm(bench, (), np.random.default_rng(0), few=True)
    giving = [row.name for row in bench.truth.joints]
    candidates = [JOINT] if wish == "torque-gain" else giving
    if wish in ("coulomb-friction", "stribeck-friction") and rng.random() < 0.5:
        candidates = [JOINT]  # the one that moves shows it best
    joint = str(rng.choice(candidates))
    if wish == "torque-gain":
        gain = float(1.0 + rng.choice([-1.0, 1.0]) * rng.uniform(0.04, 0.15))
        values = {"gain": gain}
        return (ArmEffect(effect=wish, location="motor", joint=joint, law="factor", values=values),), abs(
            gain - 1.0
        )
    if wish == "backlash":  # where gravity presses one flank least, for a flank that is never left shows no play
        joint = min(giving, key=lambda j: _preload(bare, j) / _swing(bare, j) * float(rng.uniform(0.8, 1.25)))
    target = SEEN * float(np.exp(rng.uniform(0.0, np.log(8.0))))
    level, share, effect = float(rng.uniform(0.15, 0.4)), 0.0, None
    for _ in range(4):
        effect = _effect(wish, joint, level, bare, bench, np.random.default_rng(rng.integers(1 << 31)))
        share = _share(bare, rehearse_arm(bench, (effect,), np.random.default_rng(0), few=True))
        if 0.6 * target < share < 1.8 * target:
            break
        level *= float(np.clip((target / max(share, 1e-4)) ** 0.8, 0.2, 4.0))
        level = min(level, 3.0)
    assert effect is not None
    return (effect,), share


def _effect(
    wish: str, joint: str, level: float, bare: list[ArmTake], bench: ArmBench, rng: np.random.Generator
) -> ArmEffect:
    if wish == "backlash":
        return ArmEffect(effect=wish, location="transmission", joint=joint, law="dead-band",
                         values={"gap": level * 2.0 * _swing(bare, joint) / _stiffness(bench, joint)})  # fmt: skip
    if wish == "stiffness-nonlinearity":
        wind_up = _swing(bare, joint) / _stiffness(bench, joint)
        return ArmEffect(effect=wish, location="transmission", joint=joint, law="polynomial",
                         values={"cubic": level * _stiffness(bench, joint) / wind_up**2})  # fmt: skip
    torque = level * _rotor_torque(bare, joint)
    if wish == "coulomb-friction":
        return ArmEffect(
            effect=wish, location="motor", joint=joint, law="friction-constraint", values={"torque": torque}
        )
    speed = max(float(np.max(np.abs(t.trajectory.rotor_speed(joint)))) for t in bare if t.force is None)
    values = {"torque": torque, "breakaway": 1.8 * torque, "stribeck_velocity": 0.1 * speed}
    return ArmEffect(effect=wish, location="motor", joint=joint, law="falling", values=values)


def _stiffness(bench: ArmBench, joint: str) -> float:
    return bench.truth.joint(joint).stiffness


def _reducer_torque(take: ArmTake, joint: str) -> Real:
    held = take.trajectory.held
    k = held.arm.index(joint)
    address = held.model.jnt_qposadr[held.model.dof_jntid[held.reducer[k]]]
    K = float(
        np.ravel(held.arm.spec.compile().jnt_stiffness[held.arm.spec.compile().joint(held.arm.reducers[k]).id])[0]
    )
    return np.asarray(K * take.trajectory.position[:, address])


def _swing(bare: list[ArmTake], joint: str) -> float:
    """Peak dynamic torque of a reducer over hits and sweeps [N m]."""
    small = [_reducer_torque(t, joint) for t in bare if t.kind != "speed-motion"]
    return max(max(float(np.max(np.abs(x - x[0]))) for x in small), 1e-6)


def _preload(bare: list[ArmTake], joint: str) -> float:
    """Torque that gravity puts on a reducer at rest [N m]."""
    held = bare[0].trajectory.held
    from jointscope.models.arm.reference import arm_reference

    return abs(float(arm_reference(held.arm).gravity(bare[0].posture)[held.arm.index(joint)]))


def _rotor_torque(bare: list[ArmTake], joint: str) -> float:
    """Peak dynamic torque that reaches a rotor in the sweeps [N m]."""
    found = [_reducer_torque(t, joint) for t in bare if t.kind == "torque-sweep"]
    return max(float(np.max(np.abs(x - x[0]))) for x in found)


def _share(before: list[ArmTake], after: list[ArmTake]) -> float:
    """Largest relative change of an accelerometer's reading or of the motor's torque over the takes [-]."""
    found = 0.0
    for a, b in zip(before, after, strict=True):
        pairs: list[tuple[Real, Real]] = [
            (a.trajectory.accelerometer(name), b.trajectory.accelerometer(name)) for name in ("acc_1", "acc_2")
        ]
        if a.torque is not None and b.torque is not None:
            pairs.append((a.torque, b.torque))
        for x, y in pairs:
            found = max(found, float(np.sqrt(np.mean(np.square(y - x)))) / float(np.std(x)))
    return found
