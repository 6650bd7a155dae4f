"""Any other simulator's outputs beside the recordings: scored, and read for what the simulator behaves like.

Its code is not known, so its outputs are diagnosed as if a machine had made them. What that finds (effective stiffness,
damping, inertia, effects) stands beside what the recordings show: parameters that differ, effects that only the machine
has, effects that only the simulator has. How much each matters is told by the reduced model that behaves like the
simulator, put right kind by kind; what that model does not reproduce of the simulator's own error stays unsplit.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.predict_file import predict_campaign
from jointscope.errors import CampaignError
from jointscope.experiments.own_model.scoring import (
    ANGULAR,
    ChannelError,
    channel_errors,
    grouped,
    instrument,
    mean_error,
    outputs_of,
    polarity,
)
from jointscope.experiments.own_model.shares import shapley
from jointscope.recordings.bandlimited import resampled
from jointscope.recordings.campaign import Campaign, Channel, Run, Signal
from jointscope.recordings.reader import read_campaign

Real = NDArray[np.float64]

NUISANCE = ("drive_", "torque_")  # of the recording and its drive, never of a simulation
SIGMAS = 3.0
RELATIVE = 0.005  # by which a parameter must differ to be worth a line
_SHARE_OF_ENERGY = (0.05, 0.95)
_INSTRUMENT = 0.8  # of a difference's energy that a gain or a delay must explain to be the channel's own
_SMALL = 0.05  # relative error below which a channel agrees


@dataclass(frozen=True, kw_only=True)
class ChannelLogic:
    """How one instrument's simulated samples relate to its recorded ones, over all runs.

    Attributes:
        channel: ``quantity@location``.
        error: Mean relative error [-].
        gain: Recorded over simulated in least squares [-].
        delay: By which the recorded samples are later [s].
        explained: Share of the difference's energy that gain and delay account for [-].
        band: Frequencies that hold the difference, 5 % to 95 % of its energy [Hz].
    """

    channel: str
    error: float
    gain: float
    delay: float
    explained: float
    band: tuple[float, float]


@dataclass(frozen=True, eq=False)
class Scores:
    """A simulator's outputs against the recordings.

    Attributes:
        runs: Ids on which the error is given.
        held_out: Whether these were held out of the diagnosis.
        errors: Channel by channel on these runs.
        every_run: The same of every run.
        channels: Instrument by instrument.
        missing: Outputs that the simulation lacks, ``run: column``.
    """

    runs: tuple[str, ...]
    held_out: bool
    errors: tuple[ChannelError, ...]
    every_run: tuple[ChannelError, ...]
    channels: tuple[ChannelLogic, ...]
    missing: tuple[str, ...]


def read_simulated(path: Path, campaign: Campaign) -> Campaign:
    """Read a simulator's campaign; every recorded run must be in it.

    Raises:
        CampaignError: It breaks the format, or lacks a run.
    """
    found = read_campaign(path)
    ids = {run.id for run in found.runs}
    for run in campaign.runs:
        if run.id not in ids:
            raise CampaignError(path, "run.id", "the recordings have this run, the simulation does not", value=run.id,
                                fix="give simulated runs the recorded ids")  # fmt: skip
    return found


def score_outputs(campaign: Campaign, simulated: Campaign, answer: Mapping[str, Any]) -> Scores:
    """Errors of every simulated output, and what relates it to the recorded one.

    Raises:
        CampaignError: The simulation holds none of the recorded outputs.
    """
    by_id = {run.id: run for run in simulated.runs}
    every: list[ChannelError] = []
    missing: list[str] = []
    matched: dict[tuple[object, ...], list[tuple[Signal, Real]]] = {}
    for run in campaign.runs:
        made = {}
        for signal in outputs_of(run):
            other = _counterpart(signal, by_id[run.id])
            if other is None:
                missing.append(f"{run.id}: {signal.channel.column}")
                continue
            made[signal.channel.column] = _on_its_times(signal, other)
            matched.setdefault(instrument(signal), []).append((signal, made[signal.channel.column]))
        every += channel_errors(run, made, {})
    if not every:
        raise CampaignError(
            simulated.path, "run.stream.channels", "none of the recorded outputs is among its channels"
        )
    held = set(answer["held_out"]["runs"]) if answer["held_out"] else set()
    judged = [e for e in every if e.run in held]
    return Scores(
        runs=tuple(dict.fromkeys(e.run for e in judged or every)), held_out=bool(judged),
        errors=tuple(judged or every), every_run=tuple(every),
        channels=tuple(_logic(pairs) for pairs in matched.values()), missing=tuple(missing),
    )  # fmt: skip


def _counterpart(signal: Signal, run: Run) -> Signal | None:
    """The simulated channel of the same kind and place; of several the one of the same column."""
    same = [s for s in run.select(signal.channel.quantity, location=signal.channel.location, role="output")
            if s.channel.direction == signal.channel.direction and s.channel.radius == signal.channel.radius]  # fmt: skip
    named = [s for s in same if s.channel.column == signal.channel.column]
    return next(iter(named or same), None)


def _on_its_times(signal: Signal, other: Signal) -> Real:
    if other.sampling_rate == signal.sampling_rate and np.allclose(other.times[:1], signal.times[:1]) and (
        other.samples.size >= signal.samples.size):  # fmt: skip
        return np.asarray(other.samples[: signal.samples.size], dtype=np.float64)
    return resampled(other.samples, other.sampling_rate, other.stream.start, signal.times)


def _logic(pairs: Sequence[tuple[Signal, Real]]) -> ChannelLogic:
    """Gain and delay in least squares, y = g s - g d s', over an instrument's runs."""
    signal = pairs[0][0]
    angular = signal.channel.quantity in ANGULAR
    normal, right, before, after, errors = np.zeros((2, 2)), np.zeros(2), 0.0, 0.0, []
    power: list[tuple[Real, Real]] = []
    rows = []
    for one, made in pairs:
        recorded = np.nan_to_num(one.samples - (one.samples[0] if angular else 0.0))
        model = made - (made[0] if angular else 0.0)
        slope = np.gradient(model) * one.sampling_rate
        columns = np.column_stack([model, -slope])
        normal, right = normal + columns.T @ columns, right + columns.T @ recorded
        rows.append((columns, recorded, model))
        size = float(np.sqrt(np.mean(recorded**2)))
        errors.append(float(np.sqrt(np.mean((recorded - model) ** 2))) / size if size > 0.0 else math.nan)
        spectrum = np.abs(np.fft.rfft(recorded - model)) ** 2 / recorded.size
        power.append(
            (
                np.asarray(np.fft.rfftfreq(recorded.size, 1.0 / one.sampling_rate)),
                np.asarray(spectrum, dtype=np.float64),
            )
        )
    solution = np.linalg.lstsq(normal, right, rcond=None)[0]
    for columns, recorded, model in rows:
        before += float(np.sum((recorded - model) ** 2))
        after += float(np.sum((recorded - columns @ solution) ** 2))
    gain = float(solution[0])
    return ChannelLogic(
        channel=f"{signal.channel.quantity}@{signal.channel.location}", error=float(np.nanmean(errors)), gain=gain,
        delay=float(solution[1]) / gain if gain else math.nan, explained=1.0 - after / before if before > 0.0 else 0.0,
        band=_band(power),
    )  # fmt: skip


def _band(spectra: Sequence[tuple[Real, Real]]) -> tuple[float, float]:
    frequency = np.concatenate([f for f, _ in spectra])
    energy = np.concatenate([p for _, p in spectra])
    order = np.argsort(frequency)
    total = np.cumsum(energy[order])
    if total[-1] <= 0.0:
        return 0.0, 0.0
    low, high = (float(frequency[order][np.searchsorted(total, share * total[-1])]) for share in _SHARE_OF_ENERGY)
    return low, high


def with_noise_of(simulated: Campaign, recorded: Campaign, rng: np.random.Generator) -> Campaign:
    """The simulation with white noise as its recorded counterparts carry, so that both are read with the same care."""
    by_id = {run.id: run for run in recorded.runs}
    runs = []
    for run in simulated.runs:
        original = by_id.get(run.id)
        if original is None:
            continue
        streams = []
        for stream in run.streams:
            channels = []
            for channel in stream.channels:
                counterpart = None
                if channel.role == "output" and channel.samples is not None and channel.quantity != "frf":
                    counterpart = next((s for s in outputs_of(original) if _same(s, channel)), None)
                if counterpart is None:
                    channels.append(channel)
                    continue
                samples = np.asarray(channel.samples, dtype=np.float64)
                samples = samples + rng.normal(0.0, 1.0, samples.shape) * white_noise(counterpart.samples)
                samples.setflags(write=False)
                channels.append(replace(channel, samples=samples))
            streams.append(replace(stream, channels=tuple(channels)))
        runs.append(replace(run, streams=tuple(streams), role=original.role))
    return replace(simulated, runs=tuple(runs), rig=recorded.rig)


def _same(signal: Signal, channel: Channel) -> bool:
    return (signal.channel.quantity, signal.channel.location) == (channel.quantity, channel.location)


def white_noise(samples: Real) -> float:
    """Standard deviation of a recording's white part, from its third differences (they weigh white noise by sqrt 20)."""
    third = np.diff(samples[np.isfinite(samples)], 3)
    return float(1.4826 * np.median(np.abs(third)) / math.sqrt(20.0)) if third.size else 0.0


