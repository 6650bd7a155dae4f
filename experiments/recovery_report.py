"""What the recovered values of many campaigns say: bias, scatter, coverage, and which claims hold."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jointscope.experiments.recovery_cases import BAND, CASES, HITS, Case

Real = NDArray[np.float64]

NAMES = ("K", "J_L", "c")
METHODS = ("this", "textbook H1", "pyFRF + sdypy-EMA")


@dataclass(frozen=True, kw_only=True, eq=False)
class Figures:
    """What a case's rows say, one value per parameter [%].

    Attributes:
        bias: Mean error, shape (n_methods, 3).
        error: Its standard error, likewise.
        scatter: Root mean square error about the truth's mean estimate, likewise.
        bound: Root mean square Cramer-Rao bound, shape (3,).
        coverage: Of headline, model and repeats intervals, shape (3, 3).
        found: How many campaigns each method answered, shape (n_methods,).
    """

    bias: Real
    error: Real
    scatter: Real
    bound: Real
    coverage: Real
    found: Real


def figures(rows: Real) -> Figures:
    """Reduce the rows of one case."""
    truth, bound = rows[:, 1:4], rows[:, 4:7]
    estimates = rows[:, 7:16].reshape(-1, 3, 3)
    error = 100.0 * (estimates / truth[:, None, :] - 1.0)
    count = np.sum(np.isfinite(error[:, :, 0]), axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        some = np.where(count[:, None] > 1, 1.0, np.nan)
        filled = np.where(np.isfinite(error), error, 0.0)
        mean = filled.sum(axis=0) / count[:, None]
        spread = np.sqrt(
            np.where(np.isfinite(error), (error - mean) ** 2, 0.0).sum(axis=0) / (count[:, None] - 1.0)
        )
    ends = rows[:, 16:34].reshape(-1, 3, 3, 2)  # parameter, kind, end
    inside = (ends[..., 0] <= truth[:, :, None]) & (truth[:, :, None] <= ends[..., 1])
    return Figures(
        bias=mean * some,
        error=spread / np.sqrt(np.maximum(count, 1)[:, None]) * some,
        scatter=spread * some,
        bound=np.sqrt(np.mean((100.0 * bound / truth) ** 2, axis=0)),
        coverage=100.0 * inside.mean(axis=0).T,
        found=count.astype(float),
    )


def report_text(results: dict[str, Real], seeds: int, first_seed: int, peers: bool) -> tuple[str, int]:
    """``README.md`` and how many claims fail; ``results``: each case's rows."""
    lines = [
        "# Recovery of K, J_L and c from 20 hits", "",
        f"{seeds} campaigns per case, seeds {first_seed} to {first_seed + seeds - 1} (MuJoCo: every 20th), band "
        f"{BAND[0]:g}-{BAND[1]:g} Hz, 1024 Hz, 2 s; hits of 60-500 N lasting 5-10 ms; noise rms in % of each hit's peak.",
        "",
    ]  # fmt: skip
    if not peers:
        lines += ["pyFRF and sdypy-EMA are not installed (extra `bench`), so their rows are absent.", ""]
    lines += _fisher_text()
    failed = 0
    for case in CASES:
        if case.name not in results:
            continue
        own = figures(results[case.name])
        text, misses = _case_text(case, own, results[case.name].shape[0])
        lines += text
        failed += misses
    lines.append(f"**{'All claims hold.' if not failed else f'{failed} claims fail.'}**")
    return "\n".join(lines) + "\n", failed


def _fisher_text() -> list[str]:
    """The analytic Fisher matrix of one reference campaign, printed."""
    from jointscope.experiments.recovery_bound import fisher_matrix
    from jointscope.experiments.recovery_truth import Bench, Pulse, record

    bench = Bench()
    pulse = Pulse(peak=200.0, contact=7e-3, start=25e-3)
    force, acceleration = record(bench, pulse)
    matrix = fisher_matrix(
        bench, [pulse] * HITS, [0.01 * float(np.abs(acceleration).max())] * HITS,
        [0.005 * float(np.abs(force).max())] * HITS, BAND,
    )  # fmt: skip
    truth = np.array([bench.stiffness, bench.inertia, bench.damping])
    relative = matrix * np.outer(truth, truth)
    bound = 100.0 * np.sqrt(np.diag(np.linalg.inv(relative)))
    rows = [
        f"| {name} | " + " | ".join(f"{v:.5g}" for v in row) + " |"
        for name, row in zip(NAMES, relative, strict=True)
    ]
    return [
        "Fisher matrix of (ln K, ln J_L, ln c) for 20 hits of 200 N and 7 ms at 1 % and 0.5 % noise, the force's samples "
        "inside the contact eliminated:", "", "| | K | J_L | c |", "|---|---|---|---|", *rows, "",
        f"Cramer-Rao bound there: K {bound[0]:.4f} %, J_L {bound[1]:.4f} %, c {bound[2]:.4f} %.", "",
    ]  # fmt: skip


