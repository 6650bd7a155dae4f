"""Claim: stiffness, inertia and damping come back unbiased, near the Cramer-Rao bound, with intervals that cover.

A thousand campaigns of 20 hits with known answers (``recovery_truth``: closed form, no code shared with the estimator)
go through ``identify`` with band 2-50 Hz and nothing else given: the contact is found from the data. Beside it, on the
same records, the textbook (H1 over the whole record, nonlinear least squares of (20)) and pyFRF + sdypy-EMA. A few
campaigns are MuJoCo's instead of the closed form's.

Results are kept per case and seed under ``DIR/parts``: an interrupted run goes on where it stopped, and the numbers do
not depend on how many processes worked.
"""

from __future__ import annotations

import csv
import io
import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jointscope.atomic import replaced_file, write_text
from jointscope.progress import track

if TYPE_CHECKING:
    from jointscope.recordings.campaign import Campaign

Real = NDArray[np.float64]

BAND = (2.0, 50.0)
HITS = 20
CHUNK = 25
NAMES = ("K", "J_L", "c")
PARAMETERS = ("stiffness", "inertia", "damping_total")
METHODS = ("this", "textbook H1", "pyFRF + sdypy-EMA")


@dataclass(frozen=True, kw_only=True)
class Case:
    """One setting of noise and scatter.

    Attributes:
        name: Short.
        acceleration: White noise on the acceleration, rms over each hit's peak.
        force: Likewise on the force.
        gain: Hit-to-hit gain scatter, relative standard deviation.
        timing: Hit-to-hit skew, standard deviation [s].
        bias: Bounds on |mean error| of K, J_L, c [%]; ``None``: not claimed.
        ratio: Bound on scatter over the Cramer-Rao bound; ``None``: not claimed.
        cover: Whether 95 % intervals must cover 93-97 %.
        index: Part of every seed.
        share: Every ``share``-th seed is run.
        mujoco: Truth by MuJoCo instead of the closed form.
    """

    name: str
    acceleration: float
    force: float
    gain: float = 0.0
    timing: float = 0.0
    bias: tuple[float, float, float] | None = None
    ratio: float | None = None
    cover: bool = False
    index: int
    share: int = 1
    mujoco: bool = False


CASES = (
    Case(name="1 % acceleration, 0.5 % force", acceleration=0.01, force=0.005, bias=(0.1, 0.1, 0.3), ratio=1.3,
         cover=True, index=0),
    Case(name="1 % acceleration, 5 % force", acceleration=0.01, force=0.05, bias=(0.5, 0.5, 0.5), ratio=2.0, index=1),
    Case(name="1 % gain and 30 us timing scatter", acceleration=0.01, force=0.005, gain=0.01, timing=30e-6, cover=True,
         index=2),
    Case(name="MuJoCo, 1 % acceleration, 0.5 % force", acceleration=0.01, force=0.005, bias=(0.1, 0.1, 0.3), index=3,
         share=20, mujoco=True),
)  # fmt: skip


def run_recovery(out: Path, *, seeds: int = 1000, first_seed: int = 0, workers: int = 2) -> int:
    """Run every case, write ``README.md``, ``recovery.csv`` and ``recovery.png``; 1 where a claim fails, else 0."""
    from jointscope.experiments.modal_peers import available

    out.mkdir(parents=True, exist_ok=True)
    tasks = _tasks(out, range(first_seed, first_seed + seeds))
    todo = [task for task in tasks if not task[2].exists()]
    if todo:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # inherited: two workers of one thread beat two of two
        with ProcessPoolExecutor(max_workers=max(1, workers)) as pool:
            waiting = [pool.submit(run_chunk, *task) for task in todo]
            for done in track(as_completed(waiting), "campaigns, by the 25", len(waiting)):
                done.result()
    results = {case.name: np.concatenate([_load(task[2]) for task in tasks if task[0].index == case.index])
               for case in CASES if any(task[0].index == case.index for task in tasks)}  # fmt: skip
    report, failed = _report(results, seeds, first_seed, available())
    write_text(out / "README.md", report)
    write_text(out / "recovery.csv", _csv(results))
    _draw(results, out / "recovery.png")
    print(report)
    print(f"wrote {out}")
    return 1 if failed else 0


def _tasks(out: Path, seeds: Sequence[int]) -> list[tuple[Case, tuple[int, ...], Path]]:
    tasks = []
    for case in CASES:
        own = [seed for seed in seeds if seed % case.share == 0]
        for start in range(0, len(own), CHUNK):
            part = tuple(own[start : start + CHUNK])
            tasks.append((case, part, out / "parts" / f"case{case.index}-{part[0]}-{part[-1]}.npz"))
    return tasks


def _load(path: Path) -> Real:
    with np.load(path) as stored:
        return np.asarray(stored["rows"], dtype=float)


def run_chunk(case: Case, seeds: Sequence[int], path: Path) -> None:
    """Run some seeds of a case and write their rows: seed, then per method K, J_L, c; bounds; interval ends."""
    rows = np.array([_one(case, seed) for seed in seeds])
    with replaced_file(path) as temporary, temporary.open("wb") as stream:
        np.savez(stream, rows=rows)


@dataclass(frozen=True, kw_only=True, eq=False)
class Records:
    """One campaign's records for the other methods, the truth and the bound.

    Attributes:
        torque: Shape (n_hits, n) [N m].
        acceleration: Angular, shape (n_hits, n) [rad/s^2].
        rate: [Hz].
        truth: K, J_L, c.
        bound: Their Cramer-Rao bounds, standard deviations; NaN where not computed.
    """

    torque: Real
    acceleration: Real
    rate: float
    truth: Real
    bound: Real


