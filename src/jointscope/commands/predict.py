"""Predict what a campaign's sensors should have shown, from its inputs and an identified model.

  jointscope predict out/identify/model.json bench-a --out out/predicted
  jointscope predict out/diagnosis/model.json inputs-only --out out/predicted --declared

MODEL.json comes from `jointscope identify` (the base model) or `jointscope diagnose` (with the effects it found).
Your own MJCF goes in its place, with the map that says which joint is which (`jointscope model map --help`):

  jointscope predict robot.xml bench-a --map map.toml --out out/predicted

Only inputs are read: force, torque, phase currents, speed command, a prescribed motion, and each run's arm_angle.
An encoder or an accelerometer is an output; where it was recorded it is used to score the prediction, never to make it.
A run under speed control is predicted in a closed loop: the drive's law from the model follows the speed command while
the logged torque keeps its detail. Where only the torque was logged the prediction runs open loop, and scores.json
states the band in which its accelerations hold.

DIR holds for every run
  <run id>.csv    time [s] and one column per output channel, in the channel's unit, at its stream's rate
                  (streams of different rates share the time column; a cell without a sample is empty)
and, where outputs were recorded,
  scores.json     errors per run, channel and band: RMS error, dB, FRAC, NRMSE, peak frequency and height
  report.html     how far the model holds, run by run and channel by channel
  <run id>.png    recorded and predicted, in time and frequency, with the band that the parameters' uncertainty leaves
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np
    from numpy.typing import NDArray

    from jointscope.prediction.base_model import RunPrediction
    from jointscope.prediction.run_scores import ChannelScore
    from jointscope.prediction.uncertainty import ChannelBand
    from jointscope.recordings.campaign import Campaign, Run, Signal

MOST_PICTURES = 12


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("model", type=Path, help="model.json of identify or diagnose, or your own MJCF")
    parser.add_argument("campaign", type=Path, help="folder with campaign.toml")
    parser.add_argument("--out", type=Path, required=True, help="folder to write")
    parser.add_argument(
        "--declared", action="store_true", help="also predict output channels that are declared but not recorded"
    )
    parser.add_argument("--map", type=Path, default=None, help="map.toml of your own MJCF (guessed without it)")
    parser.add_argument(
        "--band", type=float, nargs=2, action="append", default=[], metavar="HZ",
        help="also score accelerations from LOW to HIGH; may be repeated",
    )  # fmt: skip
    parser.add_argument("--no-pictures", action="store_true", help="write CSV and scores only")
    parser.add_argument("--json", action="store_true", help="print scores.json instead of the table")


def run(options: argparse.Namespace) -> int:
    """Predict every run; the exit code is 0."""
    from jointscope.atomic import write_text
    from jointscope.errors import InputError
    from jointscope.prediction.files import scores_json, write_run
    from jointscope.prediction.run_scores import score_run
    from jointscope.recordings.reader import read_campaign

    bands = tuple((low, high) for low, high in options.band)
    for low, high in bands:
        if not 0.0 <= low < high:
            raise InputError(options.campaign, "--band", "must be two rising frequencies in Hz", value=(low, high))
    campaign = read_campaign(options.campaign, missing_outputs="allow")
    if options.model.suffix.lower() in (".xml", ".mjcf"):
        from jointscope.prediction.arm_campaign import predict_mapped
        from jointscope.progress import track

        made = predict_mapped(options.model, options.map, campaign, declared=options.declared)
        predictions = list(track(made, "predict", len(campaign.runs)))
    else:
        predictions = _predicted(options.model, campaign, options.declared)
    options.out.mkdir(parents=True, exist_ok=True)
    scores = {}
    for prediction in predictions:
        write_run(options.out, prediction.run.id, prediction.channels)
        scores[prediction.run.id] = score_run(prediction, bands)
    content = scores_json(predictions, scores)
    import json

    text = json.dumps(content, indent=2, allow_nan=False) + "\n"
    if any(scores.values()):
        write_text(options.out / "scores.json", text)
        if not options.no_pictures:
            _report(options, campaign, predictions, scores)
    print(text if options.json else _table(predictions, scores, options.out), end="")
    return 0


def _predicted(model: Path, campaign: Campaign, declared: bool) -> list[RunPrediction]:
    """Dispatch on the model's kind: the base model here, anything richer in the room that wrote it."""
    import json

    from jointscope.errors import InputError
    from jointscope.prediction.base_model import predict_campaign
    from jointscope.progress import track

    try:
        content = json.loads(model.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise InputError(
            model, None, "no such file", fix="write one with: jointscope identify CAMPAIGN --out DIR"
        ) from None
    except ValueError as problem:
        raise InputError(model, None, f"not JSON: {problem}") from None
    kind = content.get("kind", "base") if isinstance(content, dict) else "base"
    if kind == "base":
        from jointscope.identification.model_file import read_model

        made = predict_campaign(read_model(model), campaign, declared=declared)
        return list(track(made, "predict", len(campaign.runs)))
    from jointscope.diagnosis.predict_file import predict_campaign as predict_diagnosis

    by_run = predict_diagnosis(content, campaign)
    return [_wrapped(run, by_run.get(run.id, []), declared) for run in campaign.runs]


def _wrapped(run: Run, pairs: Sequence[tuple[Signal, NDArray[np.float64]]], declared: bool) -> RunPrediction:
    """A diagnosis's predictions as this command's; a column's name is unique within its run."""
    from jointscope.prediction.base_model import ChannelPrediction, RunPrediction, channel_times, outputs_of

    values = {signal.channel.column: predicted for signal, predicted in pairs}
    channels = tuple(
        ChannelPrediction(signal, channel_times(signal, run), values[signal.channel.column])
        for signal in outputs_of(run, declared=declared)
        if signal.channel.column in values
    )
    return RunPrediction(
        run=run,
        channels=channels,
        closed_loop=bool(run.select("speed-command", role="input")),
        legitimate=(0.0, 0.5 * max((s.sampling_rate for s in run.select(role="input")), default=0.0)),
    )


def _report(
    options: argparse.Namespace,
    campaign: Campaign,
    predictions: list[RunPrediction],
    scores: dict[str, tuple[ChannelScore, ...]],
) -> None:
    """The page, and picture and numbers of each run that is drawn."""
    from jointscope.atomic import write_text
    from jointscope.experiments.charts.png import write_png
    from jointscope.experiments.prediction_charts import run_chart
    from jointscope.experiments.prediction_page import report
    from jointscope.experiments.provenance import digest, provenance_section
    from jointscope.progress import track

    charts = []
    scored = _shown([prediction for prediction in predictions if scores[prediction.run.id]])
    for prediction in track(scored, "pictures", len(scored)):
        bands = _bands(options.model, prediction)
        charts.append(run_chart(prediction, scores[prediction.run.id], bands))
        write_png(charts[-1], options.out / f"{prediction.run.id}.png")
    model, folder = options.model, options.out.resolve().name
    words = f"jointscope predict {model.name} {options.campaign.resolve().name} --out {folder}"
    source = provenance_section(options.campaign, words, further=((model.name, digest(model)),))
    write_text(options.out / "report.html", report(predictions, scores, campaign, charts, source))


def _shown(scored: list[RunPrediction]) -> list[RunPrediction]:
    """At most MOST_PICTURES runs, as many of each kind of experiment as there are, in the campaign's order."""
    kinds: dict[str, list[RunPrediction]] = {}
    for prediction in scored:
        kinds.setdefault(prediction.run.experiment, []).append(prediction)
    turns = [own[place] for place in range(len(scored)) for own in kinds.values() if place < len(own)]
    chosen = {prediction.run.id for prediction in turns[:MOST_PICTURES]}
    return [prediction for prediction in scored if prediction.run.id in chosen]


def _bands(model: Path, prediction: RunPrediction) -> tuple[ChannelBand, ...] | None:
    """What the parameters' covariance leaves open, for a base model."""
    if model.suffix.lower() in (".xml", ".mjcf"):
        return None
    import json

    from jointscope.identification.model_file import read_model
    from jointscope.prediction.uncertainty import parameter_bands

    if json.loads(model.read_text(encoding="utf-8")).get("kind", "base") != "base":
        return None
    declared = any(channel.signal.channel.samples is None for channel in prediction.channels)
    return parameter_bands(read_model(model), prediction.run, prediction, declared=declared)


def _table(predictions: list[RunPrediction], scores: dict[str, tuple[ChannelScore, ...]], out: Path) -> str:
    from jointscope.prediction.files import mean_errors

    lines = []
    head = (
        f"{'run':20} {'channel':16} {'error':>8}  {'band':>10} {'median':>9} {'bias':>9} {'FRAC':>7} {'NRMSE':>7}"
    )
    if any(scores.values()):
        lines += [head, f"{'':20} {'':16} {'-':>8}  {'Hz':>10} {'dB':>9} {'dB':>9} {'-':>7} {'-':>7}"]
    for prediction in predictions:
        for score in scores[prediction.run.id]:
            start = f"{prediction.run.id[:20]:20} {score.column[:16]:16} {score.error:8.4f}"
            rows = [
                f"  {f'{b.low:g}-{b.high:g}':>10} {b.median_error:9.3f} {b.bias:+9.3f} {b.frac:7.4f} {b.nrmse:7.4f}"
                for b in score.bands
            ] or [""]
            lines += [start + rows[0], *(" " * 46 + row for row in rows[1:])]
        lines += [f"{prediction.run.id[:20]:20} note: {note}" for note in prediction.notes]
    for experiment, error in mean_errors(predictions, scores).items():
        lines.append(f"mean error over {experiment} runs: {error:.4f} (RMS of the difference over RMS recorded)")
    lines.append(f"{len(predictions)} runs predicted; see {out}")
    return "\n".join(lines) + "\n"
