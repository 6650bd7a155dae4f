"""What changed between two results: every figure against its interval, verdicts, effects, held-out errors.

Takes two folders (or files) written by identify, predict, diagnose, confirm, sensitivity, prove or gate; what each
holds is recognised by the format that its JSON states. Shown per figure: old, new, their difference with its 95 %
interval, and whether that interval leaves out zero ("significant"). The two are taken as independent, which is
cautious for two results of the same recordings; errors on the same runs are paired, cases of one sealed draw too.
Then what is said: verdicts, effects that came or went, findings, refusals, the status of gates.

  old   the result before
  new   the result after

examples:
  jointscope compare out/identify-march out/identify-april
  jointscope compare out/diagnosis out/diagnosis-repaired --out out/compare     compare.html and compare.json too
  jointscope compare a b --json | jq '.comparisons[].figures[] | select(.judgement == "significant")'
"""

from __future__ import annotations

import argparse
from pathlib import Path


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("old", metavar="DIR_A", type=Path, help="folder with the earlier result")
    parser.add_argument("new", metavar="DIR_B", type=Path, help="folder with the later result, of the same kind")
    parser.add_argument("--out", metavar="DIR", type=Path, help="write compare.html and compare.json there")
    parser.add_argument("--json", action="store_true", help="print compare.json instead of the text")


def run(options: argparse.Namespace) -> int:
    """Read, compare, show."""
    import json

    from jointscope.atomic import write_text
    from jointscope.experiments.comparison.change import compare
    from jointscope.experiments.comparison.reading import read_pair
    from jointscope.experiments.comparison.report import as_json, as_page, as_text

    found = [compare(old, new) for old, new in read_pair(options.old, options.new)]
    text = json.dumps(as_json(found), indent=1, ensure_ascii=False, allow_nan=False) + "\n"
    if options.out is not None:
        write_text(options.out / "compare.json", text)
        write_text(options.out / "compare.html", as_page(found))
    print(text if options.json else "\n".join(as_text(one) for one in found), end="")
    return 0