@dataclass(frozen=True, eq=False)
class Behaviour:
    """What a simulator behaves like, beside the recordings.

    Attributes:
        scores: Its outputs against theirs.
        error: Of its outputs; ``remaining`` of the reduced model that describes the recordings.
        emulated: Of the reduced model that behaves like the simulator.
        shares: Of emulated - remaining, by kind.
        parameters: Rows of ``behaves_like``.
        left_out, contradicted: Effects that only the recordings, only the simulation show.
    """

    scores: Scores
    error: float
    remaining: float
    emulated: float
    shares: dict[str, float]
    parameters: dict[str, dict[str, Any]]
    left_out: tuple[str, ...]
    contradicted: tuple[str, ...]
    not_told: tuple[str, ...]


def compare_behaviour(
    campaign: Campaign,
    scores: Scores,
    recorded: tuple[Mapping[str, Any], Mapping[str, Any]],
    simulated: tuple[Mapping[str, Any], Mapping[str, Any]],
) -> Behaviour:
    """Split a simulator's error by the reduced models of both sides.

    Args:
        campaign: The recordings.
        scores: Of the simulation.
        recorded: Their ``diagnosis.json`` and ``model.json``.
        simulated: The same of the simulation's outputs.
    """
    ours, theirs = recorded[1], simulated[1]
    only_ours = [e for e in ours["effects"] if _name(e) not in {_name(o) for o in theirs["effects"]}]
    only_theirs = [e for e in theirs["effects"] if _name(e) not in {_name(o) for o in ours["effects"]}]
    judged = replace(campaign, runs=tuple(run for run in campaign.runs if run.id in scores.runs))
    signs = _signs(campaign, ours)

    def error(mended: frozenset[str]) -> float:
        base = _base(theirs["base"], ours["base"], right="parameters" in mended)
        common = ours if "parameters" in mended else theirs
        effects = [e for e in common["effects"] if _name(e) not in {_name(o) for o in (*only_ours, *only_theirs)}]
        effects += only_ours if "left_out" in mended else []
        effects += [] if "contradicted" in mended else only_theirs
        made = predict_campaign({**ours, "base": base, "effects": effects}, judged)
        return mean_error(
            [e for run in judged.runs for e in channel_errors(run, _by_column(made.get(run.id, [])), signs)]
        )

    kinds = ["parameters", *(["left_out"] if only_ours else []), *(["contradicted"] if only_theirs else [])]
    known: dict[frozenset[str], float] = {}

    def once(mended: frozenset[str]) -> float:
        if mended not in known:
            known[mended] = error(mended)
        return known[mended]

    split = shapley(kinds, once)
    return Behaviour(
        scores=scores, error=mean_error(scores.errors), remaining=once(frozenset(kinds)), emulated=once(frozenset()),
        shares={k: split.get(k, 0.0) for k in ("parameters", "left_out", "contradicted")},
        parameters=_parameters(recorded[0], simulated[0]),
        left_out=tuple(_name(e) for e in only_ours), contradicted=tuple(_name(e) for e in only_theirs),
        not_told=tuple(_not_told(scores, simulated[0])),
    )  # fmt: skip


