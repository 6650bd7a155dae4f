"""Draws: sealed, repeatable, without a trace."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from jointscope.cli import main
from jointscope.recordings.reader import read_campaign
from jointscope.sim.concealed import catalogue, draw, seal
from jointscope.sim.concealed.bench import draw_bench
from jointscope.sim.concealed.draw import REDRAWN, Order, case_name, recorded
from jointscope.sim.concealed.paperwork import npz_bytes
from jointscope.sim.concealed.production import produce

CONTRACT = {
    "coulomb-friction": {"motor", "load"}, "stribeck-friction": {"motor", "load"},
    "load-dependent-friction": {"transmission"}, "quadratic-damping": {"load"}, "backlash": {"transmission"},
    "stiffness-nonlinearity": {"transmission"}, "hysteresis": {"transmission"}, "structural-damping": {"transmission"},
    "transmission-error": {"transmission"}, "torque-ripple": {"motor"}, "drive-lag": {"motor"},
    "torque-gain": {"motor"}, "gravity": {"load"}, "payload": {"load"}, "link-flexibility": {"load"},
    "base-compliance": {"base"}, "neighbour-flexibility": {"neighbour"}, "end-stop": {"load"},
    "stiffness-drift": {"transmission"}, "external-vibration": {"base"}, "delay": {"acquisition"},
    "clock-drift": {"acquisition"}, "sensor-tilt": {"acquisition"}, "sensor-resonance": {"acquisition"},
    "sensor-saturation": {"acquisition"}, "sensor-gain": {"acquisition"}, "torque-logging": {"acquisition"},
}  # fmt: skip


@pytest.mark.parametrize("draw", ["development", "calibration", "test"])
def test_every_effect_of_the_contract_can_be_drawn_at_every_place(draw):
    """Each name and place has a law in each draw, and most have a law that departs from the textbook."""
    found = {(law.effect, law.location) for law in catalogue.laws(draw)}
    assert found == {(effect, place) for effect, places in CONTRACT.items() for place in places}
    departing = {law.effect for law in catalogue.laws(draw) if law.departs}
    assert len(departing) >= 20
    assert len({law.effect for law in catalogue.laws(draw, unlisted=True)}) >= 4
    assert not {law.effect for law in catalogue.laws(draw, unlisted=True)} & set(CONTRACT)


def test_the_test_draw_has_families_of_its_own():
    """No departing law and no unlisted effect of the test draw appears in an open draw."""
    open_laws = {(law.effect, law.law) for law in catalogue.laws("development") if law.departs}
    assert not open_laws & {(law.effect, law.law) for law in catalogue.laws("test") if law.departs}
    unlisted = {law.effect for law in catalogue.laws("development", unlisted=True)}
    assert not unlisted & {law.effect for law in catalogue.laws("test", unlisted=True)}


def test_a_seal_opens_to_what_was_sealed(tmp_path):
    """Round trip; equal truths give equal seals; the text can't be read in the file."""
    truth = {"cases": {"a": {"effects": ["coulomb-friction"]}}}
    found = seal.write_seal(tmp_path, truth)
    assert seal.sealed_digest(tmp_path) == found
    assert seal.open_seal(tmp_path, found) == truth
    assert seal.seal(truth) == seal.seal(json.loads(json.dumps(truth)))
    assert b"coulomb" not in (tmp_path / seal.NAME).read_bytes()


@pytest.mark.parametrize("place", [30, 60, -1])
def test_a_changed_seal_is_refused(tmp_path, place):
    """One flipped bit anywhere is noticed, with or without a forged receipt."""
    found = seal.write_seal(tmp_path, {"cases": {"a": 1}})
    data = bytearray((tmp_path / seal.NAME).read_bytes())
    data[place] ^= 1
    (tmp_path / seal.NAME).write_bytes(bytes(data))
    with pytest.raises(seal.SealError, match="not that of"):
        seal.sealed_digest(tmp_path)
    with pytest.raises(seal.SealError, match="changed since"):
        seal.open_seal(tmp_path, found)
    with pytest.raises(seal.SealError):
        seal.open_seal(tmp_path, seal.digest(bytes(data)))


def test_archives_depend_on_samples_only():
    """The same samples give the same bytes, and the size is that of the samples' number alone."""
    a, b = np.zeros(100), np.random.default_rng(0).standard_normal(100)
    assert npz_bytes({"x": b}) == npz_bytes({"x": b.copy()})
    assert len(npz_bytes({"x": a})) == len(npz_bytes({"x": b}))


def test_case_names_tell_nothing_but_themselves():
    """Names are hashes of seed and place."""
    order = Order(seed=5, cases=200, kind="mixed", draw="development")
    names = [case_name(order, i) for i in range(200)]
    assert len(set(names)) == 200
    assert names != sorted(names)


