"""Claim: on real recordings the fit to one take describes the next one.

Motor bench with a flexible coupling: the two-inertia joint fitted to the first multisine predicts the second. Hammer on
a structure: the modes of the first hit predict both accelerations of the second. Runs with role = "validate" are held
back from the fit and used here only.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from jointscope.errors import RefusedError
from jointscope.experiments.plot_style import MEASURED, PREDICTED, QUIET, save, style
from jointscope.identification.hit_spectra import Rejected, read_hit
from jointscope.identification.identify import identify
from jointscope.identification.motor_bench import bench_responses
from jointscope.identification.result import Identification
from jointscope.identification.two_inertia import fit_two_inertia, fitted
from jointscope.recordings.campaign import Campaign, Run

Real = NDArray[np.float64]
Complex = NDArray[np.complexfloating[Any, Any]]

KNOWN = 0.1  # relative standard deviation up to which a line counts as measured


@dataclass(frozen=True, kw_only=True)
class HeldOutOutput:
    """How well one output of a held-out hit is predicted inside the fitted band.

    Attributes:
        output: Column.
        nrmse: RMS of measured minus predicted over RMS of measured [-].
        frac: Squared correlation of the two spectra [-].
        floor: NRMSE of the first hit's own FRF as the predictor: what no model of the first hit undercuts [-].
    """

    output: str
    nrmse: float
    frac: float
    floor: float


def predict_held_out_hit(
    campaign: Campaign, path: Path | None = None
) -> tuple[Identification, list[HeldOutOutput]]:
    """Identify from the estimate hits, predict the first validate hit; draw it to ``path``.

    Raises:
        RefusedError: There is no hit to hold back, or it is unusable.
    """
    found = identify(campaign)
    held = [run for run in campaign.runs if run.role == "validate" and run.experiment == "hammer"]
    if found.fit is None or not held:
        raise RefusedError('the campaign has no fitted hits, or no hammer run with role = "validate"')
    hit = read_hit(held[0], campaign.rig)
    if isinstance(hit, Rejected):
        raise RefusedError(f"run {hit.run}: {hit.detail}")
    measured = hit.spectrum.in_band(found.band)
    s = 2j * np.pi * measured.frequency
    predicted = measured.sensor * found.fit.model.response(s) * measured.input
    first = found.fit.hits[0]
    raw = first.output / np.where(np.abs(first.input) > 0.0, first.input, np.nan) * measured.input
    rows = [
        HeldOutOutput(
            output=name,
            nrmse=_nrmse(predicted[o], measured.output[o]),
            frac=_frac(predicted[o], measured.output[o]),
            floor=_nrmse(raw[o], measured.output[o]),
        )
        for o, name in enumerate(hit.outputs)
    ]
    if path is not None:
        _draw_hit(path, rows, measured.frequency, measured.output, predicted, hit.spectrum.duration)
    return found, rows


def _nrmse(predicted: Complex, measured: Complex) -> float:
    return float(np.sqrt(np.sum(np.abs(predicted - measured) ** 2) / np.sum(np.abs(measured) ** 2)))


def _frac(predicted: Complex, measured: Complex) -> float:
    cross = abs(np.vdot(predicted, measured)) ** 2
    return float(cross / (np.vdot(predicted, predicted).real * np.vdot(measured, measured).real))


def _draw_hit(
    path: Path,
    rows: Sequence[HeldOutOutput],
    frequency: Real,
    measured: Complex,
    predicted: Complex,
    duration: float,
) -> None:
    step = frequency[1] - frequency[0]
    size = 2 * (round(frequency[-1] / step) + 1)
    index = np.round(frequency / step).astype(int)
    times = np.arange(size) * duration / size
    with style():
        figure = Figure(figsize=(10.0, 2.9 * len(rows)), layout="constrained")
        axes = figure.subplots(len(rows), 2, squeeze=False)
        for (left, right), row, one, other in zip(axes, rows, measured, predicted, strict=True):
            for values, colour, label in ((one, MEASURED, "recorded"), (other, PREDICTED, "predicted")):
                spectrum = np.zeros(size // 2 + 1, dtype=complex)
                spectrum[index] = values
                left.plot(
                    times, np.fft.irfft(spectrum) * size / duration, color=colour, linewidth=0.8, label=label
                )
                right.semilogy(frequency, np.abs(values), color=colour, linewidth=0.7, label=label)
            left.set_xlim(0.0, min(0.8, duration))
            left.set_title(
                f"{row.output}: NRMSE {row.nrmse:.3f}, FRAC {row.frac:.3f} (hit-to-hit floor {row.floor:.3f})"
            )
            left.set_xlabel("time [s]")
            right.set_xlabel("frequency [Hz]")
            right.legend()
        save(figure, path)


@dataclass(frozen=True, kw_only=True)
class BenchTransfer:
    """A joint fitted to one run against another run of the same bench, per side.

    Attributes:
        side: ``motor`` or ``load``.
        lines: Lines of the other run known to 10 %.
        own: RMS of ln|fitted/measured| on the run fitted.
        other: The same on the run held back.
        other_median: Median of the absolute value there.
        between: RMS of ln|one/other| of the two measurements on common lines: the base model's floor.
        between_median: Its median.
    """

    side: str
    lines: int
    own: float
    other: float
    other_median: float
    between: float
    between_median: float


def predict_held_out_bench(campaign: Campaign, path: Path | None = None) -> list[BenchTransfer]:
    """Fit the joint to the first estimate run, score it on the first validate run; draw both to ``path``.

    Raises:
        RefusedError: One of the two is missing.
    """
    estimate = [run for run in campaign.runs if run.role != "validate"]
    validate = [run for run in campaign.runs if run.role == "validate"]
    if not estimate or not validate:
        raise RefusedError('the campaign needs a run to fit and one with role = "validate"')
    sides, first = bench_responses(estimate[0], campaign.rig)
    other_sides, second = bench_responses(validate[0], campaign.rig)
    if sides != other_sides:
        raise RefusedError(f"{validate[0].id} records {', '.join(other_sides)}, not {', '.join(sides)}")
    fit = fit_two_inertia([first], sides)
    _, a, b = np.intersect1d(first.frequency.round(6), second.frequency.round(6), return_indices=True)
    rows = []
    model_one, model_two = fitted(fit, sides, first.frequency), fitted(fit, sides, second.frequency)
    for o, side in enumerate(sides):
        known = second.deviation[o] / np.abs(second.values[o]) < KNOWN
        own_known = first.deviation[o] / np.abs(first.values[o]) < KNOWN
        both = known[b] & own_known[a]
        off = np.log(np.abs(model_two[o] / second.values[o]))[known]
        own = np.log(np.abs(model_one[o] / first.values[o]))[own_known]
        apart = np.log(np.abs(first.values[o][a] / second.values[o][b]))[both]
        rows.append(
            BenchTransfer(
                side=side, lines=int(known.sum()), own=_rms(own), other=_rms(off),
                other_median=float(np.median(np.abs(off))), between=_rms(apart),
                between_median=float(np.median(np.abs(apart))),
            )
        )  # fmt: skip
    if path is not None:
        _draw_bench(path, rows, second.frequency, second.values, model_two, estimate[0], validate[0])
    return rows


def _rms(values: Real) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _draw_bench(
    path: Path,
    rows: Sequence[BenchTransfer],
    frequency: Real,
    measured: Complex,
    model: Complex,
    one: Run,
    other: Run,
) -> None:
    with style():
        figure = Figure(figsize=(10.0, 2.9 * len(rows)), layout="constrained")
        axes = figure.subplots(len(rows), 2, squeeze=False)
        for (left, right), row, values, fit in zip(axes, rows, measured, model, strict=True):
            left.semilogy(frequency, np.abs(values), ".", color=MEASURED, label=f"{other.id}, recorded")
            left.semilogy(frequency, np.abs(fit), color=PREDICTED, label=f"joint fitted to {one.id}")
            left.set_title(
                f"{row.side}: rms of ln|fitted/measured| {row.other:.3f}, median {row.other_median:.3f}"
            )
            left.set_ylabel("|acceleration/input|")
            left.legend()
            right.axhline(0.0, color=QUIET)
            right.plot(frequency, np.log(np.abs(fit / values)), ".", color=MEASURED)
            right.set_title("ln|fitted/measured|")
            for cell in (left, right):
                cell.set_xlabel("frequency [Hz]")
        save(figure, path)


def run_real_identification(out: Path, *, bench: Path | None = None, hammer: Path | None = None) -> int:
    """Both claims as one page: ``out/README.md`` and pictures; prints the tables.

    Args:
        out: Folder to write.
        bench: Imported ``motor-bench-flexcoupling`` campaign; ``None`` leaves it out.
        hammer: Imported ``hammer-lvm`` campaign; likewise.
    """
    from jointscope.atomic import write_text
    from jointscope.recordings.reader import read_campaign

    out.mkdir(parents=True, exist_ok=True)
    lines = ["# Real recordings: the first take describes the second", ""]
    if bench is not None:
        rows = predict_held_out_bench(read_campaign(bench), out / "bench.png")
        lines += [
            "## Motor bench: joint fitted to the first multisine, scored on the second", "",
            "RMS of ln|fitted/measured| over lines known to 10 %, median of its magnitude beside it.", "",
            "| side | on the run fitted | on the run held back | its median | between the two measurements | its median |",
            "|---|---|---|---|---|---|",
            *(f"| {r.side} | {r.own:.3f} | {r.other:.3f} | {r.other_median:.4f} | {r.between:.3f} | {r.between_median:.4f} |"
              for r in rows), "",
            "What remains sits at the antiresonance (51-57 Hz) and the resonance (74-81 Hz): damping that depends on "
            "amplitude, which differs between the two excitations themselves.", "", "![bench](bench.png)", "",
        ]  # fmt: skip
    if hammer is not None:
        found, outputs = predict_held_out_hit(read_campaign(hammer), out / "hit2.png")
        lines += [
            "## Hammer: modes of the first hit, accelerations of the second", "",
            "| frequency [Hz] | 95 % | damping ratio [%] | 95 % |", "|---|---|---|---|",
            *(f"| {m.frequency.value:.3f} | {m.frequency.low:.3f} to {m.frequency.high:.3f} | {100 * m.damping_ratio.value:.3f} "
              f"| {100 * m.damping_ratio.low:.3f} to {100 * m.damping_ratio.high:.3f} |" for m in found.modes), "",
            f"Held-out hit, {found.band[0]:.0f} to {found.band[1]:.0f} Hz:", "",
            "| output | NRMSE | FRAC | NRMSE of the first hit's own FRF |", "|---|---|---|---|",
            *(f"| {r.output} | {r.nrmse:.3f} | {r.frac:.3f} | {r.floor:.3f} |" for r in outputs), "", "![hit](hit2.png)", "",
        ]  # fmt: skip
    text = "\n".join(lines)
    write_text(out / "README.md", text)
    print(text)
    print(f"wrote {out}")
    return 0
