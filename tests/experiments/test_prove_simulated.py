"""The check of ``diagnose --simulated``: both sides of a case alike but for what is meant, and what counts as right."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from jointscope.experiments.prove.simulated_check import KINDS, OFF, STATED, is_right, write_sides
from jointscope.recordings.reader import read_campaign

EXACT = {STATED[name]: float(np.exp(change)) for name, change in OFF.items()}


@pytest.mark.parametrize("kind", ["same", "parameters"])
def test_sides_differ_by_noise_alone_where_the_simulator_is_the_machine(kind: str, tmp_path: Path) -> None:
    _, effect = write_sides(KINDS.index(kind), kind, tmp_path)
    recorded, simulated = (read_campaign(tmp_path / side) for side in ("recorded", "simulated"))
    assert effect == ""
    assert [run.id for run in recorded.runs] == [run.id for run in simulated.runs]
    apart = []
    for one, other in zip(recorded.runs, simulated.runs, strict=True):
        for signal, made in zip(
            one.select("linear-acceleration", location="arm", role="output"),
            other.select("linear-acceleration", location="arm", role="output"),
            strict=True,
        ):
            apart.append(np.std(signal.samples - made.samples) / np.std(signal.samples))
    assert apart
    if kind == "same":
        assert np.median(apart) < 0.1
    else:
        assert np.median(apart) > 0.2


@pytest.mark.parametrize(
    ("kind", "left_out", "contradicted", "ratios", "right"),
    [
        ("same", (), (), {}, True),
        ("same", (), (), {"stiffness": 1.1}, False),
        ("same", ("delay@acquisition",), (), {}, False),
        ("parameters", (), (), EXACT, True),
        ("parameters", (), (), {"stiffness": EXACT["stiffness"]}, False),
        ("parameters", (), (), {**EXACT, "stiffness": 1.05}, False),
        ("lacks", ("delay@acquisition",), (), {}, True),
        ("lacks", (), ("delay@acquisition",), {}, False),
        ("lacks", ("delay@acquisition", "payload@load"), (), {}, False),
        ("holds", (), ("delay@acquisition",), {"damping": 1.2}, True),
        ("holds", ("delay@acquisition",), (), {}, False),
    ],
)
def test_right_is_the_difference_and_nothing_else(
    kind: str, left_out: tuple[str, ...], contradicted: tuple[str, ...], ratios: dict[str, float], right: bool
) -> None:
    assert is_right(kind, "delay@acquisition", left_out, contradicted, ratios) is right
