"""What is written reads back: every format, every key, every digit."""

import math
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream
from jointscope.recordings.reader import read_campaign
from jointscope.recordings.stream_columns import LARGEST
from jointscope.recordings.units import FIXED, si_factor
from jointscope.recordings.writer import only_inputs, write_campaign

RIG = Nameplate(topology="two-inertia", motion="rotational", reduction_ratio=141.0, pole_pairs=5, efficiency=0.7)


def channel(rng, column, quantity, unit, location, role="output", n=80, **more):
    return Channel(
        column=column, quantity=quantity, unit=unit, location=location, role=role,
        samples=rng.standard_normal(n), **more,
    )  # fmt: skip


def streams(rng, n=80):
    hammer = Stream(
        file="data/hit.csv", sampling_rate=1024.0, start=-0.1, start_uncertainty=1e-4, length=n, sync="f",
        channels=(
            channel(rng, "f", "force", "lbf", "arm", "input", n, radius=0.8, full_scale=2000.0),
            channel(rng, 'a "1", x', "linear-acceleration", "g_n", "arm", "output", n, radius=0.95, coupling="ac",
                    low_cutoff=0.5, direction="radial", point=(0.1, 0.0, 0.0), body="arm"),
            channel(rng, "raw", "force", "mV", "arm", "output", n, radius=0.1, sensitivity=2.4),
            channel(rng, "unknown", "force", "1", "arm", "output", n, radius=0.1),
            channel(rng, "flipped", "angle", "1", "arm", "output", n, scale=-math.pi / 180.0),
        ),
    )  # fmt: skip
    drive = Stream(
        file="data/hit.csv", sampling_rate=500.0, start_uncertainty=math.inf, length=n, gaps="mask",
        channels=(
            channel(rng, "tq", "torque", "permille", "motor", "input", n, rated_torque=1.3, side="output"),
            channel(rng, "iq", "current", "A", "motor", "input", n, per="rms"),
            channel(rng, "enc", "angle", "counts", "motor", "output", n, counts_per_turn=131072.0),
            channel(rng, "w", "angular-velocity", "rpm", "motor", "output", n),
        ),
    )  # fmt: skip
    frf = Stream(
        file="frf.csv", sampling_rate=200.0, length=50, frequency=np.linspace(0.0, 100.0, 50),
        channels=(
            Channel(
                column="H", quantity="frf", unit="m/s^2/N", location="arm", role="output", form="accelerance",
                radius=0.8, reference_radius=0.6, averages=7, coherence=rng.random(50),
                samples=rng.standard_normal(50) + 1j * rng.standard_normal(50),
            ),
        ),
    )  # fmt: skip
    return hammer, drive, frf


def campaign(rng):
    hammer, drive, frf = streams(rng)
    runs = (
        Run(id="take 1", experiment="hammer", streams=(hammer, drive), brake=True, arm_angle=-1.0, repeat_of="x",
            role="validate"),
        Run(id="take ü", experiment="free", streams=(frf,), initial="estimate", hold={"": "free"}),
    )  # fmt: skip
    return Campaign(path=Path("."), rig=RIG, runs=runs, title='a "title"\n', notes="tab\there")


def assert_same(left, right, skip=()):
    for field in fields(left):
        a, b = getattr(left, field.name), getattr(right, field.name)
        if field.name in ("path", "file", *skip):
            continue
        if isinstance(a, np.ndarray):
            np.testing.assert_allclose(a, b, rtol=4e-16, atol=0.0, err_msg=field.name)
        elif isinstance(a, tuple) and a and hasattr(a[0], "__dataclass_fields__"):
            assert len(a) == len(b)
            for x, y in zip(a, b, strict=True):
                assert_same(x, y, skip)
        else:
            assert a == b, field.name


@pytest.mark.parametrize("file_format", ["csv", "npz", "h5"])
def test_a_campaign_written_and_read_is_the_same_campaign(rng, tmp_path, file_format):
    original = campaign(rng)
    written = write_campaign(original, tmp_path / "c", file_format=file_format)
    assert_same(original, read_campaign(written))


def test_reading_and_writing_again_changes_no_file(rng, tmp_path):
    first = write_campaign(campaign(rng), tmp_path / "one")
    second = write_campaign(read_campaign(first), tmp_path / "two")
    third = write_campaign(read_campaign(second), tmp_path / "three")
    for file in sorted(second.rglob("*.*")):
        assert file.read_text() == (third / file.relative_to(second)).read_text()


