"""Real recordings: disguises say the same, the control holds no friction, what is missing is absent, answers are kept."""

from __future__ import annotations

import json
import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from jointscope.errors import InputError
from jointscope.experiments.prove import real
from jointscope.experiments.prove.diagnosing import Answer
from jointscope.experiments.prove.real_copies import (
    CUT,
    LATER,
    decimated,
    flipped,
    friction_force,
    rescaled,
    same_answer,
    shifted,
    without_friction,
)
from jointscope.experiments.prove.real_sets import BENCH, EMPS, SETS, checks, figure
from jointscope.recordings.importers import import_data_set
from jointscope.recordings.reader import read_campaign
from jointscope.recordings.writer import write_campaign

DATA = Path(os.environ.get("JOINTSCOPE_DATA", Path(__file__).resolve().parents[2].parent / "shared" / "data"))
MASS, VISCOUS, DRY, GAIN = 95.0, 204.0, 20.4, 35.15


@pytest.fixture(scope="module")
def data(tmp_path_factory) -> Path:
    """A folder like the public one, holding one small set: a carriage whose force follows from its motion."""
    folder = tmp_path_factory.mktemp("data")
    (folder / "emps").mkdir()
    for name, beat in (("DATA_EMPS.mat", 0.5), ("DATA_EMPS_PULSES.mat", 0.7)):
        t = np.arange(3000) / 1000.0
        w = 2.0 * np.pi * beat
        q, v, a = 0.05 * np.sin(w * t), 0.05 * w * np.cos(w * t), -0.05 * w**2 * np.sin(w * t)
        force = MASS * a + VISCOUS * v + DRY * np.sign(v)
        savemat(folder / "emps" / name, {"t": t, "qm": q, "vir": force / GAIN, "gtau": GAIN})
    return folder


@pytest.fixture(scope="module")
def campaign(data, tmp_path_factory):
    return read_campaign(import_data_set("emps", [data / "emps"], tmp_path_factory.mktemp("made") / "emps"))


def entry(value: float, unit: str = "N") -> dict:
    return {"value": value, "unit": unit, "interval95": [0.99 * value, 1.01 * value]}


def answer(verdict: str = "effects", torque: float = 20.4) -> dict:
    """A diagnosis as the command writes it."""
    effects = [
        {
            "effect": "coulomb-friction", "location": "load", "probability": 0.99, "law": "plain",
            "parameters": {"torque": entry(torque)},
        }
    ]  # fmt: skip
    return {
        "verdict": verdict, "verdict_probability": 0.99, "unknown_reason": None, "where": None, "findings": [],
        "effects": effects if verdict == "effects" else [],
        "parameters": {"load_damping": entry(VISCOUS, "N s/m"), "inertia": entry(MASS, "kg")},
        "held_out": {
            "base_error": 0.2, "augmented_error": 0.1, "base_inverse_error": 0.177, "inverse_error": 0.035,
            "position_error": {"position@load": {"base": 0.028, "augmented": 0.011, "unit": "m"}},
        },
    }  # fmt: skip


def samples(campaign, run: int, channel: int) -> np.ndarray:
    return np.asarray(campaign.runs[run].streams[0].channels[channel].samples)


@pytest.mark.parametrize("copy", [rescaled, decimated, shifted, flipped])
def test_a_copy_is_a_campaign_that_can_be_written_and_read(campaign, copy, tmp_path):
    changed = copy(campaign)
    read = read_campaign(write_campaign(changed, tmp_path / "copy", file_format="npz"))
    for run in range(2):
        for channel in range(2):
            assert samples(read, run, channel) == pytest.approx(samples(changed, run, channel), rel=1e-12)
    assert read.runs[0].streams[0].sampling_rate == changed.runs[0].streams[0].sampling_rate
    assert read.runs[0].streams[0].start == pytest.approx(changed.runs[0].streams[0].start)


