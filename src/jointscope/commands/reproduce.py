"""Reproduce the paper's experiments without hardware, and the project's own proofs, beside the published numbers.

  jointscope reproduce single-joint --out out/single   sections 2-3: Figures 8-15, Tables 1-2, Equation (26)
  jointscope reproduce six-axis --out out/six          section 4: Figures 17-23, Tables 3-4, Equation (27)
  jointscope reproduce recovery --out out/recovery     bias, coverage and scatter of the identification, 1000 seeds

Each writes a Markdown page (README.md) with a table "paper / here", every figure as PNG and its data as CSV.
The paper is Li et al., Sensors 2022, 22(16), 6170. Same seed, same numbers.
"""

from __future__ import annotations

import argparse
from pathlib import Path


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("what", choices=("single-joint", "six-axis", "recovery"), help="which experiments")
    parser.add_argument("--out", type=Path, required=True, help="folder to write")
    parser.add_argument("--seed", type=int, default=0, help="seed of every random draw (default 0)")
    parser.add_argument("--quick", action="store_true", help="single-joint only: fewer repeats, the same pictures")
    parser.add_argument("--seeds", type=int, default=1000, help="recovery only: how many campaigns (default 1000)")
    parser.add_argument("--workers", type=int, default=2, help="recovery only: processes (default 2)")


def run(options: argparse.Namespace) -> int:
    """Run the chosen reproduction; the exit code is 1 where one of its stated bounds is missed."""
    if options.what == "single-joint":
        from jointscope.experiments.single_joint import reproduce_single_joint

        return reproduce_single_joint(options.out, quick=options.quick, seed=options.seed)
    if options.what == "six-axis":
        from jointscope.experiments.six_axis import reproduce_six_axis

        return reproduce_six_axis(options.out, seed=options.seed)
    from jointscope.experiments.recovery import run_recovery

    return run_recovery(options.out, seeds=options.seeds, first_seed=options.seed, workers=options.workers)
