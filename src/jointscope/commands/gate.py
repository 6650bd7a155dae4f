"""Accuracy gates: measure every claim of a gates file anew and fail where one does not hold.

  jointscope gate gates.toml --out out/gates

A gates file lists claims, each measured by a command of this tool:

  format = "jointscope-gates/1"
  [[gate]]
  claim    = "stiffness within 1 % on the reference campaign"
  measure  = "identify"                    # selfcheck | identify | predict | diagnose | inspect | result
  campaign = "campaigns/reference"         # relative to this file
  figure   = "parameters.stiffness.value"  # a path in the JSON that the command writes
  target   = 193665.0
  within   = 0.01                          # or: below, above, equals, covers

Every gate ends as PASS, FAIL or NOT-TESTED with its figure, bound and margin. The exit code is 0 only when all hold;
a file that tested nothing fails. Writes gates.json, junit.xml and summary.md.
"""

from __future__ import annotations

import argparse
from pathlib import Path


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    parser.add_argument("gates", type=Path, help="gates.toml")
    parser.add_argument("--out", type=Path, required=True, help="folder to write")
    parser.add_argument("--json", action="store_true", help="print gates.json instead of the table")


def run(options: argparse.Namespace) -> int:
    """Measure, judge, write; 1 where a claim does not hold."""
    import contextlib
    import io
    import json
    import tempfile
    from typing import Any

    from jointscope.atomic import write_text
    from jointscope.cli import main
    from jointscope.errors import JointscopeError
    from jointscope.experiments.gates.claims import Gate, read_gates
    from jointscope.experiments.gates.judge import run_gate, verdict
    from jointscope.experiments.gates.reports import as_json, as_junit, as_markdown
    from jointscope.progress import track

    folder = options.gates.parent
    gates = read_gates(options.gates)
    documents: dict[tuple[str | None, ...], dict[str, Any]] = {}

    def measured(gate: Gate) -> dict[str, Any]:
        key = (gate.measure, gate.campaign, gate.model, gate.file)
        if key not in documents:
            documents[key] = _measure(gate)
        return documents[key]

    def _measure(gate: Gate) -> dict[str, Any]:
        if gate.measure == "result":
            return dict(json.loads((folder / str(gate.file)).read_text(encoding="utf-8")))
        with tempfile.TemporaryDirectory() as scratch:
            words: list[str] = [gate.measure]
            if gate.model is not None:
                words.append(str(folder / gate.model))
            if gate.campaign is not None:
                words.append(str(folder / gate.campaign))
            if gate.measure not in ("selfcheck", "inspect"):
                words += ["--out", str(Path(scratch) / "result")]
            said, complaint = io.StringIO(), io.StringIO()
            with contextlib.redirect_stdout(said), contextlib.redirect_stderr(complaint):
                code = main([*words, "--json"])
            if code not in (0, 1):
                raise JointscopeError(complaint.getvalue().strip().splitlines()[-1])
            return dict(json.loads(said.getvalue()))

    outcomes = tuple(run_gate(gate, folder, measured) for gate in track(gates, "gates", len(gates)))
    write_text(options.out / "gates.json", as_json(outcomes) + "\n")
    write_text(options.out / "junit.xml", as_junit(outcomes))
    write_text(options.out / "summary.md", as_markdown(outcomes))
    print(as_json(outcomes) if options.json else as_markdown(outcomes))
    return 0 if verdict(outcomes) else 1
