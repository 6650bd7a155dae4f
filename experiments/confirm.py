"""Held-out runs stepped in MuJoCo with and without the diagnosed effect: does it gain there what the diagnosis says?

A diagnosis judges its effects by a reduced model of its own. Here the same runs go through ``base.xml`` and
``augmented.xml`` with ``effects.json``, an engine and laws that share no code with that model; the error that the effect
takes away must be the same within 10 %. Nothing of the diagnosis is imported: its folder is all that is read.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.atomic import write_text
from jointscope.errors import InputError, RefusedError
from jointscope.experiments.own_model.scoring import first_angle
from jointscope.models.effects import AUGMENTED, BASE, DESCRIPTION, read_description
from jointscope.progress import track
from jointscope.recordings.campaign import Campaign, Channel, Run, Signal
from jointscope.recordings.drift import FOLLOWING, drift_corner, drift_free
from jointscope.recordings.reader import read_campaign
from jointscope.recordings.zeroed import zeroed
from jointscope.sim.effects import loop_of, physics_of
from jointscope.sim.replay import replay_run

Real = NDArray[np.float64]

FORMAT = "jointscope-confirm/1"
LIMITS = (0.9, 1.1)  # of the reduced model's gain
TIMESTEP = 1e-4  # s; 0.05 % and 0.05 degree below ...
SLOWER = 100.0  # Hz; a faster mode takes a step that is finer in proportion
DIVERGED = 100.0  # an error counts no more than this
_TAIL = 8  # samples at the end, where a recorder's filter looks past the run
_SETTLING = 0.5  # s at the start of a run that began in motion
_ANGLES = ("angle", "position")


@dataclass(frozen=True, eq=False)
class ChannelCheck:
    """One output channel of one held-out run.

    Attributes:
        run: Its id.
        experiment: Its experiment.
        channel: ``quantity@location``.
        base_error: RMS(recorded - base model) over RMS(recorded), over RMS(recorded - first) for angles [-].
        augmented_error: The same with the effects [-].
        times: [s], shape (n,).
        recorded, base, augmented: Samples in SI, shape (n,).
    """

    run: str
    experiment: str
    channel: str
    base_error: float
    augmented_error: float
    times: Real
    recorded: Real
    base: Real
    augmented: Real


@dataclass(frozen=True, eq=False)
class Confirmation:
    """What MuJoCo says of a diagnosis.

    Attributes:
        effects: ``name@location`` of what was put in.
        checks: Every channel.
        base_error, augmented_error: Means over the held-out runs' channels [-].
        reduced_base_error, reduced_augmented_error: As the diagnosis has them [-].
        timestep: h [s].
    """

    effects: tuple[str, ...]
    checks: tuple[ChannelCheck, ...]
    base_error: float
    augmented_error: float
    reduced_base_error: float
    reduced_augmented_error: float
    timestep: float

    @property
    def gain(self) -> float:
        """Base minus augmented error in MuJoCo [-]."""
        return self.base_error - self.augmented_error

    @property
    def reduced_gain(self) -> float:
        """The same of the reduced model [-]."""
        return self.reduced_base_error - self.reduced_augmented_error

    @property
    def ratio(self) -> float:
        """MuJoCo's gain over the reduced model's [-]; ``nan`` where that one gains nothing."""
        return self.gain / self.reduced_gain if self.reduced_gain > 0.0 else math.nan

    @property
    def confirmed(self) -> bool:
        """Whether the ratio lies within ``LIMITS``."""
        return LIMITS[0] <= self.ratio <= LIMITS[1]


def confirm(directory: Path, *, campaign: Path | None = None, timestep: float | None = None) -> Confirmation:
    """Replay the held-out runs of a diagnosis in MuJoCo.

    Args:
        directory: Written by ``jointscope diagnose``.
        campaign: The recordings; where the diagnosis says by default.
        timestep: h [s]; as fine as the named effects ask by default (:func:`step_for`).

    Raises:
        InputError: A file is missing or of another kind, or a held-out run is not in the campaign.
        RefusedError: No effect was named, or no run was held out.
    """
    answer = _answer(directory / "diagnosis.json")
    description = read_description(directory / DESCRIPTION)
    held = answer["held_out"]
    names = tuple(f"{entry['effect']}@{entry['location']}" for entry in answer["effects"])
    if not names:
        raise RefusedError(
            f"{directory / 'diagnosis.json'}: verdict = {answer['verdict']!r}: no effect was named, so there is none to confirm"
        )
    if held is None or held.get("augmented_error") is None or held.get("base_error") is None:
        raise RefusedError(
            f"{directory / 'diagnosis.json'}: held_out: no run was kept back, so nothing can be confirmed on new data"
        )
    h = step_for(answer["effects"]) if timestep is None else timestep
    recordings, _ = zeroed(read_campaign(campaign or _campaign(directory, answer)))
    checks = tuple(_checks(directory, description, recordings, _held_out(recordings, held["runs"]), h))
    return Confirmation(
        effects=names,
        checks=checks,
        base_error=_mean([check.base_error for check in checks]),
        augmented_error=_mean([check.augmented_error for check in checks]),
        reduced_base_error=float(held["base_error"]),
        reduced_augmented_error=float(held["augmented_error"]),
        timestep=h,
    )


def step_for(effects: Sequence[Mapping[str, Any]]) -> float:
    """Step [s] at which the fastest mode among ``effects`` is as exact as the joint: a ring of 460 Hz slips out of step else."""
    rates = [
        float(value["value"])
        for entry in effects
        if entry["location"] != "acquisition"
        for value in entry.get("parameters", {}).values()
        if value["unit"] == "Hz"
    ]
    return TIMESTEP * min(1.0, SLOWER / max([SLOWER, *rates]))


def _answer(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            path, None, "no such file", fix="write one with: jointscope diagnose CAMPAIGN --out DIR"
        ) from None
    except ValueError as problem:
        raise InputError(path, None, f"not JSON: {problem}") from None
    if not isinstance(content, dict) or content.get("format") != "jointscope-diagnosis/1":
        raise InputError(path, "format", "must be 'jointscope-diagnosis/1'")
    return content


def _campaign(directory: Path, answer: Mapping[str, Any]) -> Path:
    found = answer.get("campaign")
    if not found:
        raise InputError(
            directory / "diagnosis.json", "campaign", "is missing", fix="say where it is: --campaign CAMPAIGN"
        )
    path = directory / str(found)
    if not path.exists():
        raise InputError(
            directory / "diagnosis.json",
            "campaign",
            "is not there",
            value=found,
            fix="say where it is: --campaign CAMPAIGN",
        )
    return path.resolve()


def _held_out(recordings: Campaign, wanted: list[str]) -> tuple[Run, ...]:
    by_id = {run.id: run for run in recordings.runs}
    for name in wanted:
        if name not in by_id:
            raise InputError(recordings.path, "runs", "the held-out run is not in this campaign", value=name)
    return tuple(by_id[name] for name in wanted)


def _checks(
    directory: Path, description: Mapping[str, Any], recordings: Campaign, runs: tuple[Run, ...], timestep: float
) -> Iterator[ChannelCheck]:
    """Both models on every run."""
    sides = []
    for file, content in ((BASE, description["base"]), (AUGMENTED, description)):
        physics, loop = physics_of(content), loop_of(content["drive"])
        sides.append((directory / file, physics, loop))
    replayed = [
        tuple(
            replay_run(recordings, run, path, physics(run), loop=loop, timestep=timestep)
            for path, physics, loop in sides
        )
        for run in track(runs, "stepping held-out runs in MuJoCo", len(runs))
    ]
    signs = _polarity(runs, [base for base, _ in replayed])
    for run, models in zip(runs, replayed, strict=True):
        corner = drift_corner(run, recordings.rig)
        base, augmented = models if corner is None else (_drift_free(model, corner) for model in models)
        for recorded, b, a in zip(_outputs(run), _outputs(base), _outputs(augmented), strict=True):
            if recorded.channel.samples is None:
                continue
            yield _check(run, recorded, b, a, signs[_instrument(recorded)])


def _drift_free(run: Run, corner: float) -> Run:
    """The run's predictions as :mod:`jointscope.recordings.drift` says that they can be compared."""

    def cut(channel: Channel, rate: float) -> Channel:
        if channel.role != "output" or channel.quantity not in FOLLOWING or channel.samples is None:
            return channel
        return replace(channel, samples=drift_free(np.real(channel.samples), corner, rate))

    streams = (replace(s, channels=tuple(cut(c, s.sampling_rate) for c in s.channels)) for s in run.streams)
    return replace(run, streams=tuple(streams))


