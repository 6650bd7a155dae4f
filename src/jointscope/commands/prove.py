"""Diagnose recordings in which effects are concealed, then open the seal and score the answers.

  jointscope conceal --seed 7 --cases 60 --out out/draw
  jointscope prove out/draw --out out/proof
  jointscope prove out/draw --out out/proof --scheduler tcp://10.0.0.5:8786
  jointscope prove out/draw --out out/proof --page docs/proof.md
  jointscope prove real --data recordings --out out/real

Every campaign of the draw is diagnosed by 'jointscope diagnose' in a process of its own, on a copy away from the
seal. Only then is the seal opened, after its SHA-256 was compared with the one at the start; a changed seal or
campaign is refused. Crashes and time-outs count as wrong. Run it again with the same words to go on after an
interruption: finished cases are kept.

OUT holds
  report.html    the same to open in a browser, in one file
  proof.md       the table of measures with 95 % intervals, wrong answers, pictures
  summary.json   the same for machines
  judged.json    every case: what was true, what was said
  answers/       every diagnosis

With --calibrate the map from stated to true probabilities is learnt from these answers, and from those of further
finished proofs (--beside), and written; the diagnosis reads the one that was installed as
jointscope/diagnosis/calibration.json. Nothing is learnt from a test draw, unless it is named as spent (--spent): opened,
and looked into by development since. Its answers were given before that, so their share of right ones is that of fresh
cases; it is a test of nothing any more.

  jointscope conceal --seed 11 --cases 300 --draw calibration --out out/calibration
  jointscope prove out/calibration --calibrate diagnosis/calibration.json --beside out/outside-proof

With the word 'real' in place of a draw, and --data, every public set of recordings that is below DATA (one folder per
set, named as 'jointscope import' names it) is diagnosed as it is, in other units, at half the rate, begun later, with an
output upside down, and with the friction that was found taken off the logged force, which must leave nothing to find.
Sets that are not there are reported as absent. OUT holds real.md with a picture, real.json, the campaigns and answers.

How often the seal has been opened, and on how many different sets of answers, is counted beside it and printed on
the page. --page writes that page elsewhere, pictures and summary.json in a folder of the page's name beside it; where
OUT holds a finished proof of this draw, it is made from that alone: nothing is diagnosed and no seal is opened.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    parser.add_argument("draw", type=Path, help="folder written by 'jointscope conceal', or the word real")
    parser.add_argument(
        "--data", type=Path, default=None, metavar="DIR", help="public recordings, with the word real"
    )
    parser.add_argument("--out", type=Path, default=None, help="results (default: DRAW with '-proof' added)")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1, help="processes (default: all cores)")
    parser.add_argument("--limit", type=int, default=None, metavar="K", help="only the first K cases")
    parser.add_argument("--seconds", type=float, default=300.0, help="time limit of one case (default: 300)")
    parser.add_argument(
        "--scheduler", default=None, help="Dask scheduler, tcp://host:port, whose workers see DRAW"
    )
    parser.add_argument(
        "--calibrate",
        type=Path,
        default=None,
        metavar="FILE",
        help="learn the probability map and write it to FILE",
    )
    parser.add_argument(
        "--beside",
        type=Path,
        nargs="+",
        default=[],
        metavar="PROOF",
        help="proofs that --calibrate learns from too",
    )
    parser.add_argument(
        "--spent",
        type=Path,
        nargs="+",
        default=[],
        metavar="PROOF",
        help="proofs of test draws that were opened before: --calibrate learns from them too",
    )
    parser.add_argument("--page", type=Path, default=None, metavar="FILE.md", help="write the page here as well")
    parser.add_argument("--json", action="store_true", help="print summary.json instead of the table")


def run(options: argparse.Namespace) -> int:
    """Prove; the exit code is 0 whatever the score."""
    import json

    from jointscope.errors import InputError

    for option in ("beside", "spent"):
        if getattr(options, option) and options.calibrate is None:
            raise InputError("prove", f"--{option}", "belongs to --calibrate", fix="say --calibrate FILE too")
    if options.draw == Path("real") and (options.data is not None or not options.draw.is_dir()):
        _refuse(options, ("calibrate", "page", "limit", "scheduler"), "recordings of others")
        return _real(options)

    from jointscope.experiments.prove import page
    from jointscope.experiments.prove.arms import is_arm_draw
    from jointscope.experiments.prove.proof import prove, publish, saved

    folder = Path(options.draw)
    out = options.out or folder.with_name(folder.name + "-proof")
    if is_arm_draw(folder):
        _refuse(options, ("calibrate", "page", "scheduler"), "draws of arms")
        return _arms(options, folder, out)
    summary = saved(folder, out) if options.page else None
    if summary is None:
        summary = prove(
            folder, out, workers=options.workers, limit=options.seconds, first=options.limit,
            scheduler=options.scheduler,
        )  # fmt: skip
    if options.page:
        publish(summary, options.page)
    _report(summary, folder, out)
    if options.calibrate is not None:
        _calibrate([out, *options.beside], options.calibrate, options.spent)
    if options.json:
        print(json.dumps(summary, indent=1, sort_keys=True))
        return 0
    print(f"seal {summary['seal']}, opened {summary['openings']['times']} time(s); {summary['cases']} cases")
    for row in summary["table"]:
        print(f"  {row['name']:<90} {page.shown(row)}")
    print(f"{options.page or out / 'proof.md'}")
    return 0


def _refuse(options: argparse.Namespace, names: Sequence[str], what: str) -> None:
    """No option is read and not used."""
    from jointscope.errors import InputError

    for name in names:
        if getattr(options, name) is not None:
            raise InputError(options.draw, f"--{name}", f"is not for {what}", fix="leave it out")


def _calibrate(proofs: Sequence[Path], file: Path, spent: Sequence[Path]) -> None:
    """Learn the map; what it is worth goes to standard error, beside a summary that machines read."""
    import sys

    from jointscope.experiments.prove.calibrate import learn_map

    learnt = learn_map(proofs, file, spent)
    error = learnt["calibration_error"]
    print(
        f"{file}: learnt on {learnt['cases']} answers; calibration error {error['stated']:.3f} as stated, "
        f"{error['mapped, cross-validated']:.3f} mapped, on cases that the map was not fitted to",
        file=sys.stderr,
    )


def _real(options: argparse.Namespace) -> int:
    """The public recordings; the exit code is 0 whatever the score."""
    from jointscope.errors import InputError
    from jointscope.experiments.prove.real import prove_real

    if options.data is None:
        raise InputError("real", "--data", "is missing", fix="say where the public recordings are: --data DIR")
    out = options.out or Path("real-proof")
    summary = prove_real(options.data, out, workers=options.workers, limit=options.seconds)
    if options.json:
        print((out / "real.json").read_text(encoding="utf-8"), end="")
        return 0
    for row in summary["sets"]:
        said = ", ".join(f"{e['effect']}@{e['location']}" for e in row.get("effects", [])) or "-"
        met = sum(check["met"] for check in row.get("checks", []))
        shown = (
            f"{row['verdict']}: {said}; {met} of {len(row['checks'])} met" if "verdict" in row else row["status"]
        )
        print(f"  {row['set']:<14} {shown}")
    print(f"{out / 'real.md'}")
    return 0


def _arms(options: argparse.Namespace, folder: Path, out: Path) -> int:
    """A draw of arms has a table of its own."""
    import json

    from jointscope.experiments.prove.arms import prove_arms, shown

    summary = prove_arms(folder, out, workers=options.workers, limit=options.seconds, first=options.limit)
    if options.json:
        print(json.dumps(summary, indent=1, sort_keys=True))
        return 0
    for row in summary["table"]:
        print(f"  {row['name']:<50} {shown(row)}")
    print(f"{out / 'proof.md'}")
    return 0


def _report(summary: dict[str, Any], folder: Path, out: Path) -> None:
    """``report.html`` beside proof.md."""
    from jointscope.experiments.first_screens import proof
    from jointscope.experiments.markdown_report import write_markdown_report
    from jointscope.experiments.provenance import provenance_section

    words = f"jointscope prove {folder.resolve().name} --out {out.resolve().name}"
    source = provenance_section(None, words, seed=summary["seed"], further=(("seal", str(summary["seal"])),))
    write_markdown_report(out / "proof.md", proof(summary), source)
