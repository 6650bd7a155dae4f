"""What was recorded beside what the two models predict from the inputs alone, channel by channel."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.errors import Free, compared, floor_of, relative_error, rms
from jointscope.diagnosis.noise import ANGULAR, BlockNoise, block_key
from jointscope.diagnosis.split import level

if TYPE_CHECKING:
    from jointscope.diagnosis.effects import ActiveEffect
    from jointscope.diagnosis.noise import NoiseModel
    from jointscope.diagnosis.prepare import Problem

Vector = NDArray[np.float64]
UNITS = {
    "linear-acceleration": "m/s²", "acceleration": "m/s²", "angular-acceleration": "rad/s²", "angle": "rad",
    "angular-velocity": "rad/s", "position": "m", "velocity": "m/s", "force": "N", "torque": "N m",
}  # fmt: skip


@dataclass(frozen=True, eq=False)
class Models:
    """The two models that are compared, and what they were fitted to.

    Attributes:
        problem: The campaign as prepared.
        base_theta: Base parameters of the base model alone, shape (n_theta,).
        theta: Base parameters beside the effects, shape (n_theta,).
        effects: Empty where nothing was found; then both models are the base.
        noise: Of the judgement.
        held_out: Positions in ``problem.runs`` that no fit has seen.
    """

    problem: Problem
    base_theta: Vector
    theta: Vector
    effects: tuple[ActiveEffect, ...]
    noise: NoiseModel
    held_out: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Trace:
    """One recorded output channel of one run, over its scored samples.

    Attributes:
        run: Its id.
        position: In ``problem.runs``.
        experiment: Kind of experiment.
        quantity, location: Of the channel.
        level: RMS of what drives the run [N m, N, rad/s or m/s].
        held_out: Whether no fit has seen the run.
        rate: Sampling rate [Hz].
        time: [s], shape (n,).
        recorded, base, corrected: In SI, shape (n,); ``corrected`` is ``base`` where no effect was found.
        base_error, corrected_error: As the contract defines them [-].
        floor: The same of a perfect model [-]; ``nan`` where it is not known.
        floor_density: Amplitude spectral density of the channel's noise over frequency [unit/sqrt(Hz)].
    """

    run: str
    position: int
    experiment: str
    quantity: str
    location: str
    level: float
    held_out: bool
    rate: float
    time: Vector
    recorded: Vector
    base: Vector
    corrected: Vector
    base_error: float
    corrected_error: float
    floor: float
    floor_density: Callable[[Vector], Vector] | None = None

    @property
    def channel(self) -> str:
        """``quantity@location``, as in diagnosis.json."""
        return f"{self.quantity}@{self.location}"


def gather(models: Models, free: Free) -> tuple[Trace, ...]:
    """Every recorded output channel of every run, both models replayed from the inputs alone."""
    found: list[Trace] = []
    problem = models.problem
    for position, run in enumerate(problem.runs):
        base = free(run, models.base_theta, (), problem)
        corrected = free(run, models.theta, models.effects, problem) if models.effects else base
        for output, before, after in zip(run.declared, base, corrected, strict=True):
            stream = run.run.streams[output.channel[0]]
            samples = stream.channels[output.channel[1]].samples
            if samples is None:
                continue
            recorded = np.asarray(samples, dtype=np.float64)
            scored = np.isfinite(recorded)
            if output.mask.size == recorded.size and np.any(output.mask):
                scored &= output.mask
            if np.count_nonzero(scored) < 16:
                continue
            recorded = recorded[scored]
            before, after = (
                np.asarray(output.polarity * (np.asarray(p) + output.offset))[scored] for p in (before, after)
            )
            size = rms(recorded - recorded[0]) if output.quantity in ANGULAR else rms(recorded)
            block = models.noise.blocks.get(block_key(run, compared(run, output)))
            found.append(
                Trace(
                    run=run.run.id,
                    position=position,
                    experiment=run.run.experiment,
                    quantity=output.quantity,
                    location=output.location,
                    level=level(run),
                    held_out=position in models.held_out,
                    rate=output.rate,
                    time=np.asarray(stream.times)[scored],
                    recorded=recorded,
                    base=before,
                    corrected=after,
                    base_error=relative_error(output.quantity, recorded, before),
                    corrected_error=relative_error(output.quantity, recorded, after),
                    floor=floor_of(run, output, models.noise, after) / size if size > 0.0 else float("nan"),
                    floor_density=None if block is None else noise_density(block, compared(run, output).rate),
                )
            )
    return tuple(found)


def noise_density(block: BlockNoise, rate: float) -> Callable[[Vector], Vector]:
    """Amplitude spectral density of an autoregressive noise: sqrt(2/rate) sigma / |A(e^jw)| [unit/sqrt(Hz)]."""

    def at(frequency: Vector) -> Vector:
        turn = np.exp(-2j * np.pi * np.outer(frequency / rate, np.arange(block.ar.size)))
        return np.asarray(np.sqrt(2.0 / rate) * block.sigma / np.abs(turn @ block.ar))

    return at


def telling(traces: Sequence[Trace]) -> dict[str, Trace]:
    """Per experiment the trace that shows most: largest gain among held-out runs, among all where none was kept back.

    Without a gain (no effect was found) it is the one that the base model meets worst, relative to its noise floor.
    """
    best: dict[str, Trace] = {}
    for experiment in sorted({t.experiment for t in traces}):
        own = [t for t in traces if t.experiment == experiment and np.isfinite(t.base_error)]
        kept = [t for t in own if t.held_out and np.isfinite(t.corrected_error)]
        pool = kept or own
        if pool:
            best[experiment] = max(pool, key=_shows)
    return best


def _shows(trace: Trace) -> tuple[float, float]:
    floor = trace.floor if np.isfinite(trace.floor) and trace.floor > 0.0 else 1.0
    return (round(trace.base_error - trace.corrected_error, 12), trace.base_error / floor)
