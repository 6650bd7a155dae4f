"""Make a campaign of a public data set, from its files as they are published.

An importer writes only what the set's own documentation prints: geometry, ratios, inertias, units, rates. Never a
friction or any other effect: that is for `diagnose` to find. Channels are declared as the files hold them, mistakes
included: that is for `inspect` to find.

data sets:
  emps                      DC motor, ball screw, carriage: DATA_EMPS.mat, DATA_EMPS_PULSES.mat
  hammer-lvm                two hammer hits: long_single_header_multi_ch.lvm
  kr300-weigand2021         six-axis robot, one campaign per axis (--axis 1, 2 or 3): trajectory-{A,B,C}.mat
  motor-bench-flexcoupling  motor, flexible coupling, load: MultisineTypeA.mat, MultisineTypeB.mat

examples:
  jointscope import emps downloads/emps --out emps
  jointscope import kr300-weigand2021 downloads/kr300 --axis 2 --out kr300-axis2
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("name", metavar="NAME", help="the data set")
    parser.add_argument(
        "files", metavar="FILES", nargs="+", type=Path, help="its files, or the folder they are in"
    )
    parser.add_argument("--out", metavar="CAMPAIGN", type=Path, required=True, help="directory to make")
    parser.add_argument("--axis", type=int, help="robot axis, where the set has several")
    parser.add_argument("--json", action="store_true", help="say what was made as JSON")


def run(options: argparse.Namespace) -> int:
    """Write the campaign."""
    from jointscope.recordings.importers import import_data_set
    from jointscope.recordings.reader import read_campaign

    out = import_data_set(options.name, options.files, options.out, axis=options.axis)
    campaign = read_campaign(out)
    if options.json:
        print(
            json.dumps({"campaign": str(out), "title": campaign.title, "runs": [run.id for run in campaign.runs]})
        )
        return 0
    print(f"{out}: {campaign.title}")
    for take in campaign.runs:
        channels = ", ".join(signal.channel.column for signal in take.signals)
        print(f"  {take.id} ({take.experiment}, {take.role or 'no role'}): {channels}")
    print(f"next: jointscope inspect {out}")
    return 0
