"""The diagnosis' page: what it says, what it lights, and that its pictures and numbers agree with the answer."""

import math
import re
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import butter, freqz_sos, sosfilt

from jointscope.commands.diagnose import summary
from jointscope.diagnosis.constancy import Change, changes_json
from jointscope.diagnosis.effects import REGISTRY
from jointscope.diagnosis.noise import BlockNoise
from jointscope.experiments.charts.chart import Missing
from jointscope.experiments.charts.files import columns, write_files
from jointscope.experiments.diagnosis_report import figures, tables
from jointscope.experiments.diagnosis_report.balance import Balance
from jointscope.experiments.diagnosis_report.bars import Pair, error_bars, pairs, worst_sentence
from jointscope.experiments.diagnosis_report.drawing import joint_drawing, marks
from jointscope.experiments.diagnosis_report.hits import Hit, usable_band
from jointscope.experiments.diagnosis_report.levels import level_groups
from jointscope.experiments.diagnosis_report.orders import speed_map
from jointscope.experiments.diagnosis_report.responses import h1
from jointscope.experiments.diagnosis_report.traces import Trace, noise_density, telling
from jointscope.experiments.diagnosis_report.wording import (
    CALLED,
    PLACES,
    next_step,
    percent_fit,
    sized,
    verdict_sentence,
)
from jointscope.experiments.page import Section, page

RATE = 512.0


def trace(*, run="a", experiment="hammer", level=1.0, held_out=True, base=0.1, corrected=0.1, floor=0.01):
    """A 20 Hz tone that the models miss by the given shares."""
    t = np.arange(1024) / RATE
    tone = np.sin(2.0 * np.pi * 20.0 * t)
    return Trace(
        run=run, position=0, experiment=experiment, quantity="linear-acceleration", location="arm", level=level,
        held_out=held_out, rate=RATE, time=t, recorded=tone, base=(1.0 - base) * tone,
        corrected=(1.0 - corrected) * tone, base_error=base, corrected_error=corrected, floor=floor,
    )  # fmt: skip


def answer(verdict, *, effects=(), candidates=None, held=True, shift=None):
    """As much of diagnosis.json as the sentences read."""
    return {
        "verdict": verdict,
        "verdict_probability": 0.97,
        "effects": list(effects),
        "candidates": candidates,
        "unknown_reason": "not-identifiable" if candidates else None,
        "held_out": {"runs": ["a"], "base_error": 0.4, "augmented_error": 0.05, "noise_floor": 0.04}
        if held
        else None,
        "parameter_shift": shift or {},
        "next_experiment": None,
    }


PLAY = {
    "effect": "backlash",
    "location": "transmission",
    "parameters": {"gap": {"value": math.radians(1.0 / 60.0), "unit": "rad", "interval95": [2.8e-4, 3.0e-4]}},
}


def test_every_effect_and_place_of_the_catalogue_has_words():
    assert {spec.name for spec in REGISTRY} <= CALLED.keys()
    assert {spec.location for spec in REGISTRY} <= PLACES.keys()


def test_play_is_told_in_arcmin_and_as_a_gain_in_fit():
    sentence = verdict_sentence(answer("effects", effects=[PLAY]), translational=False)
    assert "1.00 arcmin" in sentence
    assert "from 60.0 % to 95.0 %" in sentence
    assert "in the reducer" in sentence


def test_stiffness_is_told_per_arcmin():
    told = sized("stiffness", {"value": 193_600.0, "unit": "N m/rad", "interval95": [193_100.0, 194_100.0]})
    assert f"{193_600.0 * math.pi / 10_800.0:.1f} N m/arcmin" in told


def test_nothing_found_names_no_effect_but_the_parameters_that_were_off():
    told = verdict_sentence(answer("none", shift={"load_damping": {}}), translational=False)
    assert told.startswith("Nothing is missing") and "load damping" in told
    assert not any(words in told for words in CALLED.values())


def test_without_held_out_runs_an_effect_is_only_a_candidate():
    assert verdict_sentence(answer("effects", effects=[PLAY], held=False), translational=False).startswith(
        "A candidate"
    )


def test_look_alikes_are_all_named():
    told = verdict_sentence(
        answer("unknown", candidates=[["backlash@transmission"], ["hysteresis@transmission"]]), translational=False
    )
    assert "backlash" in told and "hysteresis" in told and "can't tell" in told


