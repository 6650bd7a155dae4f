"""Claim: stiffness, inertia and damping come back unbiased, near the Cramer-Rao bound, with intervals that cover.

A thousand campaigns of 20 hits with known answers (``recovery_truth``: closed form, no code shared with the estimator)
go through ``identify`` with band 2-50 Hz and nothing else given: the contact is found from the data. Beside it, on the
same records, the textbook (H1 over the whole record, nonlinear least squares of (20)) and pyFRF + sdypy-EMA. A few
campaigns are MuJoCo's instead of the closed form's.

Results are kept per case and seed under ``DIR/parts``: an interrupted run goes on where it stopped, and the numbers do
not depend on how many processes worked.
"""

from __future__ import annotations

import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jointscope.atomic import replaced_file, write_text
from jointscope.experiments.recovery_cases import BAND, CASES, Case, closed_form_campaign, mujoco_campaign
from jointscope.experiments.recovery_report import as_csv, draw, report_text
from jointscope.progress import track

Real = NDArray[np.float64]

CHUNK = 25
PARAMETERS = ("stiffness", "inertia", "damping_total")


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
    report, failed = report_text(results, seeds, first_seed, available())
    write_text(out / "README.md", report)
    write_text(out / "recovery.csv", as_csv(results))
    draw(results, out / "recovery.png")
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


def _one(case: Case, seed: int) -> Real:
    from jointscope.experiments.modal_peers import available, pyfrf_ema
    from jointscope.identification.comparison import least_squares_h1
    from jointscope.identification.frf import estimate_frf
    from jointscope.identification.hammer import HammerPlan
    from jointscope.identification.identify import identify

    rng = np.random.default_rng([seed, case.index])
    campaign, records = mujoco_campaign(case, rng) if case.mujoco else closed_form_campaign(case, rng)
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