def _one(case: Case, seed: int) -> Real:
    from jointscope.experiments.modal_peers import available, pyfrf_ema
    from jointscope.identification.comparison import least_squares_h1
    from jointscope.identification.frf import estimate_frf
    from jointscope.identification.hammer import HammerPlan
    from jointscope.identification.identify import identify

    rng = np.random.default_rng([seed, case.index])
    campaign, records = _mujoco_campaign(case, rng) if case.mujoco else closed_form_campaign(case, rng)
    found = identify(campaign, HammerPlan(band=BAND, levels=False))
    own = [found.parameters[name] for name in PARAMETERS]
    near = float(found.modes[0].frequency.value)
    frf = estimate_frf(records.torque, records.acceleration, records.rate)
    textbook = least_squares_h1(frf, BAND, near, found.modes[0].damping_ratio.value)
    peer = pyfrf_ema(records.torque, records.acceleration, records.rate, near) if available() else None
    others = [
        [np.nan] * 3 if row is None else [row.stiffness, row.inertia, row.damping] for row in (textbook, peer)
    ]
    ends = [end for e in own for interval in ((e.low, e.high), e.model, e.repeats or e.model) for end in interval]
    return np.array([seed, *records.truth, *records.bound, *(e.value for e in own), *others[0], *others[1], *ends])


def closed_form_campaign(case: Case, rng: np.random.Generator) -> tuple[Campaign, Records]:
    """A campaign of ``case`` with closed-form truth."""
    from jointscope.experiments.recovery_bound import fisher_matrix
    from jointscope.experiments.recovery_truth import Bench, draw_pulses, record
    from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream

    bench = Bench()
    pulses = draw_pulses(rng, HITS)
    runs, forces, accelerations, noise_y, noise_u = [], [], [], [], []
    for number, pulse in enumerate(pulses):
        force, acceleration = record(bench, pulse, late=rng.normal(0.0, case.timing) if case.timing else 0.0)
        acceleration = acceleration * (1.0 + (rng.normal(0.0, case.gain) if case.gain else 0.0))
        noise_u.append(case.force * float(np.abs(force).max()))
        noise_y.append(case.acceleration * float(np.abs(acceleration).max()))
        force = force + rng.normal(0.0, noise_u[-1], force.shape)
        acceleration = acceleration + rng.normal(0.0, noise_y[-1], acceleration.shape)
        forces.append(force * bench.hammer_radius)
        accelerations.append(acceleration / bench.accelerometer_radius)
        channels = (
            Channel(column="force", quantity="force", unit="N", location="arm", role="input", samples=force,
                    radius=bench.hammer_radius),
            Channel(column="acc", quantity="linear-acceleration", unit="m/s^2", location="arm", role="output",
                    samples=acceleration, radius=bench.accelerometer_radius),
        )  # fmt: skip
        stream = Stream(file="hit", sampling_rate=bench.rate, length=force.size, channels=channels)
        runs.append(Run(id=f"hit-{number:02d}", experiment="hammer", brake=True, streams=(stream,)))
    fisher = fisher_matrix(bench, pulses, noise_y, noise_u, BAND)
    campaign = Campaign(
        path=Path("recovery"), rig=Nameplate(topology="two-inertia", motion="rotational"), runs=tuple(runs)
    )
    return campaign, Records(
        torque=np.array(forces),
        acceleration=np.array(accelerations),
        rate=bench.rate,
        truth=np.array([bench.stiffness, bench.inertia, bench.damping]),
        bound=np.sqrt(np.diag(np.linalg.inv(fisher))),
    )


def _mujoco_campaign(case: Case, rng: np.random.Generator) -> tuple[Campaign, Records]:
    from jointscope.models.paper import paper_rig
    from jointscope.sim.chain import noiseless
    from jointscope.sim.measurement_noise import HitNoise, with_noise
    from jointscope.sim.plan import HammerPlan, SingleJointPlan
    from jointscope.sim.single_joint import simulate_single_joint

    rig = paper_rig()
    hits = HammerPlan(
        hits=HITS // 2, gain_scatter=0.0, timing_scatter=0.0, position_scatter=0.0, double_hit_probability=0.0
    )
    plan = SingleJointPlan(hammer=hits, sweep=None, motion=None, chain=noiseless())
    clean = simulate_single_joint(rig, plan, rng)
    noise = HitNoise(
        acceleration=case.acceleration, force=case.force, gain_scatter=case.gain, timing_scatter=case.timing
    )
    campaign = with_noise(clean, noise, rng)
    first = campaign.runs[0].streams[0]
    rows = {
        quantity: np.array([run.select(quantity)[0].samples for run in campaign.runs])
        for quantity in ("force", "linear-acceleration")
    }
    return campaign, Records(
        torque=rows["force"] * rig.hammer_radius,
        acceleration=rows["linear-acceleration"] / rig.accelerometer_radius,
        rate=first.sampling_rate,
        truth=np.array([rig.joint.stiffness, rig.joint.load_inertia, rig.joint.damping + rig.joint.load_damping]),
        bound=np.full(3, np.nan),
    )


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


def _report(results: dict[str, Real], seeds: int, first_seed: int, peers: bool) -> tuple[str, int]:
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


def _csv(results: dict[str, Real]) -> str:
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


def _draw(results: dict[str, Real], path: Path) -> None:
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