def _name(effect: Mapping[str, Any]) -> str:
    return f"{effect['effect']}@{effect['location']}"


def _base(theirs: Mapping[str, float], ours: Mapping[str, float], *, right: bool) -> dict[str, float]:
    return (
        dict(ours)
        if right
        else {k: (ours if k.startswith(NUISANCE) else theirs).get(k, v) for k, v in ours.items()}
    )


def _by_column(pairs: Sequence[tuple[Signal, Real]]) -> dict[str, Real]:
    return {signal.channel.column: np.asarray(values, dtype=np.float64) for signal, values in pairs}


def _signs(campaign: Campaign, model: Mapping[str, Any]) -> dict[tuple[object, ...], float]:
    made = predict_campaign(dict(model), campaign)
    return polarity([(run, _by_column(made.get(run.id, []))) for run in campaign.runs])


def _parameters(recorded: Mapping[str, Any], simulated: Mapping[str, Any]) -> dict[str, dict[str, Any]]:
    rows = {}
    for name, ours in recorded["parameters"].items():
        theirs = simulated["parameters"].get(name)
        if theirs is None or theirs["value"] is None or ours["value"] is None:
            continue
        spread = [
            (p["interval95"][1] - p["interval95"][0]) / 3.92 for p in (ours, theirs) if None not in p["interval95"]
        ]
        apart = abs(theirs["value"] - ours["value"])
        sure = len(spread) == 2 and apart > SIGMAS * math.hypot(*spread)
        differs = sure and apart > RELATIVE * abs(ours["value"])
        verdict = (
            f"{100.0 * (theirs['value'] / ours['value'] - 1.0):+.1f} %" if differs and ours["value"] else "agrees"
        )
        rows[name] = {
            "simulated": theirs["value"], "simulated_interval95": theirs["interval95"], "recorded": ours["value"],
            "recorded_interval95": ours["interval95"], "unit": ours["unit"], "differs": differs, "verdict": verdict,
        }  # fmt: skip
    return rows