def test_look_alikes_of_one_place_have_it_said_once_and_what_they_gain():
    """Where is known, which law is not: the sentence says both."""
    told = verdict_sentence(
        answer("unknown", candidates=[["coulomb-friction@load"], ["stribeck-friction@load"]]), translational=False
    )
    assert told.count("at the arm") == 1 and "leaves out something at the arm" in told
    assert "from 60.0 % to 95.0 %" in told and "97 %" in told


def test_an_effect_that_does_not_keep_its_size_is_told_in_words():
    change = Change("coulomb-friction@motor", -0.35, 0.03, 80.0, 40.0, 35.0)
    told = verdict_sentence({**answer("unknown"), "changes": changes_json((change,))}, translational=False)
    assert "Dry friction in the motor comes nearest" in told
    assert "falls by 70 +- 6 % of its mean" in told and "@" not in told


def test_physics_outside_the_catalogue_is_told_in_words():
    found = {"law": "a brake that slips above a torque", "location": "motor"}
    told = verdict_sentence({**answer("unknown"), "resembles": found}, translational=False)
    assert "A brake that slips above a torque explains more than anything in the catalogue." in told


def test_where_the_model_is_farthest_above_the_noise_is_said():
    found = (Pair("hammer, arm", 0.3, None, 0.25), Pair("sweep, motor", 2.3, None, 0.002))
    assert "sweep, motor" in worst_sentence(found) and "230 %" in worst_sentence(found)
    assert worst_sentence((Pair("hammer, arm", 0.3, None, math.nan),)) == ""


def test_two_good_fits_stay_apart():
    assert percent_fit(0.0041) != percent_fit(0.0049)


def test_a_proposed_recording_comes_first_among_the_next_steps():
    assert "slow ramp" in next_step(answer("unknown") | {"next_experiment": "a slow ramp"})


@pytest.mark.parametrize(
    ("tells", "words"),
    [
        (
            "backlash@transmission from hysteresis@transmission",
            "backlash (lost motion) in the reducer from hysteresis",
        ),
        ("whether gravity@load is there at all", "whether there is a gravity torque"),
    ],
)
def test_what_a_recording_tells_is_in_words(tells, words):
    told = next_step(answer("unknown") | {"next_experiment": f"a slow ramp: it tells {tells}"})
    assert words in told and "@" not in told


@pytest.mark.parametrize("location", sorted(PLACES))
def test_the_drawing_lights_one_place_by_class_and_by_text(location):
    lit = marks((f"coulomb-friction@{location}",), CALLED)
    drawing = joint_drawing(lit, topology="two-inertia", motion="rotational", spring=True, sure=True)
    root = ElementTree.fromstring(drawing)
    assert [r.get("class") for r in root.iter("rect")].count("part lit") == 1
    assert any("dry friction" in (text.text or "") for text in root.iter("text"))


def test_the_drawing_lights_nothing_where_nothing_was_found():
    for topology, spring in (("two-inertia", True), ("single-dof", True), ("single-dof", False)):
        drawing = joint_drawing({}, topology=topology, motion="rotational", spring=spring, sure=True)
        assert not [r for r in ElementTree.fromstring(drawing).iter("rect") if "lit" in (r.get("class") or "")]


def test_an_accelerometers_fault_lights_the_sensors_a_delay_the_logger():
    assert marks(("sensor-tilt@acquisition",), CALLED).keys() == {"sensors"}
    assert marks(("delay@acquisition",), CALLED).keys() == {"acquisition"}


def test_bars_are_as_long_as_the_decades_say():
    drawing = ElementTree.fromstring(
        error_bars(pairs([trace(base=0.1, corrected=0.01, floor=0.001)], corrected=True))
    )
    base, corrected = (float(r.get("width")) for r in drawing.iter("rect"))
    lines = [float(x.get("x1")) for x in drawing.iter("line") if x.get("class") == "grid"]
    assert base - corrected == pytest.approx(lines[1] - lines[0], abs=0.2)


def test_bars_weigh_held_out_runs_only():
    (pair,) = pairs([trace(base=0.1), trace(run="b", base=0.9, held_out=False)], corrected=False)
    assert pair.base == pytest.approx(0.1) and pair.corrected is None