def _outputs(run: Run) -> list[Signal]:
    return [
        signal
        for signal in run.select(role="output", recorded=False)
        if signal.channel.quantity != "frf" and signal.channel.location not in ("base", "neighbour")
    ]


def _instrument(signal: Signal) -> tuple[object, ...]:
    """Outputs that share it are the same instrument at the same place."""
    channel = signal.channel
    return (channel.quantity, channel.location, channel.direction, channel.radius, signal.sampling_rate)


def _polarity(runs: tuple[Run, ...], base: list[Run]) -> dict[tuple[object, ...], float]:
    """-1 for an instrument whose sign is the other way round than the base model's, over all held-out runs."""
    product: dict[tuple[object, ...], float] = {}
    for run, model in zip(runs, base, strict=True):
        for recorded, predicted in zip(_outputs(run), _outputs(model), strict=True):
            key = _instrument(recorded)
            product.setdefault(key, 0.0)
            if recorded.channel.samples is None:
                continue
            x, y = recorded.samples - np.nanmean(recorded.samples), predicted.samples - np.mean(predicted.samples)
            size = float(np.nansum(x * x) * np.sum(y * y)) ** 0.5
            product[key] += float(np.nansum(x * y)) / size if size > 0.0 else 0.0
    return {key: -1.0 if value < 0.0 else 1.0 for key, value in product.items()}


