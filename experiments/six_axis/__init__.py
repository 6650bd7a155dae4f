"""Section 4 of the paper: the six-axis arm simulated, identified and predicted, beside the printed numbers."""

from __future__ import annotations

from pathlib import Path

__all__ = ["reproduce_six_axis"]


def reproduce_six_axis(out: Path, seed: int = 0) -> int:
    """Write Figures 17-23, Tables 3-4 and Equation (27) into ``out``; 1 where a bound is missed, else 0."""
    import time
    from dataclasses import replace

    import matplotlib

    from jointscope.experiments.six_axis.claims import claims
    from jointscope.experiments.six_axis.figures import draw_all
    from jointscope.experiments.six_axis.measure import measure
    from jointscope.experiments.six_axis.plans import driven_plan
    from jointscope.experiments.six_axis.report import write_report
    from jointscope.sim.arm.campaign import arm_campaign

    matplotlib.use("Agg")
    started, busy = time.perf_counter(), time.process_time()
    out.mkdir(parents=True, exist_ok=True)
    result = measure(seed)
    plan = driven_plan()
    figures = draw_all(out, result, arm_campaign(plan, ()).rig)
    result = replace(result, seconds=time.perf_counter() - started, processor_seconds=time.process_time() - busy)
    holds = write_report(out, result, plan.truth, figures, seed)
    for claim in claims(result):
        print(f"{'ok  ' if claim.holds else 'MISS'} {claim.what}: {claim.value} ({claim.bound})")
    print(out / "README.md")
    return 0 if holds else 1