def _not_told(scores: Scores, answer: Mapping[str, Any]) -> list[str]:
    told = [
        "Without the model: how much its step, integrator and friction solver cost can't be told from its outputs; that "
        "part is in what these figures call the simulation's own parameters and effects, or unsplit.",
        "Without the model: which of its numbers to change can't be told, only what it behaves like at the joint output.",
    ]
    if answer["verdict"] == "unknown":
        told.append("The simulation's outputs follow no law of the catalogue, so what it holds has no name here.")
    if scores.missing:
        told.append(
            f"{len(scores.missing)} recorded outputs are not among the simulation's: {', '.join(scores.missing[:4])}."
        )
    return told


def behaviour_json(found: Behaviour) -> dict[str, Any]:
    """``simulation`` of ``diagnosis.json``."""
    scores = found.scores
    loud = [c for c in scores.channels if c.error > _SMALL]
    own = [c for c in loud if c.explained > _INSTRUMENT]
    places = list(dict.fromkeys(name.split("@")[1] for name in (*found.left_out, *found.contradicted)))
    depends = [c.channel for c in own]
    return {
        "kind": "outputs",
        "runs": list(scores.runs),
        "held_out": scores.held_out,
        "error": found.error,
        "remaining": found.remaining,
        "shares": {"numerics": None, **found.shares},
        "unsplit": found.error - found.emulated,
        "by_experiment": {"unchanged": grouped(scores.errors)},
        "by_run": {e.run: mean_error([o for o in scores.every_run if o.run == e.run]) for e in scores.every_run},
        "left_out": list(found.left_out),
        "contradicted": list(found.contradicted),
        "behaves_like": found.parameters,
        "where": {
            "locations": places,
            "channels": [
                {
                    "channel": c.channel, "error": c.error, "gain": c.gain, "delay_s": c.delay,
                    "explained_by_gain_and_delay": c.explained, "frequency_hz": list(c.band),
                }
                for c in scores.channels
            ],
            "instrument_alone": depends if len(own) == len(loud) == 1 and len(scores.channels) > 1 else [],
        },
        "not_told": list(found.not_told),
        "notes": [],
    }  # fmt: skip
