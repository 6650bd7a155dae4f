"""How much each parameter of the joint matters to what users care about, with intervals and a sentence of meaning.

  jointscope sensitivity study.toml --out out/sensitivity
  jointscope sensitivity study.toml --out out/sensitivity --scheduler tcp://10.0.0.5:8786    a Dask cluster's workers

A study varies parameters of the paper's joint (or of [nominal]) and watches resonance, anti-resonance, peak
accelerations, band rms, and the prediction error that a wrong parameter causes:

  format  = "jointscope-sensitivity/1"
  method  = "sobol"          # local | morris | sobol
  samples = 1024
  seed    = 0
  engine  = "closed-form"    # or "mujoco"
  [parameters]
  stiffness = { relative = 0.2 }
  damping   = { lower = 20.0, upper = 120.0 }

Writes report.html, sensitivity.json, sensitivity.csv, README.md and pictures. An interrupted study goes on where it stopped;
the numbers are the same for any number of workers.
"""

from __future__ import annotations

import argparse
from pathlib import Path


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("study", type=Path, help="study.toml")
    parser.add_argument("--out", type=Path, required=True, help="folder to write")
    parser.add_argument("--workers", type=int, default=2, help="processes on this machine (default 2)")
    parser.add_argument(
        "--scheduler", help="address of a Dask scheduler, tcp://host:port, or 'local' for one of its own"
    )
    parser.add_argument("--json", action="store_true", help="print sensitivity.json instead of the table")


def run(options: argparse.Namespace) -> int:
    """Evaluate, analyse, draw."""
    from jointscope.experiments.sensitivity.report import run_study

    return run_study(
        options.study, options.out, workers=options.workers, scheduler=options.scheduler, as_json=options.json
    )
