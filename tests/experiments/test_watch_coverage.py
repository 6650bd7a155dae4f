"""The watch at the bench: what the takes so far can show, and what is said to be missing."""

import json
import sys
from pathlib import Path

import numpy as np
import pytest

from jointscope.cli import main
from jointscope.diagnosis.effects import REGISTRY
from jointscope.diagnosis.next_experiment import MENU
from jointscope.experiments.watch import held as held_module
from jointscope.experiments.watch import lines, precision
from jointscope.experiments.watch.coverage import _ORDER, coverage
from jointscope.experiments.watch.judging import Take, judge
from jointscope.recordings.reader import campaign_of, parse_campaign, read_campaign

sys.path.insert(0, str(Path(__file__).parent))
from watched_bench import (  # type: ignore[import-not-found]
    bench_in,
    hit,
    session,
    standing,
    write_csv,
)


@pytest.fixture
def bench(tmp_path):
    """A template campaign of one hit, and an empty folder that takes arrive in."""
    return bench_in(tmp_path)


@pytest.mark.parametrize("hits", [3, 10, 40])
def test_four_times_the_hits_for_half_the_width(hits):
    assert precision._more(0.02, hits, 0.01) == 3 * hits
    assert precision._more(0.01, hits, 0.01) == 0


def test_more_hits_are_asked_for_until_the_width_is_there(bench):
    rng = np.random.default_rng(10)
    for number in range(3):
        write_csv(bench[1] / f"hit-{number}.csv", *hit(rng, 150.0, noise=0.4))
    wide = standing(session(bench, within=1e-4).look(0.0, 0.0))
    assert all(known.missing for known in wide.known)
    loose = standing(session(bench, within=0.5).look(0.0, 0.0))
    assert not any(known.missing for known in loose.known if known.symbol != "c")


def test_a_take_to_be_repeated_does_not_count(bench):
    write_csv(bench[1] / "hit.csv", *hit(np.random.default_rng(11), clip=30.0))
    found = standing(session(bench).look(0.0, 0.0))
    assert found.takes == 0 and all(known.value is None for known in found.known)
    assert "brake" in found.next_take


def test_the_menu_families_and_wordings_are_complete():
    assert set(held_module._CHECKS) <= set(MENU) and set(lines._SHORT) <= set(MENU)
    assert set(held_module.held([], read_nothing())) == set(MENU)
    assert {spec.family for spec in REGISTRY} <= set(_ORDER)


def read_nothing():
    from jointscope.recordings.campaign import Nameplate

    return Nameplate(topology="two-inertia", motion="rotational")


def hits_at(rng, levels, campaign, **changes):
    """Judged takes without files."""
    document = parse_campaign(campaign / "campaign.toml")
    takes = []
    for peak in levels:
        write_csv(campaign / "first.csv", *hit(rng, float(peak), seconds=1.0))
        run = {**document["run"][0], **changes}
        read = campaign_of({**document, "run": [run]}, campaign / "campaign.toml")
        takes.append(judge(read.runs[0], read, takes))
    return read_campaign(campaign), takes


def test_hits_alone_show_the_spring_and_not_the_motor(bench):
    campaign, takes = hits_at(np.random.default_rng(12), [100.0, 200.0], bench[0])
    found = {one.name: one for one in coverage(campaign, takes).effects}
    assert found["backlash@transmission"].shown
    assert not found["stribeck-friction@motor"].shown
    assert "motion" in found["stribeck-friction@motor"].missing
    assert not found["torque-ripple@motor"].shown and not found["drive-lag@motor"].shown


@pytest.mark.parametrize(("levels", "enough"), [
    ([50, 400, 100, 800, 60, 420, 110, 780, 55, 410, 105, 790], True),
    ([50, 55, 60, 100, 105, 110, 400, 410, 420, 780, 790, 800], False),  # sorted: a joint that warms up looks the same
    ([200, 210, 190, 220, 205, 195, 200, 215, 185, 200, 210, 190], False),  # one level
])  # fmt: skip
def test_levels_count_over_a_span_and_in_random_order(levels, enough):
    takes = [Take(run=_stub(), verdict="good", reasons=(), level=float(v), level_unit="N") for v in levels]
    assert held_module._levels(takes, None).enough is enough


def _stub():
    from jointscope.recordings.campaign import Run

    return Run(id="x", experiment="hammer", streams=(), brake=True)


@pytest.fixture(scope="module")
def simulated(tmp_path_factory):
    out = tmp_path_factory.mktemp("watch") / "c"
    words = ["--hits", "2", "--repeats", "1", "--hit-levels", "150", "--sweep-levels", "0.6", "--travels", "60"]
    assert main(["simulate", "single-joint", "--out", str(out), "--seed", "5", *words]) == 0
    return out


def test_a_whole_simulated_bench_is_good_and_shows_every_family(simulated, capsys):
    capsys.readouterr()
    assert main(["watch", str(simulated), "--once", "--json"]) == 0
    events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert {event["verdict"] for event in events if event["event"] == "take"} == {"good"}
    last = events[-1]
    assert last["event"] == "standing" and all(
        one["can_be_shown"] for one in last["effects"] if one["family"] != "inertia"
    )
    assert last["menu"]["brake"]["so_far"] == "brake closed"
    assert last["one_more"] == ["torque-sweep", "speed-motion"]


def test_its_own_runs_taken_out_of_the_toml_are_recognised_by_their_columns(simulated, tmp_path, capsys):
    import shutil

    folder = tmp_path / "arrived"
    folder.mkdir()
    for path in simulated.glob("*.csv"):
        shutil.copyfile(path, folder / path.name)
    capsys.readouterr()
    assert main(["watch", str(folder), "--like", str(simulated), "--once", "--json"]) == 0
    takes = {
        e["run"]: e for line in capsys.readouterr().out.splitlines() if (e := json.loads(line))["event"] == "take"
    }
    own = {run.id: run for run in read_campaign(simulated).runs}
    assert {name: take["experiment"] for name, take in takes.items()} == {n: r.experiment for n, r in own.items()}
    assert all(sorted(takes[n]["files"]) == sorted(s.file for s in r.streams) for n, r in own.items())