def _case_text(case: Case, own: Figures, campaigns: int) -> tuple[list[str], int]:
    lines = [f"## {case.name} ({campaigns} campaigns)", "",
             "| method | | K | J_L | c |", "|---|---|---|---|---|"]  # fmt: skip
    for index, method in enumerate(METHODS):
        if own.found[index] < 2:
            continue
        label = method if own.found[index] == campaigns else f"{method} ({own.found[index]:.0f} answered)"
        bias = " | ".join(f"{b:+.3f} ± {e:.3f}" for b, e in zip(own.bias[index], own.error[index], strict=True))
        lines += [f"| {label} | mean error [%] | {bias} |",
                  "| | scatter [%] | " + " | ".join(f"{v:.3f}" for v in own.scatter[index]) + " |"]  # fmt: skip
        if np.isfinite(own.bound).all():
            ratios = " | ".join(f"{v:.2f}" for v in own.scatter[index] / own.bound)
            lines.append(f"| | scatter over Cramer-Rao bound | {ratios} |")
    for kind, row in zip(("headline", "model", "repeats"), own.coverage, strict=True):
        lines.append(
            f"| this | coverage of 95 % intervals, {kind} [%] | " + " | ".join(f"{v:.1f}" for v in row) + " |"
        )
    claims = _claims(case, own)
    lines += ["", *(f"- {'holds' if good else 'FAILS'}: {text}" for good, text in claims), ""]
    return lines, sum(not good for good, _ in claims)


def _claims(case: Case, own: Figures) -> list[tuple[bool, str]]:
    claims = []
    if case.bias is not None:
        worst = np.abs(own.bias[0])
        claims.append(
            (
                bool(np.all(worst <= case.bias)),
                "|mean error| "
                + ", ".join(
                    f"{name} {value:.3f} <= {limit:g} %"
                    for name, value, limit in zip(NAMES, worst, case.bias, strict=True)
                ),
            )
        )
    if case.ratio is not None and np.isfinite(own.bound).all():
        ratio = own.scatter[0] / own.bound
        claims.append(
            (bool(np.all(ratio <= case.ratio)), f"scatter over bound at most {ratio.max():.2f} <= {case.ratio:g}")
        )
    if case.cover:
        low, high = own.coverage[0].min(), own.coverage[0].max()
        claims.append(
            (
                bool(low >= 93.0 and high <= 97.0),
                f"headline intervals cover {low:.1f} to {high:.1f} %, within 93-97 %",
            )
        )
    return claims  # fmt: skip


def as_csv(results: dict[str, Real]) -> str:
    """Every campaign's row."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    ends = [
        f"{n}_{kind}_{end}" for n in NAMES for kind in ("headline", "model", "repeats") for end in ("low", "high")
    ]
    writer.writerow(
        ["case", "seed", *(f"{n}_true" for n in NAMES), *(f"{n}_bound" for n in NAMES),
         *(f"{n}_{m}" for m in ("this", "h1", "ema") for n in NAMES), *ends]
    )  # fmt: skip
    for name, rows in results.items():
        writer.writerows([name, int(row[0]), *(f"{value:.8g}" for value in row[1:])] for row in rows)
    return stream.getvalue()


def draw(results: dict[str, Real], path: Path) -> None:
    """Histograms of the errors, a row per case."""
    from matplotlib.figure import Figure

    from jointscope.experiments.plot_style import MEASURED, QUIET, THIRD, save, style

    with style():
        drawn = Figure(figsize=(10.0, 2.5 * len(results)), layout="constrained")
        axes = drawn.subplots(len(results), 3, squeeze=False)
        for row, (name, rows) in zip(axes, results.items(), strict=True):
            error = 100.0 * (rows[:, 7:16].reshape(-1, 3, 3) / rows[:, 1:4][:, None, :] - 1.0)
            for p, cell in enumerate(row):
                reach = float(np.nanpercentile(np.abs(error[:, :, p]), 99))
                edges = np.linspace(-reach, reach, 41)
                for method, colour in zip(range(3), (MEASURED, QUIET, THIRD), strict=True):
                    values = error[:, method, p]
                    if np.isfinite(values).sum() > 1:
                        cell.hist(
                            values[np.isfinite(values)],
                            edges,
                            histtype="step",
                            color=colour,
                            label=METHODS[method],
                        )
                cell.axvline(0.0, color="black", linewidth=0.6)
                cell.set_title(f"{NAMES[p]}: {name}" if p == 0 else NAMES[p], fontsize=8)
                cell.set_xlabel("error [%]")
        axes[0][0].legend()
        save(drawn, path)