def _check(run: Run, recorded: Signal, base: Signal, augmented: Signal, sign: float) -> ChannelCheck:
    samples, angle = recorded.samples, recorded.channel.quantity in _ANGLES
    scored = np.isfinite(samples)
    if samples.size > 64:
        scored[-_TAIL:] = False
    if run.initial == "estimate":
        scored &= recorded.times >= recorded.times[0] + _SETTLING
    first = first_angle(samples) if angle else 0.0
    sides = [
        sign * (side.samples - side.samples[0]) + first if angle else sign * side.samples
        for side in (base, augmented)
    ]
    kept = samples[scored]
    if angle and run.initial == "estimate":  # no rest at its first sample: a steady state's zero is its mean
        sides = [side + float(np.mean(kept - side[scored])) for side in sides]
    reference = _rms(kept - kept[0] if angle else kept)
    errors = [_rms(kept - side[scored]) / reference if reference > 0.0 else math.nan for side in sides]
    return ChannelCheck(
        run=run.id,
        experiment=run.experiment,
        channel=f"{recorded.channel.quantity}@{recorded.channel.location}",
        base_error=errors[0],
        augmented_error=errors[1],
        times=recorded.times[scored],
        recorded=kept,
        base=sides[0][scored],
        augmented=sides[1][scored],
    )


def _rms(x: Real) -> float:
    return float(np.sqrt(np.mean(np.square(x)))) if x.size else 0.0


def _mean(errors: list[float]) -> float:
    """Over channels that are not silent; a diverged one counts as ``DIVERGED``."""
    counted = [min(e, DIVERGED) if math.isfinite(e) else DIVERGED for e in errors if not math.isnan(e)]
    return float(np.mean(counted)) if counted else math.nan


def confirmation_json(found: Confirmation) -> dict[str, Any]:
    """``confirm.json`` (format ``jointscope-confirm/1``) as plain data; errors relative, see :class:`ChannelCheck`."""
    return {
        "format": FORMAT,
        "confirmed": found.confirmed,
        "effects": list(found.effects),
        "mujoco": {"base_error": found.base_error, "augmented_error": found.augmented_error, "gain": found.gain},
        "reduced_model": {
            "base_error": found.reduced_base_error,
            "augmented_error": found.reduced_augmented_error,
            "gain": found.reduced_gain,
        },
        "gain_ratio": None if math.isnan(found.ratio) else found.ratio,
        "limits": list(LIMITS),
        "timestep_s": found.timestep,
        "channels": [
            {
                key: None if isinstance(value, float) and math.isnan(value) else value
                for key, value in asdict(check).items()
                if isinstance(value, (str, float))
            }
            for check in found.checks
        ],
    }


def write_confirmation(found: Confirmation, directory: Path) -> None:
    """``confirm.json`` and ``confirm.png`` into ``directory``."""
    from jointscope.experiments.figures_confirm import draw_confirmation

    draw_confirmation(found, directory / "confirm.png")
    write_text(directory / "confirm.json", json.dumps(confirmation_json(found), indent=2, allow_nan=False) + "\n")
