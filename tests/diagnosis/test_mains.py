"""A weak line of the mains is taken off as the recording's; a line of any other frequency, a strong one, or none is left."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.effects import catalogue
from jointscope.diagnosis.mains import without_hum
from jointscope.diagnosis.noise import dynamic_level
from jointscope.diagnosis.pipeline import diagnose
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare


def humming(builders, recorded, frequency, share, noise=0.01):
    """Six hits with white noise and a steady line, shares [-] of the records' rms, the line's phase its own in each."""
    plant = builders.Plant()
    own = prepare(builders.campaign_of([builders.hammer_run(plant, 100.0 + 40.0 * k, f"h{k}") for k in range(6)]))
    own = recorded(own, noise, seed=3)
    rng = np.random.default_rng(11)
    a = share * np.sqrt(2.0) * float(np.mean([dynamic_level(o) for run in own.runs for o in run.outputs]))

    def hums(output):
        phase = rng.uniform(0.0, 2.0 * np.pi)
        return replace(output, data=output.data + a * np.sin(2.0 * np.pi * frequency * output.times + phase))

    runs = [replace(run, outputs=tuple(hums(o) for o in run.outputs)) for run in own.runs]
    return own, replace(own, runs=tuple(runs))


def error(one, other):
    """RMS by which the records of two problems differ, over their own."""
    pairs = [
        (a, b)
        for r, s in zip(one.runs, other.runs, strict=True)
        for a, b in zip(r.outputs, s.outputs, strict=True)
    ]
    return float(np.mean([np.sqrt(np.mean(np.square(a.data - b.data))) / dynamic_level(a) for a, b in pairs]))


def test_a_weak_hum_is_taken_off_and_said(builders, recorded):
    """What remains of it is what six records of noise leave undecided."""
    clean, loud = humming(builders, recorded, 50.02, 0.012)
    quiet = without_hum(loud, loud.base.start, predict_outputs)
    assert error(clean, loud) > 0.01
    assert error(clean, quiet) < 0.2 * error(clean, loud)
    said = next(f for f in quiet.findings if f.startswith("hum"))
    assert float(said.split()[2]) == pytest.approx(50.02, abs=0.1)


def test_a_hum_below_the_noise_is_taken_off_whatever_its_share(builders, recorded):
    clean, loud = humming(builders, recorded, 50.02, 0.04, noise=0.08)
    quiet = without_hum(loud, loud.base.start, predict_outputs)
    assert error(clean, quiet) < 0.2 * error(clean, loud)


def test_with_a_multiple_its_fainter_ones_are_taken_off(builders, recorded):
    """Alone a line of 150 Hz as faint as this is left; beside one of 50 Hz it is the same grid's."""
    _, faint = humming(builders, recorded, 150.06, 0.0013)
    assert without_hum(faint, faint.base.start, predict_outputs) is faint
    rng = np.random.default_rng(7)

    def louder(output):
        a = 0.012 * np.sqrt(2.0) * dynamic_level(output)
        phase = rng.uniform(0.0, 2.0 * np.pi)
        return replace(output, data=output.data + a * np.sin(2.0 * np.pi * 50.02 * output.times + phase))

    both = replace(faint, runs=tuple(replace(r, outputs=tuple(map(louder, r.outputs))) for r in faint.runs))
    said = [f for f in without_hum(both, both.base.start, predict_outputs).findings if f.startswith("hum")]
    assert [round(float(f.split()[2])) for f in said] == [50, 150]


@pytest.mark.parametrize(("frequency", "share"), [(53.7, 0.012), (50.02, 0.1), (50.02, 0.0)])
def test_what_is_no_hum_stays(builders, recorded, frequency, share):
    """A fan's frequency; a line too strong for a cable's; none at all: the very same problem."""
    _, loud = humming(builders, recorded, frequency, share)
    assert without_hum(loud, loud.base.start, predict_outputs) is loud


@pytest.mark.parametrize(("frequency", "verdict"), [(50.02, "none"), (53.7, "effects")])
def test_a_hum_is_no_answer_and_a_fan_is(builders, recorded, one_effect, frequency, verdict):
    _, loud = humming(builders, recorded, frequency, 0.015)
    with ThreadPoolExecutor(2) as pool:
        found = diagnose(loud, predict_outputs, catalogue(loud), pool, effort=one_effect)
    assert found.decision.verdict == verdict
    assert any(f.startswith("hum") for f in found.problem.findings) is (verdict == "none")
    assert verdict == "none" or found.decision.chosen.names == ("external-vibration@base",)
