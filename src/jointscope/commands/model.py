"""Check your own simulation against a campaign, and say which joint is which.

  jointscope model map robot.xml CAMPAIGN --out map.toml

Finds the joints of your MJCF (rigid, rotor and reducer on one axis, or a rotor tied to the link by a tendon), with their
actuator, side, sign and ratio, and writes a commented map.toml to correct and keep. Prints for each joint the load
inertia, the holding torque, the reflected armature and the stiffness that MuJoCo and Pinocchio get beside the campaign's
nameplate. A ratio near n, n^2, -1, 2 pi, 180/pi or sqrt 2 is named as the likely mistake: nothing is corrected silently.
The map then goes with your model into diagnose (whose error it is, and a patch of your file) and predict:

  jointscope diagnose CAMPAIGN --model robot.xml --map map.toml --out DIR
  jointscope predict robot.xml CAMPAIGN --map map.toml --out DIR

For predict a rigid joint needs a reducer first: jointscope arm build --help. docs/your-own-model.md has the map's keys.
"""

from __future__ import annotations

import argparse
from pathlib import Path


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    mapping = actions.add_parser("map", help="write a map.toml and compare the model with the nameplate")
    mapping.add_argument("model", type=Path, help="your MJCF")
    mapping.add_argument("campaign", type=Path, help="folder with campaign.toml")
    mapping.add_argument("--out", type=Path, default=Path("map.toml"), help="map to write (default map.toml)")
    mapping.add_argument("--map", type=Path, default=None, help="compare with this map instead of guessing one")
    mapping.add_argument("--json", action="store_true", help="for machines")


def run(options: argparse.Namespace) -> int:
    """Map and compare; the exit code is 1 where a likely mistake was found."""
    import json
    from dataclasses import asdict, replace

    from jointscope.prediction.arm_comparison import compare
    from jointscope.prediction.arm_guess import guess_map
    from jointscope.prediction.arm_map import read_map, write_map
    from jointscope.recordings.reader import read_campaign

    campaign = read_campaign(options.campaign, missing_outputs="allow")
    if options.map is None:
        found = guess_map(options.model, campaign)
    else:
        found = replace(read_map(options.map), model=options.model.resolve())
    rows = compare(found, campaign)
    if options.map is None:
        write_map(options.out, found, rows)
    if options.json:
        print(json.dumps([asdict(row) for row in rows], indent=2))
        return int(any(row.verdict for row in rows))
    print(f"{'joint':22s} {'figure':20s} {'MuJoCo':>12s} {'Pinocchio':>12s} {'campaign':>12s}  unit")
    for row in rows:
        shown = ["" if v is None else f"{v:.6g}" for v in (row.mujoco, row.pinocchio, row.nameplate)]
        name = row.joint or found.joints[0].link
        print(f"{name[:22]:22s} {row.figure:20s} {shown[0]:>12s} {shown[1]:>12s} {shown[2]:>12s}  {row.unit}")
        if row.verdict:
            print(f"{'':22s} -> {row.verdict}")
    if options.map is None:
        print(f"{options.out}: every line is a guess until you have read it")
    return int(any(row.verdict for row in rows))