def test_other_units_are_the_same_samples_in_si(campaign, tmp_path):
    read = read_campaign(write_campaign(rescaled(campaign), tmp_path / "copy", file_format="npz"))
    assert samples(read, 0, 1) == pytest.approx(samples(campaign, 0, 1), rel=1e-12)
    assert all(c.calibrated for c in read.runs[0].streams[0].channels)


def test_half_the_rate_is_the_same_signal(campaign):
    half = decimated(campaign).runs[0].streams[0]
    assert (half.sampling_rate, half.length) == (500.0, 1500)
    whole = samples(campaign, 0, 1)[::2]
    assert np.asarray(half.channels[1].samples)[50:-50] == pytest.approx(whole[50:-50], abs=2e-5 * np.ptp(whole))


def test_a_later_start_moves_the_clock_and_cuts_what_was_in_motion(campaign):
    stream = shifted(campaign).runs[0].streams[0]
    assert stream.start == pytest.approx(LATER + CUT)
    assert np.asarray(stream.channels[1].samples)[0] == samples(campaign, 0, 1)[round(1000 * CUT)]


def test_turned_twice_is_not_turned(campaign):
    again = flipped(flipped(campaign))
    assert samples(again, 0, 1) == pytest.approx(samples(campaign, 0, 1))
    assert samples(flipped(campaign), 0, 0) == pytest.approx(samples(campaign, 0, 0))


def test_the_control_holds_the_base_alone(campaign):
    """What is left of the force is M a + b v: 2e-2 of it, all of it where the speed passes through zero."""
    freed = without_friction(campaign, answer())
    assert freed is not None
    t = np.arange(3000) / 1000.0
    w = 2.0 * np.pi * 0.5
    base = -MASS * 0.05 * w**2 * np.sin(w * t) + VISCOUS * 0.05 * w * np.cos(w * t)
    left = (samples(freed, 0, 0) - base)[200:-200]
    assert np.sqrt(np.mean(left**2)) < 0.02 * np.sqrt(np.mean(base**2))


def test_an_answer_without_friction_has_no_control(campaign):
    assert without_friction(campaign, answer("none")) is None
    elsewhere = answer()
    elsewhere["effects"][0]["location"] = "motor"
    assert without_friction(campaign, elsewhere) is None


def test_named_laws_are_the_catalogues():
    speed = np.array([-0.1, -1e-3, 1e-3, 0.1])
    plain = {"effect": "coulomb-friction", "parameters": {"torque": entry(2.0), "asymmetry": entry(0.5)}}
    assert friction_force(plain, speed, 0.0) == pytest.approx([-1.0, -1.0, 3.0, 3.0])
    sided = {"effect": "coulomb-friction", "parameters": {"torque": entry(2.0), "viscous_asymmetry": entry(0.5)}}
    assert friction_force(sided, speed, 10.0) == pytest.approx([-1.5, -1.995, 2.005, 2.5])
    stribeck = {
        "effect": "stribeck-friction", "law": "gaussian",
        "parameters": {"torque": entry(2.0), "breakaway": entry(3.0), "stribeck_velocity": entry(1e-3)},
    }  # fmt: skip
    assert friction_force(stribeck, speed, 0.0) == pytest.approx([-2.0, -2.0 - np.exp(-1), 2.0 + np.exp(-1), 2.0])


def test_checks_ask_for_name_figure_and_published_values():
    assert all(check.met for check in checks(EMPS, answer()))
    off = checks(EMPS, answer(torque=22.0))
    assert [check.met for check in off].count(False) == 1
    assert not checks(EMPS, answer("none"))[0].met
    assert figure(answer(), "inverse_error") == (0.177, 0.035)
    assert not next(c for c in checks(BENCH, {**answer("none"), "verdict": "unknown"}) if "verdict" in c.asked).met


def test_a_copy_must_agree_in_verdict_names_and_size():
    assert same_answer(answer(), answer(torque=21.0), calibrated=True) == (True, pytest.approx(21.0 / 20.4))
    assert not same_answer(answer(), answer(torque=24.0), calibrated=True)[0]
    assert same_answer(answer(), answer(torque=24.0), calibrated=False)[0]
    assert not same_answer(answer(), answer("none"), calibrated=True)[0]
    assert same_answer(answer("none"), answer("none"), calibrated=True)[0]


