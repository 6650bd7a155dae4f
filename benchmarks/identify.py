"""How long a campaign of 20 hits takes to identify, beside pyFRF + sdypy-EMA on the same records.

    python benchmarks/identify.py

Prints medians over ten runs after import, one thread. The claim is 0.3 s on two cores.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from jointscope.experiments.modal_peers import available, pyfrf_ema
from jointscope.experiments.recovery_cases import BAND, CASES, closed_form_campaign
from jointscope.identification.hammer import HammerPlan
from jointscope.identification.identify import identify

RUNS = 10


def timed(task: Callable[[], object]) -> tuple[float, float]:
    """Median wall and processor time of ``task`` [s], after one run that is not counted."""
    task()
    wall, processor = [], []
    for _ in range(RUNS):
        start, used = time.perf_counter(), time.process_time()
        task()
        wall.append(time.perf_counter() - start)
        processor.append(time.process_time() - used)
    return float(np.median(wall)), float(np.median(processor))


def main() -> None:
    """Print the table."""
    campaign, records = closed_form_campaign(CASES[0], np.random.default_rng([0, 0]))
    print("20 hits, 1024 Hz, 2 s                                   wall [s]  processor [s]")
    tasks: list[tuple[str, Callable[[], object]]] = [
        ("identify, band and modes from the data, with levels", lambda: identify(campaign)),
        ("identify, 2-50 Hz, without levels", lambda: identify(campaign, HammerPlan(band=BAND, levels=False))),
    ]
    if available():
        tasks.append(
            ("pyFRF H1 + sdypy-EMA LSCF + LSFD, no intervals",
             lambda: pyfrf_ema(records.torque, records.acceleration, records.rate, 40.3))
        )  # fmt: skip
    else:
        print("pyFRF and sdypy-EMA are not installed (extra [bench]): no peer")
    for name, task in tasks:
        wall, processor = timed(task)
        print(f"{name:55s} {wall:8.3f}  {processor:8.3f}")


if __name__ == "__main__":
    main()