def test_the_telling_trace_is_the_held_out_one_that_gains_most():
    best = trace(run="best", base=0.3, corrected=0.1)
    pool = [trace(run="fitted", base=0.9, corrected=0.0, held_out=False), trace(run="other", base=0.2), best]
    assert telling(pool) == {"hammer": best}


def test_bands_hold_a_tones_whole_power():
    x = np.sqrt(2.0) * np.sin(2.0 * np.pi * 20.0 * np.arange(8192) / RATE)
    centres, size = figures.bands(x, RATE)
    assert np.sqrt(np.sum(size**2)) == pytest.approx(1.0, rel=1e-3)
    assert abs(np.log2(centres[np.argmax(size)] / 20.0)) < 1.0 / 3.0


def test_noise_of_an_autoregressive_channel_holds_its_variance_over_all_lines():
    ar, sigma = np.array([1.0, -0.6, 0.2]), 0.3
    density = noise_density(BlockNoise(ar=ar, sigma=sigma, marginal=0.0, kappa=0.0), RATE)
    f = np.linspace(0.0, RATE / 2.0, 20_001)
    variance = np.trapezoid(density(f) ** 2, f)
    r1 = 0.6 / 1.2  # Yule-Walker: rho_1 = phi_1/(1 - phi_2), sigma_x^2 = sigma^2/(1 - phi_1 rho_1 - phi_2 rho_2)
    expected = sigma**2 / (1.0 - 0.6 * r1 + 0.2 * (0.6 * r1 - 0.2))
    assert variance == pytest.approx(expected, rel=1e-6)


def test_each_figure_holds_the_numbers_it_was_given(tmp_path):
    t = [trace(run=str(k), level=float(k), base=0.4 / k, corrected=0.01) for k in (1, 2, 4)]
    sign = np.repeat([1.0, -1.0], 50)
    moved = Balance(
        speed=sign, position=np.linspace(0, 1, 100), residual=5.0 * sign, speed_unit="rad/s", position_unit="rad",
        unit="N m", what="torque", told="",
    )  # fmt: skip
    level = columns(figures.against_level(t, corrected=True))
    assert list(level["base_held_out_error_percent_of_the_signal"]) == pytest.approx([40.0, 20.0, 10.0])
    for chart in figures.against_motion(moved):
        held = columns(chart)
        assert np.all(held["forward_torque_N_m"] == 5.0) and np.all(held["reverse_torque_N_m"] == -5.0)
        assert {s.mark for s in chart.panels[0].series} == {"o", "x"}  # told apart without colour
    write_files(figures.time_and_band(t[0], corrected=True), tmp_path)
    assert (tmp_path / "residual-hammer.png").read_bytes().startswith(b"\x89PNG")
    table = np.genfromtxt(tmp_path / "residual-hammer.csv", delimiter=",", names=True)
    assert np.nanmax(np.abs(table["1_recorded_m_s2"])) == pytest.approx(1.0, rel=1e-3)


def test_a_plot_that_the_channels_do_not_permit_names_what_is_missing():
    for found in figures.against_motion("an angle at the motor"):
        assert isinstance(found, Missing)
    text = page("t", "v", [Section(heading="h", charts=figures.against_motion("an angle at the motor"))])
    assert "Missing: an angle at the motor." in text


def test_levels_are_cut_where_the_excitation_steps():
    groups = level_groups(np.array([10.0, 1.0, 1.1, 9.5, 3.0]))
    assert [set(g.tolist()) for g in groups] == [{1, 2}, {4}, {0, 3}]
    assert len(level_groups(np.full(5, 2.0))) == 1
    assert len(level_groups(2.0 ** np.arange(9.0))) == 4


def test_the_usable_band_of_a_half_sine_ends_where_its_spectrum_is_a_tenth():
    rate, length = 8192.0, 40.0 / 8192.0
    force = np.zeros(8192)
    n = 40
    force[1000 : 1000 + n] = np.sin(np.pi * np.arange(n) / n)
    _, end = usable_band((Hit("a", rate, force),))
    x = end * length  # |F| ~ |cos(pi f T) / (1 - 4 f^2 T^2)|
    assert abs(np.cos(np.pi * x) / (1.0 - 4.0 * x * x)) == pytest.approx(0.1, abs=0.02)


