"""Accuracy gates: measure every claim of a gates file anew and fail where one does not hold.

  jointscope gate gates.toml --out out/gates

A gates file lists claims, each measured by a command of this tool:

  format = "jointscope-gates/1"
  [[gate]]
  claim    = "stiffness within 1 % on the reference campaign"
  measure  = "identify"                    # selfcheck | identify | inspect | diagnose | confirm | predict | result | command
  campaign = "campaigns/reference"         # relative to this file
  figure   = "parameters.stiffness.value"  # a path in the JSON that the command prints with --json
  target   = 193665.0
  within   = 0.01                          # or: below, above, equals, covers

Your own simulator against your own recording (an MJCF, and map.toml where its joints aren't to be guessed):

  [[gate]]
  claim    = "the simulator predicts the sweeps within 1 dB in 10-75 Hz"
  measure  = "predict"
  model    = "robot.xml"
  map      = "map.toml"
  campaign = "campaigns/bench"
  band     = [10, 75]                      # Hz
  figure   = "runs.[experiment=torque-sweep].channels.acceleration.bands.[low_hz=10].error_95_db"
  below    = 1.0

In a figure's path * is every entry, [key=value] every table with that value, # the number of entries; where several
figures are meant, each must keep the bound. Recordings that are made and not kept:

  [[make]]
  name    = "bench"
  command = "simulate single-joint --seed 1 --out {made}/bench"

and {made}/bench in any path of a gate. A data set that is not everywhere is a place, {data}, with optional = true:

  [places]
  data = { environment = "JOINTSCOPE_DATA", folder = "../shared/data" }

Every gate ends as PASS, FAIL or NOT-TESTED with its figure, bound and margin. The exit code is 0 only when all hold and
at least one was tested; only an optional gate whose material is absent may stay untested.
DIR holds gates.json, junit.xml, summary.md, and in made/ what was made.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jointscope.experiments.gates.claims import Gate, GatesFile, Make


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("gates", type=Path, help="gates.toml")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    parser.add_argument(
        "--group", action="append", metavar="NAME", help="only claims of this group; may be repeated"
    )
    parser.add_argument(
        "--reuse", action="append", metavar="NAME", help="keep what an earlier call made; may be repeated"
    )
    parser.add_argument("--json", action="store_true", help="print gates.json instead of the table")


def run(options: argparse.Namespace) -> int:
    """Make, measure, judge, write; 1 where a claim does not hold."""
    from jointscope.atomic import write_text
    from jointscope.errors import InputError
    from jointscope.experiments.gates.claims import read_gates
    from jointscope.experiments.gates.judge import run_gate, verdict
    from jointscope.experiments.gates.reports import as_json, as_junit, as_markdown
    from jointscope.progress import track

    file = read_gates(options.gates)
    gates = tuple(gate for gate in file.gates if not options.group or gate.group in options.group)
    for name in options.group or ():
        if name not in {gate.group for gate in file.gates}:
            raise InputError(options.gates, "--group", "no claim has that group", value=name)
    made = (options.out / "made").resolve()
    needed = file.needed(gates)
    unmade: dict[str, str | None] = {}
    for make in track(needed, "making", len(needed)):
        if make.name not in (options.reuse or ()) or not (made / make.name).exists():
            _make(file, make, made, unmade)
    documents: dict[tuple[object, ...], dict[str, Any]] = {}

    def measured(gate: Gate) -> dict[str, Any]:
        key = (
            gate.measure,
            gate.campaign,
            gate.model,
            gate.map,
            gate.diagnosis,
            gate.file,
            gate.command,
            gate.band,
        )
        if key not in documents:
            documents[key] = _measure(file, gate, made)
        return documents[key]

    outcomes = tuple(run_gate(gate, file, made, measured, unmade) for gate in track(gates, "gates", len(gates)))
    write_text(options.out / "gates.json", as_json(outcomes) + "\n")
    write_text(options.out / "junit.xml", as_junit(outcomes))
    write_text(options.out / "summary.md", as_markdown(outcomes))
    print(as_json(outcomes) if options.json else as_markdown(outcomes))
    return 0 if verdict(outcomes) else 1


def _make(file: GatesFile, make: Make, made: Path, unmade: dict[str, str | None]) -> None:
    """Make one thing anew; why it couldn't be goes into ``unmade``."""
    import shutil

    from jointscope.errors import JointscopeError
    from jointscope.experiments.gates.claims import MADE

    before = [name for name in MADE.findall(" ".join(make.command)) if name in unmade]
    if before:
        unmade[make.name] = unmade[before[0]] and f"{before[0]}: {unmade[before[0]]}"
        return
    if make.needs is not None and not file.path(make.needs, made).exists():
        unmade[make.name] = None
        return
    if (made / make.name).exists():  # an earlier call's
        shutil.rmtree(made / make.name)
    try:
        _call([file.resolve(word, made) for word in make.command], file.folder)
    except JointscopeError as problem:
        unmade[make.name] = str(problem)
    except Exception as problem:  # what crashed makes its claims red, and the others are still measured
        unmade[make.name] = f"crashed: {type(problem).__name__}: {problem}"


def _measure(file: GatesFile, gate: Gate, made: Path) -> dict[str, Any]:
    """The JSON that holds the gate's figure."""
    import json
    import tempfile

    from jointscope.errors import InputError

    if gate.measure == "result":
        path = file.path(str(gate.file), made)
        try:
            return dict(json.loads(path.read_text(encoding="utf-8")))
        except ValueError as problem:
            raise InputError(path, None, f"not a JSON table: {problem}") from None
    with tempfile.TemporaryDirectory() as scratch:
        if gate.measure == "command":
            words = [file.resolve(word, made) for word in gate.command or ()]
        else:
            paths = [getattr(gate, key) for key in ("model", "campaign", "diagnosis")]
            words = [gate.measure, *(str(file.path(text, made)) for text in paths if text is not None)]
            if gate.measure in ("identify", "predict", "diagnose"):
                words += ["--out", str(Path(scratch) / "result")]
            if gate.map is not None:
                words += ["--map", str(file.path(gate.map, made))]
            if gate.band is not None:
                words += ["--band", *(f"{end!r}" for end in gate.band)]
            if gate.measure in ("identify", "predict"):
                words.append("--no-pictures")
        return dict(json.loads(_call([*words, "--json"] if "--json" not in words else words, file.folder)))


def _call(words: list[str], folder: Path) -> str:
    """What a command of this tool prints, run with the gates file's folder as the current one.

    Raises:
        JointscopeError: It ended with anything but its own yes (0) or no (1).
    """
    import contextlib
    import io

    from jointscope.cli import main
    from jointscope.errors import JointscopeError

    said, complaint = io.StringIO(), io.StringIO()
    with contextlib.chdir(folder), contextlib.redirect_stdout(said), contextlib.redirect_stderr(complaint):
        try:
            code = main(words)
        except SystemExit as problem:  # argparse's way of refusing words
            code = problem.code if isinstance(problem.code, int) else 2
    if code == 130:
        raise KeyboardInterrupt
    if code not in (0, 1):
        lines = complaint.getvalue().strip().splitlines()
        raise JointscopeError(lines[-1] if lines else f"{' '.join(words)}: exit code {code}")
    return said.getvalue()
