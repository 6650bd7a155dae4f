"""Make a campaign from a lab's own data files: CSV, npz, HDF5, MAT, UFF, TDMS, LVM, ROS bags or MDF.

Lists what each file holds (records, groups, structs; rate, unit label, peak), asks what neither the files nor the
answers say, cuts a continuous record of hammer hits into one run per hit, and writes a campaign.toml in which every
assumption is marked "# GUESSED: why". Nothing in a data file is changed; the files are copied.

ROS bags (extra [ros]: .bag, .mcap, .db3) and MDF files (extra [mdf]: .mf4) hold several clocks on one time axis: each
becomes a stream of one run. A JointState's effort is a torque with one driver and a current with another: say which
(--effort; the UR driver's default is current). --joint picks one joint by its name.

Answers can be given beforehand (--answers), in TOML, keys as in a campaign:

  [rig]
  topology = "two-inertia"
  reduction_ratio = 141.0
  [run]                          # for every run
  experiment = "hammer"
  arm_angle = 0.0
  together = false               # true: all files are devices of one and the same run
  [files."take1.csv"]            # for the runs of one file
  sampling_rate = 2048.0
  take = "sweep-1"               # files with the same take are devices of one run
  [columns.ch1]                  # for a column, in whatever file
  quantity = "force"
  unit = "N"
  location = "arm"
  radius = 0.8
  [columns.temperature]
  ignore = true

examples:
  jointscope new hits.tdms --out bench
  jointscope new take1.csv take2.csv --answers bench.toml --yes --out bench
  jointscope new hits.lvm --list
  jointscope new swing.mcap --joint elbow_joint --effort current --yes --out elbow
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jointscope.errors import JointscopeError
    from jointscope.recordings.draft.records import Record


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("files", metavar="FILES", nargs="+", type=Path, help="data files")
    parser.add_argument("--out", metavar="CAMPAIGN", type=Path, help="directory to make; must not exist yet")
    parser.add_argument("--answers", metavar="TOML", type=Path, help="answers given beforehand")
    parser.add_argument("--rate", metavar="HZ", type=float, help="sampling rate of files that don't say it")
    parser.add_argument("--joint", metavar="NAME", help="of the joints that a file names, only this one")
    parser.add_argument("--effort", choices=("torque", "current"), help="what a ROS JointState's effort is")
    parser.add_argument("--yes", action="store_true", help="ask nothing: guess, and mark the guesses")
    parser.add_argument("--list", action="store_true", help="only list what the files hold")
    parser.add_argument("--json", action="store_true", help="what was found and made, as JSON; asks nothing")


def run(options: argparse.Namespace) -> int:
    """List, ask, write."""
    from jointscope.errors import InputError
    from jointscope.recordings.draft.records import listing, records_of

    options.files = [_data_file(path) for path in options.files]
    records = _of_joint(tuple(record for path in options.files for record in records_of(path)), options.joint)
    if not options.json:
        print("\n".join(listing(records)))
    made = None
    if not options.list:
        if options.out is None:
            raise InputError("--out", None, "missing", fix="name the directory to make, or say --list")
        made = _make(options, records)
    if options.json:
        print(json.dumps({"files": [_record_json(record) for record in records], **(made or {})}, indent=2))
    elif made is not None:
        _report(made, options.out)
    return 0


def _make(options: argparse.Namespace, records: Sequence[Record]) -> dict[str, Any]:
    import shutil

    from jointscope.atomic import new_directory
    from jointscope.errors import InputError, JointscopeError
    from jointscope.recordings.draft.drafting import draft_campaign, read_answers
    from jointscope.recordings.draft.text import draft_text
    from jointscope.recordings.reader import read_campaign

    answers = read_answers(options.answers)
    if options.rate is not None:
        answers["run"] = {"sampling_rate": options.rate, **answers.get("run", {})}
    if options.effort is not None:
        _state_efforts(records, answers, options.effort)
    names = _names(options.files)
    ask = None if options.yes or options.json or not sys.stdin.isatty() else _ask
    rig, runs, unplaced = draft_campaign(records, names, answers, ask)
    if not runs:
        raise InputError(
            options.files[0], None, "no column that could be placed", fix="say what they measure in --answers"
        )
    text = draft_text(str(answers.get("title", options.out.name)), rig, runs, unplaced)
    with new_directory(options.out) as folder:
        for path, name in names.items():
            shutil.copyfile(path, folder / name)
        (folder / "campaign.toml").write_text(text, encoding="utf-8")
        try:
            read_campaign(folder)
        except JointscopeError as problem:
            raise _by_own_names(problem, folder, names) from problem
    return {
        "campaign": str(options.out),
        "runs": [run.keys.values["id"] for run in runs],
        "guesses": text.count("# GUESSED: ") - text.count('"# GUESSED: ...'),
        "unplaced": unplaced,
    }


def _by_own_names(problem: JointscopeError, folder: Path, names: Mapping[Path, str]) -> JointscopeError:
    """The same error, of the user's file and not of its copy in the making."""
    from jointscope.errors import JointscopeError

    text = str(problem)
    for path, name in names.items():
        text = text.replace(str(folder / name), str(path))
    return JointscopeError(text.replace(f"{folder}/", ""))


