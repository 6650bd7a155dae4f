"""Another simulator's outputs: scored, read for what they behave like, and what can't be told from them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from jointscope.errors import CampaignError
from jointscope.experiments.own_model import behaviour
from jointscope.experiments.own_model.behaviour import (
    behaviour_json,
    compare_behaviour,
    read_simulated,
    score_outputs,
    white_noise,
    with_noise_of,
)
from jointscope.experiments.own_model.sections import simulation_sections
from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Signal, Stream
from jointscope.recordings.writer import write_campaign

RATE = 512.0
RIG = Nameplate(topology="single-dof", motion="rotational", plane="horizontal", ground_spring=True)


def output(quantity: Any, samples: np.ndarray) -> Channel:
    samples = np.asarray(samples, dtype=np.float64)
    samples.setflags(write=False)
    unit = "rad" if quantity == "angle" else "rad/s^2"
    return Channel(column=quantity, quantity=quantity, unit=unit, location="arm", role="output", samples=samples)


def campaign(gain: float = 1.0, *, late: float = 0.0, noise: float = 0.0, runs: int = 3) -> Campaign:
    """A decaying oscillation; ``gain`` and ``late`` [s] act on the accelerometer alone."""
    rng = np.random.default_rng(3)
    t = np.arange(512) / RATE
    made = []
    for k in range(runs):

        def swing(at: np.ndarray, size: float = 1.0 + k) -> np.ndarray:
            return size * np.exp(-6.0 * at) * np.sin(2.0 * np.pi * 9.0 * at)

        push = output("torque", np.zeros(t.size))
        push = replace(push, column="torque", unit="N m", role="input")
        channels = (push, output("angle", 1e-3 * swing(t)),
                    output("angular-acceleration", gain * swing(t - late) + noise * rng.normal(size=t.size)))  # fmt: skip
        stream = Stream(file=f"r{k}.csv", sampling_rate=RATE, length=t.size, channels=channels)
        made.append(Run(id=f"r{k}", experiment="hammer", brake=True, streams=(stream,)))
    return Campaign(path=Path("bench"), rig=RIG, runs=tuple(made))


ANSWER = {"held_out": {"runs": ["r1"]}}


def test_the_same_outputs_have_no_error() -> None:
    scores = score_outputs(campaign(), campaign(), ANSWER)
    assert scores.runs == ("r1",)
    assert scores.held_out
    assert all(e.error == 0.0 for e in scores.every_run)
    assert scores.missing == ()


@pytest.mark.parametrize(("gain", "late"), [(1.08, 0.0), (1.0, 0.5e-3), (0.9, 1e-3)])
def test_one_channel_that_is_off_by_gain_and_delay_is_an_instrument(gain: float, late: float) -> None:
    scores = score_outputs(campaign(gain, late=late), campaign(), ANSWER)
    by_channel = {c.channel: c for c in scores.channels}
    accelerometer = by_channel["angular-acceleration@arm"]
    assert accelerometer.gain == pytest.approx(gain, rel=2e-3)
    assert accelerometer.delay == pytest.approx(late, abs=2e-5)
    assert accelerometer.explained > 0.99
    assert by_channel["angle@arm"].error == 0.0
    low, high = accelerometer.band
    assert low <= 9.0 <= high + 1.0


def test_a_wrong_frequency_is_no_gain_and_no_delay() -> None:
    original = campaign()
    t = np.arange(512) / RATE
    other = replace(original, runs=tuple(_other(run, 1.0 + k, t) for k, run in enumerate(original.runs)))
    scores = score_outputs(original, other, ANSWER)
    assert all(c.explained < 0.8 for c in scores.channels)


def _other(run: Run, size: float, t: np.ndarray) -> Run:
    y = size * np.exp(-6.0 * t) * np.sin(2.0 * np.pi * 11.0 * t)
    stream = run.streams[0]
    channels = (stream.channels[0], output("angle", 1e-3 * y), output("angular-acceleration", y))
    return replace(run, streams=(replace(stream, channels=channels),))


def test_white_noise_is_read_off_its_third_differences_beside_a_smooth_signal() -> None:
    rng = np.random.default_rng(0)
    t = np.arange(20000) / 1000.0
    assert white_noise(rng.normal(0.0, 0.3, t.size) + 20.0 * np.sin(2.0 * np.pi * 2.0 * t)) == pytest.approx(
        0.3, rel=0.05
    )


def test_the_simulation_gets_the_recordings_own_noise() -> None:
    noisy = with_noise_of(campaign(), campaign(noise=0.05), np.random.default_rng(1))
    clean = campaign()
    for run, original in zip(noisy.runs, clean.runs, strict=True):
        added = run.streams[0].channels[2].samples - original.streams[0].channels[2].samples
        assert np.std(added) == pytest.approx(0.05, rel=0.25)
        assert np.all(run.streams[0].channels[0].samples == original.streams[0].channels[0].samples)


def test_a_simulation_that_lacks_a_run_is_one_clear_line(tmp_path: Path) -> None:
    write_campaign(campaign(runs=2), tmp_path / "sim")
    with pytest.raises(CampaignError, match=r"run.id = 'r2': the recordings have this run") as caught:
        read_simulated(tmp_path / "sim", campaign())
    assert "\n" not in str(caught.value)


def side(stiffness: float, *effects: str) -> tuple[dict[str, Any], dict[str, Any]]:
    """``diagnosis.json`` and ``model.json`` of one side."""
    parameters = {
        "stiffness": {"value": stiffness, "unit": "N m/rad", "interval95": [0.998 * stiffness, 1.002 * stiffness]}
    }
    entries = [
        {"effect": name.split("@")[0], "location": name.split("@")[1], "parameters": {}} for name in effects
    ]
    answer = {"parameters": parameters, "verdict": "effects" if effects else "none", **ANSWER}
    return answer, {"base": {"stiffness": stiffness, "drive_gain": stiffness}, "effects": entries}


def reduced(model: dict[str, Any], recorded: Campaign) -> dict[str, list[tuple[Signal, np.ndarray]]]:
    """A stand-in for the reduced model: off by its stiffness, by friction it lacks and play it has."""
    effects = {e["effect"] for e in model["effects"]}
    off = 0.01 * abs(model["base"]["stiffness"] - 100.0)
    off += 0.2 * ("coulomb-friction" not in effects) + 0.1 * ("backlash" in effects)
    assert model["base"]["drive_gain"] == 100.0  # a nuisance of the recording, on both sides
    return {run.id: [(s, (1.0 - off) * s.samples) for s in run.select(role="output")] for run in recorded.runs}


def test_shares_add_up_and_name_what_only_one_side_has(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(behaviour, "predict_campaign", reduced)
    scores = score_outputs(campaign(), campaign(0.5), ANSWER)
    found = compare_behaviour(
        campaign(), scores, side(100.0, "coulomb-friction@load"), side(90.0, "backlash@transmission")
    )
    told = behaviour_json(found)
    assert found.left_out == ("coulomb-friction@load",)
    assert found.contradicted == ("backlash@transmission",)
    assert found.shares["parameters"] == pytest.approx(0.1)
    assert found.shares["left_out"] == pytest.approx(0.2)
    assert found.shares["contradicted"] == pytest.approx(0.1)
    assert found.emulated == pytest.approx(0.4)
    assert sum(found.shares.values()) + told["unsplit"] + told["remaining"] == pytest.approx(told["error"])
    assert told["shares"]["numerics"] is None
    assert found.parameters["stiffness"]["differs"]
    assert any("can't be told" in line for line in told["not_told"])
    assert next(s.heading for s in simulation_sections({"simulation": told})) == "Your simulation"


def test_a_simulation_that_behaves_like_the_machine_has_no_share(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(behaviour, "predict_campaign", reduced)
    right = side(100.0, "coulomb-friction@load")
    found = compare_behaviour(
        campaign(), score_outputs(campaign(), campaign(), ANSWER), right, side(100.1, "coulomb-friction@load")
    )
    assert found.shares == {"parameters": pytest.approx(0.001), "left_out": 0.0, "contradicted": 0.0}
    assert not found.parameters["stiffness"]["differs"]
