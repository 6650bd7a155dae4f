"""Time stamps, windows, gaps and clocks: what the samples are when the clock isn't the counter."""

import math

import numpy as np
import pytest

from jointscope.errors import CampaignError
from jointscope.recordings.reader import read_campaign

RATE = 1000.0


def signal(t):
    """Three tones up to 0.6 of half the rate, and an offset."""
    return (
        3.0
        + np.sin(2 * np.pi * 17.0 * t)
        + 0.5 * np.cos(2 * np.pi * 133.0 * t)
        + 0.3 * np.sin(2 * np.pi * 300.0 * t)
    )


def campaign(folder, stamps, values, stream="", digits=17):
    """One encoder stream with time stamps, as read."""
    rows = [f"{t:.{digits}g},{'' if np.isnan(v) else repr(float(v))}" for t, v in zip(stamps, values, strict=True)]
    (folder / "a.csv").write_text("t,q\n" + "\n".join(rows) + "\n")
    (folder / "campaign.toml").write_text(
        'format = "jointscope-campaign/1"\n[rig]\ntopology = "two-inertia"\nmotion = "rotational"\n'
        'plane = "horizontal"\n[[run]]\nid = "a"\nexperiment = "free"\n[[run.stream]]\nfile = "a.csv"\n'
        f"sampling_rate = {RATE}\n{stream}\n"
        'channels = [{ column = "q", quantity = "angle", unit = "rad", location = "arm", role = "output" }]\n'
    )
    run = read_campaign(folder).runs[0]
    return run.streams[0], run.signals[0].samples


def test_jittered_stamps_are_put_on_the_grid_band_limited(tmp_path, rng):
    """A fifth of a sample of jitter costs 20 % at 300 Hz if the rows are taken as uniform; resampled, next to nothing."""
    t = np.arange(2000) / RATE
    late = t + rng.uniform(-0.2, 0.2, t.size) / RATE
    late[0] = 0.0
    stream, found = campaign(tmp_path, late, signal(late), 'time = "t"')
    inside = slice(60, -60)
    assert np.max(np.abs(found - signal(t))[inside]) < 2e-3
    assert np.max(np.abs(signal(late) - signal(t))[inside]) > 0.1
    assert stream.jitter == pytest.approx(0.2 / RATE, rel=0.05)


def test_exact_stamps_leave_the_samples_untouched(tmp_path):
    t = 5.25 + np.arange(300) / RATE
    stream, found = campaign(tmp_path, t, signal(t), 'time = "t"')
    np.testing.assert_array_equal(found, signal(t))
    assert stream.start == 5.25
    assert stream.jitter < 1e-9


def test_stamps_printed_with_few_digits_are_rounded_and_not_jittered(tmp_path):
    t = np.arange(300) / RATE
    _, found = campaign(tmp_path, np.round(t + 4e-4, 3), signal(t), 'time = "t"\nstart = 0.0')
    np.testing.assert_array_equal(found, signal(t))


def test_missing_rows_and_empty_cells_become_unscored_samples(tmp_path, rng):
    t = np.arange(500) / RATE
    values = signal(t)
    values[100] = np.nan
    keep = np.ones(t.size, bool)
    keep[200:230] = False
    with pytest.raises(CampaignError, match=r"a\.csv: t: 30 rows are missing.*mask"):
        campaign(tmp_path, t[keep], values[keep], 'time = "t"')
    _, found = campaign(tmp_path, t[keep], values[keep], 'time = "t"\ngaps = "mask"')
    assert found.size == 500
    assert np.flatnonzero(np.isnan(found)).tolist() == [100, *range(200, 230)]
    np.testing.assert_array_equal(found[~np.isnan(found)], values[keep & ~np.isnan(values)])


def test_gaps_and_jitter_together(tmp_path, rng):
    t = np.arange(1500) / RATE
    late = t + rng.uniform(-0.15, 0.15, t.size) / RATE
    late[0] = 0.0
    keep = np.ones(t.size, bool)
    keep[700:900] = False
    _, found = campaign(tmp_path, late[keep], signal(late[keep]), 'time = "t"\ngaps = "mask"')
    far = np.r_[100:640, 960:1400]
    assert np.max(np.abs(found - signal(t))[far]) < 2e-3
    assert np.isnan(found[700:900]).all()


def test_a_rate_a_few_ppm_off_is_no_gap(tmp_path):
    t = np.arange(20_000) / (RATE * (1 + 20e-6))
    stream, found = campaign(tmp_path, t, signal(t), 'time = "t"')
    assert stream.length == 20_000
    grid = np.arange(20_000) / RATE
    assert np.max(np.abs(found - signal(grid))[60:-60]) < 2e-3


@pytest.mark.parametrize(
    ("stamps", "words"),
    [
        (lambda t: t[::-1], "does not increase"),
        (lambda t: np.r_[t[:50], t[49:-1]], "does not increase"),
        (lambda t: t * 1000.0, r"sampling_rate = 1000.0: t steps by 1 s"),
        (lambda t: np.r_[t[:-1], math.inf], "inf"),
    ],
)
def test_stamps_that_are_no_clock_are_refused(tmp_path, stamps, words):
    t = np.arange(300) / RATE
    with pytest.raises(CampaignError, match=words):
        campaign(tmp_path, stamps(t), signal(t), 'time = "t"')


def test_a_window_takes_its_part_and_start_is_its_first_sample(tmp_path):
    t = np.arange(1000) / RATE
    stream, found = campaign(tmp_path, t, signal(t), "window = [0.25, 0.75]\nstart = 0.1")
    np.testing.assert_array_equal(found, signal(t)[250:750])
    assert stream.times[0] == pytest.approx(0.1)


def test_a_window_on_time_stamps_is_in_their_time(tmp_path):
    t = 100.0 + np.arange(1000) / RATE
    stream, found = campaign(tmp_path, t, signal(t), 'window = [100.25, 100.75]\ntime = "t"')
    np.testing.assert_array_equal(found, signal(t)[250:750])
    assert stream.start == pytest.approx(100.25)


def test_an_unknown_start_is_a_nuisance_without_bounds(tmp_path):
    t = np.arange(100) / RATE
    stream, _ = campaign(tmp_path, t, signal(t), 'start = "unknown"')
    assert math.isinf(stream.start_uncertainty)
    stream, _ = campaign(tmp_path, t, signal(t), "start = 0.5\nstart_uncertainty = 0.002")
    assert (stream.start, stream.start_uncertainty) == (0.5, 0.002)