def _state_efforts(records: Sequence[Record], answers: dict[str, Any], effort: str) -> None:
    """Answer for every effort that no answer speaks of."""
    from jointscope.recordings.draft.drafting import effort_answer
    from jointscope.recordings.files.ros_file import EFFORT

    columns = answers.setdefault("columns", {})
    for record in records:
        for column in record.columns:
            if column.label == EFFORT:
                said = columns.get(column.name, columns.get("effort", {}))
                columns[column.name] = said if "quantity" in said else {**effort_answer(effort), **said}


def _data_file(path: Path) -> Path:
    """The file itself; of a ROS 2 bag's folder the one that it keeps its messages in."""
    from jointscope.errors import InputError

    if path.is_dir() and (path / "metadata.yaml").is_file():
        held = sorted(file for file in path.iterdir() if file.suffix in (".mcap", ".db3"))
        if len(held) == 1:
            return held[0]
        raise InputError(path, None, f"a bag of {len(held)} files", fix="join them with ros2 bag convert")
    if not path.is_file():
        raise InputError(path, None, "no such file")
    return path


def _of_joint(records: Sequence[Record], joint: str | None) -> tuple[Record, ...]:
    """Without the columns of joints other than ``joint``; several joints need the choice."""
    from dataclasses import replace

    from jointscope.errors import InputError

    named = sorted({column.joint for record in records for column in record.columns if column.joint is not None})
    if joint is None and len(named) < 2:
        return tuple(records)
    if joint not in named:
        raise InputError(
            records[0].file, "--joint", "no such joint in the files" if joint else "several joints in the files",
            value=joint, fix=f"name one of {', '.join(named)}" if named else "leave --joint out; no file names joints",
        )  # fmt: skip
    kept = [replace(r, columns=tuple(c for c in r.columns if c.joint in (None, joint))) for r in records]
    return tuple(record for record in kept if record.columns)


def _names(files: Sequence[Path]) -> dict[Path, str]:
    """File names inside the campaign, each once."""
    names: dict[Path, str] = {}
    for path in files:
        name, count = path.name, 1
        while name in names.values():
            count += 1
            name = f"{path.stem}-{count}{path.suffix}"
        names[path] = name
    return names


def _ask(question: str, usual: str) -> str:
    shown = f" [{usual}]" if usual else ""
    try:
        return input(f"{question}{shown} ").strip()
    except EOFError:
        return ""


def _record_json(record: Record) -> dict[str, Any]:
    from jointscope.recordings.draft.records import peak

    return {
        "file": str(record.file),
        "record": record.name,
        "samples": record.length,
        "sampling_rate_hz": record.rate,
        "time": record.time,
        "columns": [{"name": c.name, "unit": c.unit, "peak": peak(c)} for c in record.columns],
    }


def _report(made: dict[str, Any], out: Path) -> None:
    runs = made["runs"]
    print(
        f"\n{out}: {len(runs)} run{'s' if len(runs) > 1 else ''}, {made['guesses']} guesses marked in campaign.toml"
    )
    if made["unplaced"]:
        print(f"left out, because nothing says what they measure: {', '.join(made['unplaced'])}")
    print(f"next: check the lines marked GUESSED, then jointscope inspect {out}")
