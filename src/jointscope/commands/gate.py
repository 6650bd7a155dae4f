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
    from collections.abc import Hashable
    from concurrent.futures import Future

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
    parser.add_argument(
        "--workers", type=int, default=1, metavar="N", help="processes that make and measure (default: 1)"
    )
    parser.add_argument("--json", action="store_true", help="print gates.json instead of the table")


def run(options: argparse.Namespace) -> int:
    """Make, measure, judge, write; 1 where a claim does not hold."""
    from jointscope.atomic import write_text
    from jointscope.errors import InputError
    from jointscope.experiments.gates.claims import read_gates
    from jointscope.experiments.gates.judge import run_gate, verdict
    from jointscope.experiments.gates.reports import as_json, as_junit, as_markdown

    file = read_gates(options.gates)
    gates = tuple(gate for gate in file.gates if not options.group or gate.group in options.group)
    for name in options.group or ():
        if name not in {gate.group for gate in file.gates}:
            raise InputError(options.gates, "--group", "no claim has that group", value=name)
    if options.workers < 1:
        raise InputError(options.gates, "--workers", "must be at least 1", value=options.workers)
    made = (options.out / "made").resolve()
    done = _done(file, gates, made, frozenset(options.reuse or ()), options.workers)
    unmade = _unmade(file, file.needed(gates), made, done)
    counted: set[Hashable] = set()

    def measured(gate: Gate) -> tuple[dict[str, Any], float]:
        found, seconds = done[_document(gate)].result()
        first = _document(gate) not in counted
        counted.add(_document(gate))
        return found, seconds if first else 0.0

    outcomes = tuple(run_gate(gate, file, made, measured, unmade) for gate in gates)
    write_text(options.out / "gates.json", as_json(outcomes) + "\n")
    write_text(options.out / "junit.xml", as_junit(outcomes))
    write_text(options.out / "summary.md", as_markdown(outcomes))
    print(as_json(outcomes) if options.json else as_markdown(outcomes))
    return 0 if verdict(outcomes) else 1


def _document(gate: Gate) -> Hashable:
    """What gates whose figures stand in one JSON have in common."""
    return gate.measure, gate.campaign, gate.model, gate.map, gate.diagnosis, gate.file, gate.command, gate.band


def _done(
    file: GatesFile, gates: tuple[Gate, ...], made: Path, reuse: frozenset[str], workers: int
) -> dict[Hashable, Future[Any]]:
    """All that is made, by its name, and all that is measured, by its document."""
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor

    from jointscope.experiments.gates.claims import MADE, made_names
    from jointscope.experiments.gates.schedule import Piece, in_turn
    from jointscope.progress import track

    makes = [
        Piece(
            name=make.name,
            call=(_make, (file, make, made)),
            after=frozenset(MADE.findall(" ".join(make.command))) - {make.name},
        )
        for make in file.needed(gates)
        if make.name not in reuse or not (made / make.name).exists()
    ]
    documents = {_document(gate): (gate.measure != "diagnose", gate) for gate in gates}
    measures = [
        (late, Piece(name=name, call=(_timed, (file, gate, made)), after=frozenset(made_names(gate))))
        for name, (late, gate) in documents.items()
    ]
    # what takes longest begins as soon as it can
    pieces = [piece for late, piece in measures if not late] + makes + [piece for late, piece in measures if late]
    done: dict[Hashable, Future[Any]] = {}
    pool = ProcessPoolExecutor(workers, mp_context=multiprocessing.get_context("spawn"))
    try:
        for _ in track(in_turn(pieces, pool, workers, done), "made and measured", len(pieces)):
            pass
    finally:
        pool.shutdown(cancel_futures=True)
    return done


def _unmade(
    file: GatesFile, needed: tuple[Make, ...], made: Path, done: dict[Hashable, Future[Any]]
) -> dict[str, str | None]:
    """Why something could not be made, by its name; ``None`` where its own needs are absent."""
    from jointscope.experiments.gates.claims import MADE

    unmade: dict[str, str | None] = {}
    for make in needed:
        before = [name for name in MADE.findall(" ".join(make.command)) if name in unmade]
        if before:
            unmade[make.name] = unmade[before[0]] and f"{before[0]}: {unmade[before[0]]}"
        elif make.needs is not None and not file.path(make.needs, made).exists():
            unmade[make.name] = None
        elif make.name in done and (why := _why(done[make.name])) is not None:
            unmade[make.name] = why
    return unmade


def _why(making: Future[str | None]) -> str | None:
    """What went wrong in a making, a worker's death included."""
    try:
        return making.result()
    except Exception as problem:  # what crashed makes its claims red, and the others are still measured
        return f"crashed: {type(problem).__name__}: {problem}"


def _make(file: GatesFile, make: Make, made: Path) -> str | None:
    """Make one thing anew; why it couldn't be."""
    import shutil

    from jointscope.errors import JointscopeError

    if (made / make.name).exists():  # an earlier call's
        shutil.rmtree(made / make.name)
    if make.needs is not None and not file.path(make.needs, made).exists():
        return f"{make.needs} does not exist"
    try:
        _call([file.resolve(word, made) for word in make.command], file.folder)
    except JointscopeError as problem:
        return str(problem)
    return None


def _timed(file: GatesFile, gate: Gate, made: Path) -> tuple[dict[str, Any], float]:
    """:func:`_measure` and the time it took [s]."""
    import time

    began = time.monotonic()
    return _measure(file, gate, made), time.monotonic() - began


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
