"""The report of a prediction: how far the model holds, run by run and channel by channel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from jointscope.experiments.charts.chart import Chart, Missing
from jointscope.experiments.diagnosis_report.bars import Pair, error_bars
from jointscope.experiments.diagnosis_report.drawing import joint_drawing
from jointscope.experiments.page import FirstScreen, Section, Table, page
from jointscope.prediction.base_model import RunPrediction
from jointscope.prediction.files import mean_errors
from jointscope.prediction.run_scores import ChannelScore
from jointscope.recordings.campaign import Campaign

Scores = Mapping[str, tuple[ChannelScore, ...]]
GOOD = 0.05  # of the signal: below, the prediction is used as it is


def report(
    predictions: Sequence[RunPrediction],
    scores: Scores,
    campaign: Campaign,
    charts: Sequence[Chart],
    provenance: Section,
) -> str:
    """The page as HTML.

    Args:
        predictions: Every run's.
        scores: Per run's id, of its recorded channels.
        campaign: What was read.
        charts: Of the runs that are drawn.
        provenance: The last section.
    """
    first, errors = _first(predictions, dict(scores), campaign)
    notes = tuple(dict.fromkeys(f"{p.run.id}: {note}" for p in predictions for note in p.notes))
    sections = [
        Section(
            heading="Recorded and predicted",
            tabs=tuple(charts) or (Missing("Recorded and predicted", "a recorded output"),),
            notes=notes,
        ),
        _errors(errors),
        _bands(predictions, scores),
        provenance,
    ]
    return page(f"Prediction: {campaign.title or campaign.path.resolve().name}", first, sections)


def _first(
    predictions: Sequence[RunPrediction], scores: dict[str, tuple[ChannelScore, ...]], campaign: Campaign
) -> tuple[FirstScreen, tuple[Pair, ...]]:
    groups: dict[tuple[str, str], list[float]] = {}
    for p in predictions:
        quantities = {c.signal.channel.column: c.signal.channel for c in p.channels}
        for score in scores[p.run.id]:
            channel = quantities[score.column]
            key = (p.run.experiment, f"{channel.quantity.replace('-', ' ')} at {channel.location}")
            groups.setdefault(key, []).append(min(score.error, 100.0))
    errors = tuple(
        Pair(f"{experiment}, {channel}", float(np.mean(found)), None, float("nan"))
        for (experiment, channel), found in sorted(groups.items())
        if np.all(np.isfinite(found))
    )
    means = mean_errors(predictions, scores)
    rig = campaign.rig
    drawing = joint_drawing(
        {},
        topology="two-inertia" if rig.topology == "arm" else rig.topology,
        motion=rig.motion,
        spring=rig.topology != "single-dof" or bool(rig.ground_spring),
        sure=True,
    )
    facts = tuple((f"fit, {experiment}", f"{100.0 * (1.0 - error):.4g} %") for experiment, error in means.items())
    if not errors:
        verdict = f"{len(predictions)} runs predicted from their inputs alone; no output was recorded to compare them with."
        step = "The predicted channels are in one CSV per run beside this page."
    else:
        worst = max(errors, key=lambda pair: pair.base)
        verdict = (
            f"{len(predictions)} runs predicted from their inputs alone: the error is "
            + ", ".join(f"{100.0 * error:.3g} % of the signal in {name} runs" for name, error in means.items())
            + f"; largest in {worst.label} ({100.0 * worst.base:.3g} %)."
        )
        step = (
            "Use the model as it is." if worst.base < GOOD else
            "Run jointscope diagnose on this campaign: it says which physics the model leaves out, or that none is missing."
        )  # fmt: skip
    bars = error_bars(errors, "error")
    return FirstScreen(verdict=verdict, facts=facts, next_step=step, markup=(drawing, bars)), errors


def _errors(errors: Sequence[Pair]) -> Section:
    rows = tuple(
        (pair.label, f"{100.0 * pair.base:.4g} %", f"{100.0 * (1.0 - pair.base):.5g} %") for pair in errors
    )
    return Section(
        heading="Errors",
        table=Table(columns=("experiment and channel", "error", "fit"), rows=rows) if rows else None,
        notes=(
            "Error: RMS of the difference over RMS of the signal (of its change, for angles); fit: 100 % less the error.",
        ),
    )


def _bands(predictions: Sequence[RunPrediction], scores: Scores) -> Section:
    rows = tuple(
        (p.run.id, score.column, f"{b.low:g} to {b.high:g}", f"{b.median_error:.3f}", f"{b.bias:+.3f}", f"{b.frac:.5f}",
         f"{b.nrmse:.4f}", f"{b.peak_frequency_error:+.3f}", f"{b.peak_amplitude_error:+.3f}")
        for p in predictions for score in scores[p.run.id] for b in score.bands
    )  # fmt: skip
    columns = ("run", "channel", "band [Hz]", "median error [dB]", "bias [dB]", "FRAC [-]", "NRMSE [-]",
               "peak's frequency off by [Hz]", "peak's height off by [dB]")  # fmt: skip
    return Section(
        heading="By band",
        table=Table(columns=columns, rows=rows) if rows else None,
        notes=() if rows else ("Missing: an acceleration channel; angles and speeds are scored in time alone.",),
    )