def canned(monkeypatch) -> list[str]:
    """Replace the diagnosis by ready answers; the cases that were asked for are returned as they come."""
    asked: list[str] = []

    def ready(folder, out, names, *, workers, limit):
        for name in names:
            assert (folder / name / "campaign.toml").is_file()
        asked.extend(names)
        return [Answer(n, "answered", 1.0, answer("none" if n.endswith("control") else "effects")) for n in names]

    monkeypatch.setattr(real, "diagnose_all", ready)
    return asked


def test_absent_sets_are_said_to_be_absent_and_the_present_one_is_proved(data, tmp_path, monkeypatch):
    asked = canned(monkeypatch)
    real.prove_real(data, tmp_path / "out", workers=1, limit=10.0)
    summary = json.loads((tmp_path / "out" / "real.json").read_text(encoding="utf-8"))
    rows = {row["set"]: row for row in summary["sets"]}
    assert set(rows) == {s.name for s in SETS}
    assert {name for name, row in rows.items() if row["status"] == "absent"} == set(rows) - {"emps"}
    assert rows["emps"]["control"]["none"]
    assert all(copy["same"] for copy in rows["emps"]["copies"])
    assert sorted(asked) == sorted(
        f"emps{end}" for end in ("", ".rescaled", ".decimated", ".time-shifted", ".sign-flipped", ".control")
    )
    page = (tmp_path / "out" / "real.md").read_text(encoding="utf-8")
    assert "| kr300-axis-1 |" in page and "absent" in page and "20.3935" in page and "11 mm" in page
    assert (tmp_path / "out" / "real.png").stat().st_size > 5000


def test_nothing_there_is_no_failure(tmp_path, monkeypatch):
    canned(monkeypatch)
    summary = real.prove_real(tmp_path / "nothing", tmp_path / "out", workers=1, limit=10.0)
    assert {row["status"] for row in summary["sets"]} == {"absent"}


def test_results_of_other_recordings_are_not_gone_on_with(data, tmp_path, monkeypatch):
    canned(monkeypatch)
    real.prove_real(tmp_path / "nothing", tmp_path / "out", workers=1, limit=10.0, copies=())
    with pytest.raises(InputError, match="choose another"):
        real.prove_real(data, tmp_path / "out", workers=1, limit=10.0, copies=())


def test_a_crash_is_a_row_and_not_an_end(data, tmp_path, monkeypatch):
    monkeypatch.setattr(
        real,
        "diagnose_all",
        lambda folder, out, names, **_: [Answer(n, "crashed", 1.0, None, "why") for n in names],
    )
    summary = real.prove_real(data, tmp_path / "out", workers=1, limit=10.0)
    row = next(row for row in summary["sets"] if row["set"] == "emps")
    assert (row["status"], row["message"]) == ("crashed", "why")


@pytest.mark.slow
def test_the_carriage_of_the_public_set_is_named(tmp_path):
    if not (DATA / "emps" / "DATA_EMPS.mat").is_file():
        pytest.skip(f"{DATA / 'emps'} is absent: set JOINTSCOPE_DATA")
    summary = real.prove_real(
        DATA, tmp_path / "out", workers=1, limit=1800.0, sets=(EMPS,), copies=("decimated", "sign-flipped")
    )
    (row,) = summary["sets"]
    assert all(check["met"] for check in row["checks"]), row["checks"]
    assert all(copy["same"] for copy in row["copies"]), row["copies"]


def test_every_set_has_an_importer_and_names_of_the_catalogue():
    from jointscope.diagnosis.effects import REGISTRY

    known = {spec.name for spec in REGISTRY}
    for asked in SETS:
        assert set(asked.never) <= known
        assert {place.split("@")[0] for place in asked.places} - {""} <= known
        assert replace(asked).data_set in real.import_data_set.__globals__["IMPORTERS"]