def test_h1_of_records_is_the_filter_that_made_them_and_its_coherence_one():
    generator = np.random.default_rng(1)
    u = [np.concatenate([generator.normal(size=2048), np.zeros(2048)]) for _ in range(5)]
    y = [sosfilt(butter(2, 60.0, fs=RATE, output="sos"), x) for x in u]
    found = h1(u, y, RATE, 10**9)
    expected = freqz_sos(butter(2, 60.0, fs=RATE, output="sos"), worN=found.frequency, fs=RATE)[1]
    inside = found.frequency < 100.0
    assert np.abs(found.h - expected)[inside].max() < 0.02
    assert found.coherence[inside].min() > 0.999


def test_what_turns_with_the_motor_lies_on_its_line_and_a_fixed_tone_does_not():
    t = np.arange(int(20 * RATE)) / RATE
    speed = np.linspace(0.2, 2.0, t.size)
    angle = np.cumsum(speed) / RATE
    ratio = 50.0
    for tone, follows in ((np.sin(ratio * angle), True), (np.sin(2.0 * np.pi * 9.0 * t), False)):
        speeds, frequencies, power = speed_map([(tone, speed, RATE)], 40.0)
        w = 0.5 * (speeds[1:] + speeds[:-1])
        ridge = frequencies[np.argmax(np.where(np.isnan(power), -1.0, power), axis=0)] + 1.0
        seen = ~np.all(np.isnan(power), axis=0)
        off = np.abs(ridge - ratio * w / (2.0 * np.pi))[seen]
        assert bool(off.max() < 2.5) is follows


@pytest.mark.parametrize("value", [
    {"numerics": 0.01, "left_out": 0.6},
    {"backlash@transmission": {"gap": {"value": 6e-5, "unit": "rad"}, "found": False}},
    [{"item": "slow ramp", "expected_gain": 0.3}, {"item": "payload", "distance": None}],
])  # fmt: skip
def test_plain_data_of_any_shape_becomes_a_table(value):
    table = tables.plain_table(value)
    assert table is not None and all(len(row) == len(table.columns) for row in table.rows)
    assert "{" not in str(table.rows)


def test_outside_the_calibrated_range_the_ranking_says_so():
    row = {"effects": ["backlash@transmission"], "probability": 0.9, "score": 3.0, "held_out_error": 0.125}
    outside = {"in_domain": False, "reason": "the rates differ"}
    asked = answer("effects", effects=[PLAY | {"evidence": ""}]) | {"ranking": [row]}
    told = str(tables.ranking(asked | {"calibration": outside}, sliding=False).notes)
    assert tables.ranking(asked, sliding=False).table.rows[0][-1] == "0.1250"
    assert "outside" in told and "the rates differ" in told
    assert "outside" not in str(tables.ranking(asked, sliding=False).notes)


def test_what_could_not_be_seen_is_told_in_the_trades_unit():
    row = {"effect": "backlash", "location": "transmission", "parameter": "gap", "size": math.radians(0.2 / 60.0),
           "unit": "rad", "sentence": None, "reason": "the weight closes it"}  # fmt: skip
    (section,) = tables.not_seen({"not_seen": [row]})
    assert "0.200 arcmin" in str(section.table.rows) and "the weight closes it" in str(section.table.rows)
    assert tables.not_seen({"not_seen": []}) == []


def test_what_was_put_right_on_the_way_is_told():
    """A reader of the page or of the terminal learns that a sensor was turned, or an angle taken from a drive's law."""
    told = {
        **answer("none", held=False),
        "held_out_reason": "one run",
        "parameters": {},
        "findings": ["angle at the motor (run r1): polarity inverted"],
    }
    (section,) = tables.findings(told)
    assert section.text == ("Angle at the motor (run r1): polarity inverted.",)
    assert tables.findings({"findings": []}) == []
    assert "found on the way: angle at the motor (run r1): polarity inverted\n" in summary(told, Path("out"))


def test_markup_stands_in_the_page_as_it_is_and_text_is_escaped():
    text = page("t", "a < b", [Section(heading="h", text=("<x>",), markup="<svg></svg>")])
    assert "<svg></svg>" in text and "&lt;x&gt;" in text and "a &lt; b" in text
    assert not re.search(r"(src|href)=.?http", text)
