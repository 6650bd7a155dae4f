"""Write recordings in which an effect is concealed, and seal what it is.

  jointscope conceal --seed 7 --cases 60 --out out/draw
  jointscope conceal --seed 7 --cases 40 --kind nulls --out out/nulls
  jointscope conceal --seed 7 --cases 36 --rig six-axis --out out/arms
  jointscope conceal --seed 7 --cases 64 --engine outside --out out/outside

Each case is a campaign of a rig of its own, simulated in MuJoCo with physics that the plain model lacks (or with none
at all, or with a fault of the recording, or with two effects, or with something no catalogue lists), hidden under
realistic noise. Nothing in a campaign tells which: names, counts, formats and time stamps are alike.

The truth goes into OUT/truth.sealed. Its SHA-256 is printed: write it down before anything is diagnosed.
'jointscope prove OUT' diagnoses every case, checks the hash, opens the seal and scores.

Draws for developing and calibrating a diagnosis differ from those for testing it in seeds, ranges and laws.
'--engine outside' simulates one joint by equations, laws and noise of its own that share nothing with MuJoCo's; its laws
are the same in every draw, and its truth grades cases by how visible they are, not by how distinct.
Run it again with the same words to go on after an interruption; results don't depend on --workers.
"""

from __future__ import annotations

import argparse
import os
from pathlib import Path

KINDS = ("mixed", "singles", "nulls", "pairs", "unlisted", "undecidable")
RIGS = ("single-joint", "six-axis")
ARM_KINDS = ("mixed", "singles", "nulls")
DRAWS = ("development", "calibration", "test")
ENGINES = ("mujoco", "outside")


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("--seed", type=int, required=True, help="of the whole draw")
    parser.add_argument("--cases", type=int, required=True, help="how many campaigns")
    parser.add_argument("--out", type=Path, required=True, help="new folder, or one to go on with")
    parser.add_argument("--kind", choices=KINDS, default="mixed", help="what the cases conceal (default: mixed)")
    parser.add_argument("--rig", choices=RIGS, default="single-joint", help="one joint, or a six-axis arm")
    parser.add_argument("--engine", choices=ENGINES, default="mujoco", help="what simulates it (default: mujoco)")
    parser.add_argument("--draw", choices=DRAWS, default="test", help="whose laws and ranges (default: test)")
    parser.add_argument("--scheduler", default=None, help="Dask scheduler, tcp://host:port, whose workers see OUT")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes (default: all cores)")


def run(options: argparse.Namespace) -> int:
    """Produce the draw and print the seal's hash."""
    if options.engine == "outside":
        return _outside(options)
    if options.rig == "six-axis":
        return _arms(options)
    from jointscope.sim.concealed.draw import Order
    from jointscope.sim.concealed.production import produce

    order = Order(seed=options.seed, cases=options.cases, kind=options.kind, draw=options.draw)
    found = produce(order, options.out, options.workers, options.scheduler)
    print(f"{options.out}: {options.cases} campaigns, their truth sealed in truth.sealed")
    print(f"sha256 {found}")
    return 0


def _arms(options: argparse.Namespace) -> int:
    """A draw of arms, whose truth names the joint."""
    from jointscope.errors import JointscopeError
    from jointscope.sim.concealed.arm_draw import ArmOrder, produce_arms

    if options.kind not in ARM_KINDS:
        raise JointscopeError(f"--kind {options.kind}: of a six-axis arm choose {', '.join(ARM_KINDS)}")
    found = produce_arms(ArmOrder(options.seed, options.cases, options.kind), options.out)
    print(f"{options.out}: {options.cases} campaigns of an arm, their truth sealed in truth.sealed")
    print(f"sha256 {found}")
    return 0


def _outside(options: argparse.Namespace) -> int:
    """A draw of single joints by the second engine."""
    from jointscope.errors import JointscopeError
    from jointscope.sim.outside.intent import SHARES
    from jointscope.sim.outside.production import Order, produce

    if options.rig == "six-axis" or options.scheduler:
        raise JointscopeError("--engine outside: single joints on this machine only; drop --rig and --scheduler")
    if options.kind not in SHARES:
        raise JointscopeError(f"--kind {options.kind}: of the outside engine choose {', '.join(SHARES)}")
    order = Order(seed=options.seed, cases=options.cases, kind=options.kind, draw=options.draw)
    found = produce(order, options.out, options.workers)
    print(f"{options.out}: {options.cases} campaigns of the outside engine, their truth sealed in truth.sealed")
    print(f"sha256 {found}")
    return 0
