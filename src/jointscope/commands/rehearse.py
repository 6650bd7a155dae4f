"""Rehearse a diagnosis on your own rig: which effects would be seen, and named right, with the recordings you have.

  jointscope rehearse bench-a --out out/rehearsal
  jointscope rehearse bench-a --out out/rehearsal --effects backlash coulomb-friction@motor --repeats 5

The campaign is diagnosed once for the rig's parameters and the noise of every channel. Then the same runs, with the same
levels, rates and channels, are simulated in MuJoCo with one effect concealed at a time, and once with none. The concealed
laws share no code with the diagnosis. Each effect has a few times the size that should just show (not_seen in
diagnosis.json; --size changes how many times). Every rehearsal is diagnosed blind, in a process of its own; run the same
words again to go on after an interruption.

DIR holds
  rehearsal.md     the confusion table "on your recordings", and rehearsal.png
  rehearsal.json   the same for machines, with every case
  cases/           the rehearsed campaigns; answers/ their diagnoses
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("campaign", type=Path, help="folder with campaign.toml")
    parser.add_argument("--out", type=Path, required=True, help="folder to write, or one to go on with")
    parser.add_argument(
        "--effects",
        nargs="+",
        default=None,
        metavar="NAME",
        help="effect or effect@location (default: all that fit)",
    )
    parser.add_argument("--repeats", type=int, default=1, help="rehearsals of each effect (default: 1)")
    parser.add_argument(
        "--size", type=float, default=4.0, help="concealed size over the smallest visible one (default: 4)"
    )
    parser.add_argument("--seed", type=int, default=1, help="of noise and shapes")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes (default: all cores)")
    parser.add_argument("--seconds", type=float, default=300.0, help="time limit of one diagnosis (default: 300)")
    parser.add_argument("--json", action="store_true", help="print rehearsal.json instead of the table")


def run(options: argparse.Namespace) -> int:
    """Rehearse; the exit code is 0 whatever came of it."""
    import json

    from jointscope.experiments.rehearsal.page import text, write_page
    from jointscope.experiments.rehearsal.rehearse import rehearse

    summary = rehearse(
        options.campaign,
        options.out,
        effects=options.effects,
        repeats=options.repeats,
        seed=options.seed,
        workers=options.workers,
        limit=options.seconds,
        size=options.size,
    )
    write_page(summary, options.out)
    print(json.dumps(summary, indent=1) if options.json else text(summary), end="\n" if options.json else "")
    if not options.json:
        print(f"written to {options.out}")
    return 0
