"""Reproduce the paper's experiments without hardware, and the project's own proofs, beside the published numbers.

  jointscope reproduce single-joint --out out/single   sections 2-3: Figures 8-15, Tables 1-2, Equation (26)
  jointscope reproduce six-axis --out out/six          section 4: Figures 17-23, Tables 3-4, Equation (27)
  jointscope reproduce recovery --out out/recovery     bias, coverage and scatter of the identification, 1000 seeds
  jointscope reproduce mismatches --out out/mismatches the paper's stated mismatches, each with a concealed cause, diagnosed
  jointscope reproduce hardness --out out/hardness     the concealed cases' discriminability against full refits

Each writes report.html and the same as Markdown (README.md) with a table "paper / here", every figure as PNG and its
data as CSV.
The paper is Li et al., Sensors 2022, 22(16), 6170. Same seed, same numbers.
"""

from __future__ import annotations

import argparse
from pathlib import Path

EXPERIMENTS = ("single-joint", "six-axis", "recovery", "mismatches", "hardness")


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("what", choices=EXPERIMENTS, help="which experiments")
    parser.add_argument("--out", type=Path, required=True, help="folder to write")
    parser.add_argument("--seed", type=int, default=0, help="seed of every random draw (default 0)")
    parser.add_argument("--quick", action="store_true", help="single-joint, mismatches: fewer repeats")
    parser.add_argument("--seeds", type=int, default=1000, help="recovery only: how many campaigns (default 1000)")
    parser.add_argument("--cases", type=int, default=30, help="hardness only: how many cases (default 30)")
    parser.add_argument("--workers", type=int, default=2, help="recovery, hardness: processes (default 2)")


def run(options: argparse.Namespace) -> int:
    """Run the chosen reproduction; the exit code is 1 where one of its stated bounds is missed."""
    code = _reproduced(options)
    _report(options)
    return code


def _reproduced(options: argparse.Namespace) -> int:
    if options.what == "single-joint":
        from jointscope.experiments.single_joint import reproduce_single_joint

        return reproduce_single_joint(options.out, quick=options.quick, seed=options.seed)
    if options.what == "six-axis":
        from jointscope.experiments.six_axis import reproduce_six_axis

        return reproduce_six_axis(options.out, seed=options.seed)
    if options.what == "mismatches":
        from jointscope.experiments.mismatches import reproduce_mismatches

        return reproduce_mismatches(options.out, quick=options.quick, seed=options.seed)
    if options.what == "hardness":
        from jointscope.experiments.prove.hardness import check_hardness

        return check_hardness(options.out, cases=options.cases, first_seed=options.seed, workers=options.workers)
    from jointscope.experiments.recovery import run_recovery

    return run_recovery(options.out, seeds=options.seeds, first_seed=options.seed, workers=options.workers)


def _report(options: argparse.Namespace) -> None:
    """``report.html`` from the Markdown page and the results beside it."""
    import json

    from jointscope.experiments import first_screens
    from jointscope.experiments.markdown_report import write_markdown_report
    from jointscope.experiments.provenance import provenance_section

    source = options.out / "README.md"
    if not source.is_file():
        return
    words = f"jointscope reproduce {options.what} --out {options.out.resolve().name} --seed {options.seed}"
    words += " --quick" if options.quick else ""
    if options.what == "single-joint":
        first = first_screens.single_joint(json.loads((options.out / "results.json").read_text(encoding="utf-8")))
    else:
        first = first_screens.claims(source.read_text(encoding="utf-8"))
    path = write_markdown_report(source, first, provenance_section(None, words, seed=options.seed))
    print(f"report: {path}")