def test_a_null_is_a_valid_campaign_and_is_made_again_alike(tmp_path):
    """Two productions of one order agree to the last byte; every file carries the same time stamp."""
    order = Order(seed=11, cases=1, kind="nulls", draw="development")
    first, second = produce(order, tmp_path / "a", 1), produce(order, tmp_path / "b", 1)
    assert first == second
    name = case_name(order, 0)
    campaign = read_campaign(tmp_path / "a" / name)
    assert {run.experiment for run in campaign.runs} <= {"hammer", "torque-sweep", "speed-motion"}
    files = [path for path in (tmp_path / "a" / name).iterdir()]
    assert len({path.stat().st_mtime for path in files}) == 1
    for path in files:
        assert path.read_bytes() == (tmp_path / "b" / name / path.name).read_bytes()
    assert produce(order, tmp_path / "a", 1) == first  # and going on changes nothing


def test_another_order_in_the_same_folder_is_refused(tmp_path, capsys):
    """A folder belongs to one draw."""
    (tmp_path / "draw.json").write_text('{"seed": 1, "cases": 1, "kind": "nulls", "draw": "test"}')
    words = ["conceal", "--seed", "2", "--cases", "1", "--kind", "nulls", "--out", str(tmp_path)]
    assert main(words) == 2
    assert "draw.json: seed = 1" in capsys.readouterr().err


@pytest.mark.slow
def test_numbers_do_not_depend_on_the_number_of_workers(tmp_path):
    """One process or two: the same seal."""
    order = Order(seed=21, cases=3, kind="singles", draw="development")
    assert produce(order, tmp_path / "one", 1) == produce(order, tmp_path / "two", 2)


@pytest.mark.slow
def test_paperwork_does_not_tell_hits_from_misses(tmp_path):
    """Metadata of 120 benches, labels drawn as a draw would: a classifier does no better than chance."""
    from jointscope.experiments.prove import leak
    from jointscope.sim.concealed import paperwork

    labels, rows = [], []
    for i in range(120):
        kind_seed, bench_seed, paper_seed = np.random.SeedSequence([77, i]).spawn(3)
        bench = draw_bench(np.random.default_rng(bench_seed), "development")
        rng = np.random.default_rng(paper_seed)
        plate = paperwork.nameplate(bench.rig, bench.topology, bench.motion, rng, 0.35 if bench.hard else 0.15)
        records = [_silence(bench, take) for take in bench.plan.takes]
        folder = tmp_path / f"{np.random.default_rng([9, i]).integers(2**40):010x}"
        paperwork.write_case(paperwork.campaign(bench.rig, bench.plan, records, plate, rng), folder)
        rows.append(leak.features(Path(folder)))
        labels.append(np.random.default_rng(kind_seed).random() > 0.33)
    for classifier in leak.CLASSIFIERS.values():
        found = leak.probe(np.array(rows), np.array(labels), np.random.default_rng(1), classifier=classifier)
        assert found.at_chance


def _silence(bench, take):
    daq = np.zeros(int(take.duration * bench.plan.devices.daq_rate))
    log = np.zeros(int(take.duration * bench.plan.devices.log_rate))
    record = {"acceleration": daq, "motor": log, "arm": daq}
    if take.braked:
        record["force"] = daq
    else:
        record["torque"] = log
    if take.kind == "speed-motion":
        record["command"] = log
    return record


@pytest.mark.parametrize("flights", [1, REDRAWN])
def test_a_case_that_flies_apart_is_drawn_anew_a_few_times(monkeypatch, flights):
    """Other effects on the same bench; a draw of nulls has none, so what is recorded is the same."""
    order, tried = Order(5, 1, "nulls", "development"), []
    rehearse = draw.rehearse

    def flying(rig, plan, effects, runs):
        tried.append(rig)
        if len(tried) <= flights:
            raise FloatingPointError("diverged")
        return rehearse(rig, plan, effects, list(runs)[:1])

    monkeypatch.setattr(draw, "rehearse", flying)
    if flights == REDRAWN:
        with pytest.raises(FloatingPointError):
            recorded(order, 0)
    else:
        case, clean = recorded(order, 0)
        assert case.kind == "null" and len(clean) == 1
    assert len(tried) == min(flights + 1, REDRAWN)


def test_a_case_of_which_no_law_can_be_simulated_is_drawn_anew(monkeypatch):
    tried = []
    conceal = draw.conceal

    def hopeless(bench, kind, which, rng):
        tried.append(bench)
        if len(tried) == 1:
            raise FloatingPointError("no law can be simulated on this rig")
        return conceal(bench, kind, which, rng)

    monkeypatch.setattr(draw, "conceal", hopeless)
    monkeypatch.setattr(draw, "rehearse", lambda rig, plan, effects, runs: [{}])
    case, _ = recorded(Order(5, 1, "nulls", "development"), 0)
    assert case.kind == "null" and len(tried) == 2
