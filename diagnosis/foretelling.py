"""What a planned take would record if a hypothesis were true, prepared like a recording.

Braked takes follow from their force alone. Driven ones are closed by a drive of their own (a loose hold under a torque
programme, or a speed loop), its torque and the motor's angle are logged, and every hypothesis is then compared in the
observer's form on that log, as recordings are.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis import kernel
from jointscope.diagnosis.assembly import close_loop, initial_state
from jointscope.diagnosis.channels import recorded
from jointscope.diagnosis.effects import ActiveEffect
from jointscope.diagnosis.menu import HOLD_HZ, Lab, Take, as_run, still
from jointscope.diagnosis.noise import (
    ANGULAR,
    BlockNoise,
    Key,
    NoiseModel,
    block_key,
    dynamic_level,
    model_floor,
)
from jointscope.diagnosis.predict import build, predict_outputs
from jointscope.diagnosis.run_preparation import prepare_run
from jointscope.diagnosis.whiten import RunWhitener, marginalised, output_filter

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import PreparedRun, Problem

Vector = NDArray[np.float64]

UNHEARD = 5.0  # times the floor of its model, the noise of an accelerometer or force that no run has recorded yet
SPEED_LOOP_HZ = 4.0  # bandwidth of a planned motion's drive


@dataclass(frozen=True, eq=False)
class Foretold:
    """A planned take as if recorded.

    Attributes:
        run: Prepared, its data what the hypothesis in force would give.
        outputs: The same as arrays, one per output.
    """

    take: Take
    run: PreparedRun
    outputs: tuple[Vector, ...]


def beyond_the_session(effects: tuple[ActiveEffect, ...], runs: int) -> tuple[ActiveEffect, ...]:
    """Effects that differ from run to run, in a run after the last: no payload, drift as far as it had come."""
    moved = []
    for effect in effects:
        weights = effect.spec.run_weights
        if weights is None:
            moved.append(effect)
            continue
        last = 0.0 if effect.spec.name == "payload" else max(weights, default=0.0) + 1.0
        spec = replace(effect.spec, run_weights=(*weights, *([last] * max(runs - len(weights), 1))))
        moved.append(ActiveEffect(spec, effect.values))
    return tuple(moved)


def foretell(
    take: Take, lab: Lab, theta: Vector, effects: tuple[ActiveEffect, ...], problem: Problem
) -> Foretold | None:
    """The take under a hypothesis; ``None`` where the hypothesis flies apart or nothing would be compared."""
    index = len(problem.runs)
    effects = beyond_the_session(effects, index + 1)
    signals = None if take.brake else _driven(take, lab, theta, effects, problem, index)
    if signals is None and not take.brake:
        return None
    run = prepare_run(as_run(take, lab, signals), problem.rig, index)
    if run is None or not run.outputs:
        return None
    outputs = predict_outputs(run, theta, effects, problem)
    if not all(np.all(np.isfinite(y)) for y in outputs):
        return None
    filled = tuple(replace(o, data=unsettled(y)) for o, y in zip(run.outputs, outputs, strict=True))
    return Foretold(take, replace(run, outputs=filled), outputs)


def unsettled(y: Vector) -> Vector:
    """``y`` with a ripple of a millionth of its peak: no simulated record is quieter than the envelope's round-off."""
    return np.asarray(y + 1e-6 * float(np.max(np.abs(y), initial=0.0)) * np.sin(1.7 * np.arange(y.size)))


def under(
    foretold: Foretold, theta: Vector, effects: tuple[ActiveEffect, ...], problem: Problem
) -> tuple[Vector, ...]:
    """What another hypothesis would say of the same inputs."""
    return predict_outputs(foretold.run, theta, beyond_the_session(effects, foretold.run.index + 1), problem)


def _driven(
    take: Take, lab: Lab, theta: Vector, effects: tuple[ActiveEffect, ...], problem: Problem, index: int
) -> dict[str, Vector] | None:
    """Torque log and motor angle of a take with the motor free, by a drive that closes its loop on the hypothesis."""
    blank = prepare_run(as_run(take, lab), problem.rig, index)
    if blank is None:
        return None
    blank = replace(blank, motor=None, observed=None, mode="closed-loop")
    assembly = build(blank, theta, effects, problem, free=True)
    P, S = assembly.P, assembly.S
    if S[kernel.AT_LOOP] < 0:
        close_loop(assembly)
    total = P[kernel.J_M] + P[kernel.J_L]
    w = 2.0 * math.pi * (HOLD_HZ if take.speed is None else SPEED_LOOP_HZ)
    P[kernel.LOOP_P], P[kernel.LOOP_I] = 1.6 * w * total, w * w * total * (1.0 if take.speed is None else 0.3)
    P[kernel.LOOP_MIX], P[kernel.LOOP_LIMIT] = 1.0, 1e300
    half = blank.t0 + np.arange(2 * blank.steps + 1) / (2.0 * blank.grid_rate)
    factor = assembly.base("efficiency") * assembly.chain.torque_gain
    programme = np.ascontiguousarray(factor * take.torque(half), dtype=np.float64)
    command = np.ascontiguousarray((take.speed or still)(half), dtype=np.float64)
    x = initial_state(assembly, 0.0)
    out = np.empty((blank.steps + 1, kernel.N_OUT))
    zeros = np.zeros(half.size)
    kernel.simulate(x, P, S, zeros, blank.load_half, programme, command, blank.t0, 1.0 / blank.grid_rate, out)
    if not np.all(np.isfinite(out)):
        return None
    log_rate = max(lab.daq_rate, lab.log_rate) if take.one_device else lab.log_rate
    stamps = np.arange(int(take.duration * log_rate)) / log_rate
    torque = recorded(out[:, kernel.X_TAU] / (factor * lab.ratio), blank.grid_rate, blank.t0, stamps, log_rate)
    motor = recorded(out[:, kernel.X_QS] * lab.ratio, blank.grid_rate, blank.t0, stamps, log_rate)
    return {"torque": torque, "motor": motor}


def planned_noise(known: NoiseModel, runs: Sequence[PreparedRun]) -> NoiseModel:
    """The campaign's noise carried over to planned runs: a channel's own from any experiment, else the instrument floor."""
    by_channel: dict[tuple[object, ...], BlockNoise] = {}
    for key, block in known.blocks.items():
        by_channel.setdefault((key[2], key[3], key[4]), block)
    blocks: dict[Key, BlockNoise] = {}
    for run in runs:
        for output in run.outputs:
            key = block_key(run, output)
            held = known.blocks.get(key) or by_channel.get((output.quantity, output.location, output.direction))
            if held is None:
                share = model_floor(output) * (1.0 if output.quantity in ANGULAR else UNHEARD)
                sigma = max(share * dynamic_level(output), 1e-12)
                held = BlockNoise(np.array([1.0]), sigma, sigma, 0.0)
            blocks[key] = held
    return NoiseModel(blocks, known.gain, known.timing)


def planned_whitener(run: PreparedRun, noise: NoiseModel, predicted: Sequence[Vector]) -> RunWhitener:
    """Sigma^-1/2 of a planned run: noise as carried over, what scatters marginalised."""
    filters = tuple(output_filter(o, noise.blocks[block_key(run, o)]) for o in run.outputs)
    bare = RunWhitener(filters, np.zeros((sum(len(f.keep) for f in filters), 0)), np.zeros(0))
    return marginalised(run, noise, predicted, bare)
