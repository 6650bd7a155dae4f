"""The main job in short: the paper's single joint simulated, identified and predicted, and one real recording.

  jointscope demo --out out/demo

Simulates hammer hits, a torque sweep and a motion of the paper's joint through its sensors, identifies stiffness,
inertia and damping from the hits, predicts the vibration of sweep and motion from the motor's torque, and draws the
paper's Figures 8-15 from it. Where the public recordings are at hand (JOINTSCOPE_DATA names their folder), a real
impact test is imported and identified too. Ends by saying where the pictures are.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

RECORDING = "hammer-lvm/long_single_header_multi_ch.lvm"


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("--out", type=Path, default=Path("out/demo"), help="folder to write (default out/demo)")
    parser.add_argument("--seed", type=int, default=0, help="seed of every random draw (default 0)")


def run(options: argparse.Namespace) -> int:
    """Reproduce in short, then identify one real recording."""
    import shutil

    from jointscope.cli import main
    from jointscope.experiments.single_joint import reproduce_single_joint

    code = reproduce_single_joint(options.out / "single-joint", quick=True, seed=options.seed)
    data = Path(os.environ.get("JOINTSCOPE_DATA", "../shared/data"))
    if (data / RECORDING).exists():
        real = options.out / "real-impact-test"
        shutil.rmtree(real, ignore_errors=True)  # a demo may be run again; its folders are its own
        code = max(
            code,
            main(["import", "hammer-lvm", str(data / RECORDING), "--out", str(real / "campaign")]),
            main(["identify", str(real / "campaign"), "--out", str(real / "identification")]),
        )
    else:
        print(f"no public recordings at {data}: set JOINTSCOPE_DATA to their folder to see a real impact test too")
    print(f"\npictures and pages: {options.out.resolve()}")
    for page in sorted((*options.out.rglob("*.html"), *options.out.rglob("README.md"))):
        print(f"  {page}")
    return code
