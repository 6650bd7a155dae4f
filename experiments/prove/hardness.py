"""Is the hardness of a case, found by projection, what full refits of its rivals find?

Cases of a draw are scaled by a projection: the base linear about where it fits best, rivals as directions. What is sealed
with a case is what refits leave: the three rivals that come nearest, in each of their textbook laws, fitted to the case by
Levenberg-Marquardt together with the base. Here the two are held against each other.
"""

from __future__ import annotations

import itertools
import json
import multiprocessing
import os
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Final

import numpy as np

from jointscope.atomic import write_text
from jointscope.experiments.prove.judging import BANDS
from jointscope.progress import track
from jointscope.sim.concealed import strength
from jointscope.sim.concealed.concealment import held_against
from jointscope.sim.concealed.draw import Order, decide
from jointscope.sim.concealed.nearest import nearest_refit
from jointscope.sim.concealed.yardstick import yardstick

SEED: Final = 4100
KEPT: Final = "cases"


@dataclass(frozen=True)
class Check:
    """One case's discriminability, by projection and by refits.

    Attributes:
        index: Of the case in its draw.
        truth: ``name@location``.
        experiments: The case's.
        projected: z_d to first order, by which a case is scaled.
        refitted: The least distance of any refit, which is sealed with it.
        rival: Whose it was.
        fits: How many refits were done.
    """

    index: int
    truth: str
    experiments: str
    projected: float
    refitted: float
    rival: str
    fits: int


def check(order: Order, index: int) -> Check | None:
    """Refit the rivals of one single-effect case; ``None`` where it has none or lies outside 4 to 100."""
    case = decide(order, index)
    if case.measured is None or not case.measured.nearest or not 4.0 <= case.measured.z_d <= 100.0:
        return None
    bench, effect = case.bench, case.effects[0]
    yard = yardstick(bench.rig, bench.plan, bench.noise)
    sight = strength.look(yard, (effect,))
    r = strength.refitted_base(yard, sight)
    rivals = held_against(yard, bench, effect, r, np.random.default_rng([order.seed, index, 99]))
    first = min(strength.left_over(r, rival.directions) for rival in rivals.values())
    found = nearest_refit(yard, bench, sight, r, rivals)
    return Check(index, effect.label, bench.experiments, first, found.z_d, found.rival, found.fits)


def check_hardness(out: Path, *, cases: int, first_seed: int, workers: int) -> int:
    """Check ``cases`` cases on several processes and write ``hardness.json`` and ``README.md`` into ``out``; resumable.

    Returns:
        0 where the median of refitted over projected lies within 0.8 to 1.25, else 1.
    """
    order = Order(seed=SEED + first_seed, cases=10**6, kind="singles", draw="development")
    (out / KEPT).mkdir(parents=True, exist_ok=True)
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    with multiprocessing.get_context("spawn").Pool(max(1, workers)) as pool:
        # in the order of the cases, whichever process is first: the same cases whatever the number of processes
        tasks = ((order, index, out / KEPT / f"{index}.json") for index in range(3 * cases + 10))
        fitting = (found for found in pool.imap(_kept, tasks) if found is not None)
        done = list(track(itertools.islice(fitting, cases), "refitting rivals", cases))
        pool.terminate()
    write_text(out / "hardness.json", json.dumps([asdict(one) for one in done], indent=1) + "\n")
    text = report(done)
    write_text(out / "README.md", text)
    print(text)
    return 0 if 0.8 <= float(np.median([one.refitted / one.projected for one in done])) <= 1.25 else 1


def _kept(task: tuple[Order, int, Path]) -> Check | None:
    order, index, file = task
    if not file.is_file():
        found = check(order, index)
        write_text(file, json.dumps(None if found is None else asdict(found)) + "\n")
    held = json.loads(file.read_text(encoding="utf-8"))
    return None if held is None else Check(**held)


def report(done: Sequence[Check]) -> str:
    """The figures as Markdown."""
    ratio = np.array([one.refitted / one.projected for one in done])
    low, middle, high = np.quantile(ratio, [0.1, 0.5, 0.9])
    same = sum(_band(one.refitted) == _band(one.projected) for one in done)
    logs = np.log([[one.projected, one.refitted] for one in done]).T
    lines = [
        "# Discriminability by projection and by full refits",
        "",
        f"{len(done)} cases, {sum(one.fits for one in done)} refits. Refitted over projected z_d: median"
        f" {middle:.2f}, 10 to 90 % {low:.2f} to {high:.2f}; correlation of the logarithms"
        f" {np.corrcoef(logs)[0, 1]:.2f}; same band in {same} of {len(done)}.",
        "",
        "| case | experiments | truth | nearest after refits | projected z_d | refitted z_d | ratio | refits |",
        "|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {one.index} | {one.experiments} | {one.truth} | {one.rival} | {one.projected:.1f} | {one.refitted:.1f}"
        f" | {one.refitted / one.projected:.2f} | {one.fits} |"
        for one in done
    ]
    return "\n".join(lines) + "\n"


def _band(z_d: float) -> str:
    return next(name for name, least in BANDS if z_d >= least)
