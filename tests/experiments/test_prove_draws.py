"""Published draws are kept by seed, counted once each, and the newest of them together."""

import json

import pytest

from jointscope.experiments.prove.draws import FILE, NEWEST, record

NULLS = "false alarms on nulls: any physics named"


def summary(seed: int, named: int, nulls: int = 15, kind: str = "mixed") -> dict:
    share = {"hits": named, "cases": nulls, "share": named / nulls, "low": 0.0, "high": 1.0}
    table = [{"name": NULLS, "value": share}, {"name": "wall time per campaign: median", "value": 40.0}]
    about = {
        "draw": "test",
        "kind": kind,
        "engine": "mujoco",
        "seed": seed,
        "commit": "abc",
        "cases": 48,
        "openings": 1,
    }
    return {**about, "table": table}


def newest(folder) -> dict:
    return json.loads((folder / FILE).read_text(encoding="utf-8"))["newest"]


def test_hits_and_cases_of_the_newest_draws_add_up(tmp_path):
    """In whatever order they are published; older ones are kept and not counted."""
    for seed in (5, 3, 1, 2, 6, 4):
        record(summary(seed, named=seed), tmp_path)
    assert newest(tmp_path)["seeds"] == [3, 4, 5, 6][-NEWEST:]
    (row,) = newest(tmp_path)["table"]
    assert (row["value"]["hits"], row["value"]["cases"]) == (18, 60)
    assert row["value"]["share"] == pytest.approx(0.3)
    assert len(json.loads((tmp_path / FILE).read_text(encoding="utf-8"))["draws"]) == 6


def test_a_draw_published_anew_counts_once(tmp_path):
    record(summary(1, named=3), tmp_path)
    record(summary(1, named=1), tmp_path)
    (row,) = newest(tmp_path)["table"]
    assert (row["value"]["hits"], row["value"]["cases"]) == (1, 15)


def test_draws_of_another_kind_are_not_counted_with_them(tmp_path):
    record(summary(1, named=1, kind="nulls"), tmp_path)
    assert not (tmp_path / FILE).exists()