def test_an_existing_campaign_is_never_overwritten(rng, tmp_path):
    write_campaign(campaign(rng), tmp_path / "c")
    with pytest.raises(FileExistsError, match="exists already"):
        write_campaign(campaign(rng), tmp_path / "c")


def test_missing_samples_survive_as_gaps(rng, tmp_path):
    hammer, *_ = streams(rng)
    samples = np.array(hammer.channels[0].samples)
    samples[5:8] = np.nan
    holed = replace(hammer, gaps="mask", channels=(replace(hammer.channels[0], samples=samples),))
    original = Campaign(path=Path("."), rig=RIG, runs=(Run(id="a", experiment="free", streams=(holed,)),))
    for file_format in ("csv", "npz", "h5"):
        back = read_campaign(write_campaign(original, tmp_path / file_format, file_format=file_format))
        assert np.flatnonzero(np.isnan(back.runs[0].signals[0].samples)).tolist() == [5, 6, 7]


def test_only_the_inputs_are_given_for_prediction(rng, tmp_path):
    blind = only_inputs(campaign(rng))
    blind = replace(blind, runs=blind.runs[:1])
    back = read_campaign(write_campaign(blind, tmp_path / "c"), missing_outputs="allow")
    assert [s.channel.column for s in back.runs[0].signals if s.channel.samples is not None] == ["f", "tq", "iq"]
    assert len(back.runs[0].signals) == 9


texts = st.text(st.characters(codec="utf-8", exclude_categories=["Cs"]), max_size=20)
names = st.text(
    st.characters(codec="utf-8", exclude_categories=["Cs", "Cc", "Zs", "Zl", "Zp"]), min_size=1, max_size=8
)
sizes = st.floats(1e-6, 1e9)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(title=texts, notes=texts, columns=st.lists(names, min_size=1, max_size=3, unique=True),
       rate=sizes, start=st.floats(-1e3, 1e3), radius=sizes, gains=st.floats(1e-9, 1e9), data=st.data())  # fmt: skip
def test_any_text_and_any_number_round_trips(
    tmp_path_factory, title, notes, columns, rate, start, radius, gains, data
):
    values = data.draw(st.lists(st.floats(-LARGEST, LARGEST), min_size=64, max_size=70))
    channels = tuple(
        Channel(column=c if not c.startswith("#") else f"c{c}", quantity="force", unit="1", scale=None,
                location="arm", role="input", radius=radius, full_scale=gains, samples=np.array(values))
        for c in columns
    )  # fmt: skip
    if len({c.column for c in channels}) < len(channels):
        return
    stream = Stream(file="x.csv", sampling_rate=rate, start=start, length=len(values), channels=channels)
    run = Run(id="r", experiment="hammer", streams=(stream,), arm_angle=start)
    original = Campaign(path=Path("."), rig=RIG, runs=(run,), title=title, notes=notes)
    back = read_campaign(write_campaign(original, tmp_path_factory.mktemp("c") / "c"))
    assert (back.title, back.notes) == (title, notes)
    assert_same(original.runs[0], back.runs[0])


@pytest.mark.parametrize(
    ("quantity", "unit", "one", "more"),
    [
        ("linear-acceleration", "g_n", 9.80665, {}),
        ("force", "lbf", 4.4482216152605, {}),
        ("torque", "lbf ft", 1.3558179483314, {}),
        ("torque", "mN m", 1e-3, {}),
        ("force", "mV", 1 / 2.5, {"sensitivity": 2.5}),
        ("angle", "deg", math.pi / 180, {}),
        ("angle", "arcmin", math.pi / 180 / 60, {}),
        ("angle", "arcsec", math.pi / 180 / 3600, {}),
        ("angular-velocity", "rpm", 2 * math.pi / 60, {}),
        ("angle", "counts", 2 * math.pi / 4096, {"counts_per_turn": 4096.0}),
        ("torque", "%", 0.013, {"rated_torque": 1.3}),
        ("torque", "permille", 0.0013, {"rated_torque": 1.3}),
        ("current", "permille", 0.005, {"rated_current": 5.0}),
        ("force", "1", 2.5, {"scale": 2.5}),
        ("force", "1", 1.0, {}),
    ],
)
def test_one_of_each_unit_in_si(quantity, unit, one, more):
    made = Channel(column="c", quantity=quantity, unit=unit, location="arm", role="output", **more)
    assert si_factor(made) == pytest.approx(one, rel=1e-12)


def test_every_quantity_has_its_si_unit_first():
    assert all(next(iter(units.values())) == 1.0 for units in FIXED.values())
