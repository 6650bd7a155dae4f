"""Stiffness, inertia and damping of a joint with intervals that cover, from hammer hits or a motor bench.

  jointscope identify bench-a --out out/bench-a
  jointscope identify bench-a --out out/bench-a --band 2 50 --modes 1

From hits on the braked joint: errors-in-variables maximum likelihood of the direct parametric form
b1 s^2/(s^2 + a1 s + a2), J_L = 1/b1, c = a1/b1, K = a2/b1; band and number of modes come from the data unless given.
From torque or current and the motion of motor and load: the whole two-inertia joint, per unit of input where the
torque constant is unknown. Measured FRFs (UFF 58) are fitted as well. Runs with role = "validate" are not read.

What the recordings can't carry is refused with the reason. Nothing is corrected silently: bad hits are named, a turned
sign is stated, and `jointscope inspect` says more about the channels.

DIR holds
  identification.json   parameters, modes, quality, refusals (jointscope-identification/1)
  model.json            the base model for `jointscope predict` (jointscope-model/1)
  report.html           the same to read, with figures (each also as PNG and CSV): hits, FRF, levels, stabilisation
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jointscope.identification.result import Identification
    from jointscope.recordings.campaign import Campaign


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("campaign", type=Path, help="folder with campaign.toml")
    parser.add_argument("--out", type=Path, required=True, help="folder to write")
    parser.add_argument("--band", type=float, nargs=2, metavar=("LOW", "HIGH"), help="fit only LOW to HIGH [Hz]")
    parser.add_argument("--modes", type=int, metavar="N", help="number of modes; default: by evidence")
    parser.add_argument("--no-pictures", action="store_true", help="write the two JSON files only")
    parser.add_argument("--json", action="store_true", help="print identification.json instead of the table")


def run(options: argparse.Namespace) -> int:
    """Identify and write; the exit code is 0, or 1 where every parameter and mode was refused."""
    import json
    import os

    os.environ.setdefault(
        "OPENBLAS_NUM_THREADS", "1"
    )  # matrices of a few columns: threads only get in each other's way

    from jointscope.atomic import write_text
    from jointscope.errors import InputError
    from jointscope.identification.hammer import HammerPlan
    from jointscope.identification.identification_file import to_json
    from jointscope.identification.identify import identify
    from jointscope.identification.model_file import write_model
    from jointscope.recordings.reader import read_campaign

    if options.band is not None and not 0.0 <= options.band[0] < options.band[1]:
        raise InputError(options.campaign, "--band", "must be two rising frequencies in Hz", value=options.band)
    if options.modes is not None and options.modes < 1:
        raise InputError(options.campaign, "--modes", "must be at least 1", value=options.modes)
    campaign = read_campaign(options.campaign)
    band = None if options.band is None else (options.band[0], options.band[1])
    found = identify(campaign, HammerPlan(band=band, modes=options.modes))
    quality = _quality(campaign)
    content = to_json(found, quality)
    text = json.dumps(content, indent=2, allow_nan=False) + "\n"
    write_text(options.out / "identification.json", text)
    if found.base is not None:
        write_model(options.out / "model.json", found.base)
    if not options.no_pictures:
        _report(found, campaign, quality, options)
    if options.json:
        print(text, end="")
    else:
        _print(found, options.out)
    return 0 if found.parameters or found.modes else 1


def _quality(campaign: Campaign) -> Sequence[Mapping[str, Any]]:
    """What `inspect` finds in the recordings."""
    from dataclasses import asdict

    from jointscope.identification.quality import findings

    return [{key: value for key, value in asdict(row).items() if value is not None} for row in findings(campaign)]


def _report(
    found: Identification, campaign: Campaign, quality: Sequence[Mapping[str, Any]], options: argparse.Namespace
) -> None:
    from jointscope.atomic import write_text
    from jointscope.experiments.charts.chart import Chart
    from jointscope.experiments.charts.files import write_files
    from jointscope.experiments.diagnosis_report.hits import hit_of, hits_chart, hits_unit
    from jointscope.experiments.identification_charts import identification_charts
    from jointscope.experiments.identification_page import report
    from jointscope.experiments.provenance import provenance_section

    folder = options.out
    hits = tuple(hit for run in campaign.runs if (hit := hit_of(run)) is not None)
    charts = identification_charts(found)
    for chart in (hits_chart(hits, hits_unit(campaign.runs)), *charts):
        if isinstance(chart, Chart):
            write_files(chart, folder)
    words = f"jointscope identify {options.campaign.resolve().name} --out {folder.resolve().name}"
    words += f" --band {options.band[0]:g} {options.band[1]:g}" if options.band else ""
    words += f" --modes {options.modes}" if options.modes else ""
    source = provenance_section(options.campaign, words)
    write_text(folder / "report.html", report(found, campaign, charts, quality, source))


def _print(found: Identification, folder: Path) -> None:
    from jointscope.experiments.identification_page import sentence, short

    print(sentence(found))
    print(f"  {found.method}")
    for name, estimate in found.parameters.items():
        print(f"  {name:22s} {short(estimate)}   (95 %)")
    for mode in found.modes:
        print(f"  {mode.kind:22s} {short(mode.frequency)}, damping ratio {short(mode.damping_ratio)}")
    if found.lack_of_fit is not None:
        print(f"  residual: {found.lack_of_fit.verdict}")
    for note in found.notes:
        print(f"  note: {note}")
    for row in found.rejected:
        print(f"  left out: {row.run}: {row.finding}: {row.detail}")
    for refused in found.refused:
        print(f"  refused: {refused.parameter}: {refused.reason}")
    print(f"wrote {folder}")
