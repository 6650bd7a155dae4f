"""``jointscope predict``: files as the format says, inputs only, one line for what can't be done."""

import csv
import json

import numpy as np
import pytest

from jointscope.cli import main
from jointscope.identification.model_file import write_model
from jointscope.recordings.reader import read_campaign
from jointscope.recordings.writer import only_inputs, write_campaign


@pytest.fixture
def laid_out(bench, rng, tmp_path):
    """A model and a campaign on disk: a braked hit with force and acceleration, an encoder in degrees at half the rate."""
    t = np.arange(512) / 1024.0
    force = 300.0 * np.exp(-0.5 * ((t - 0.05) / 0.003) ** 2)
    fast = bench.stream(
        1024.0,
        bench.channel("force", "arm", "input", force, column="F", unit="N", radius=0.8),
        bench.channel(
            "linear-acceleration", "arm", "output", rng.standard_normal(512), column="a", unit="m/s^2", radius=0.95
        ),
    )
    slow = bench.stream(
        512.0, bench.channel("angle", "arm", "output", rng.standard_normal(256), column="q, deg", unit="deg")
    )
    from dataclasses import replace

    slow = replace(slow, file="b.csv")
    campaign = bench.campaign(bench.run("hammer", fast, slow, id="hit", brake=True))
    write_campaign(campaign, tmp_path / "full")
    write_campaign(only_inputs(campaign), tmp_path / "inputs")
    write_model(tmp_path / "model.json", bench.model())
    return tmp_path


def rows(path):
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def predict(folder, campaign, out, *more):
    return main(["predict", str(folder / "model.json"), str(folder / campaign), "--out", str(folder / out), *more])


def test_inputs_alone_give_the_same_files_as_the_full_campaign(laid_out):
    """What sensors recorded scores a prediction and never makes it."""
    assert predict(laid_out, "full", "one", "--no-pictures") == 0
    assert predict(laid_out, "inputs", "two", "--declared") == 0
    assert (laid_out / "one/hit.csv").read_bytes() == (laid_out / "two/hit.csv").read_bytes()
    assert not (laid_out / "two/scores.json").exists()


def test_streams_share_the_time_column_and_leave_cells_empty(laid_out):
    predict(laid_out, "inputs", "out", "--declared")
    table = rows(laid_out / "out/hit.csv")
    assert list(table[0]) == ["time", "a", "q, deg"]
    assert len(table) == 512
    assert sum(row["q, deg"] != "" for row in table) == 256
    assert all(row["a"] != "" for row in table)
    assert [float(row["time"]) for row in table[:3]] == pytest.approx([0.0, 1 / 1024, 2 / 1024], abs=1e-9)


def test_values_are_in_the_channel_s_own_unit(laid_out):
    predict(laid_out, "inputs", "out", "--declared")
    degrees = np.array([float(r["q, deg"]) for r in rows(laid_out / "out/hit.csv") if r["q, deg"]])
    # at rest first, then 300 N over 7.5 ms at 0.8 m: 1.8 N m s / (J w), less as the pulse is long: 1.7 mrad
    assert degrees[0] == pytest.approx(0.0, abs=1e-6)
    assert np.degrees(0.0014) < np.max(np.abs(degrees)) < np.degrees(0.002)


def test_undeclared_columns_are_not_written(laid_out):
    assert predict(laid_out, "inputs", "out") == 0
    assert list(rows(laid_out / "out/hit.csv")) == []


def test_scores_are_written_and_printed_as_json(laid_out, capsys):
    assert predict(laid_out, "full", "out", "--json", "--no-pictures") == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed == json.loads((laid_out / "out/scores.json").read_text())
    channel = printed["runs"]["hit"]["channels"]["a"]
    assert channel["error"] > 0.5  # the recording is noise
    assert channel["bands"][0]["low_hz"] == 2.0


def test_a_picture_is_drawn_where_outputs_were_recorded(laid_out):
    predict(laid_out, "full", "out")
    assert (laid_out / "out/hit.png").stat().st_size > 10_000


@pytest.mark.parametrize(
    ("content", "says"), [("{", "not JSON"), ("[]", "format"), ('{"format": "other"}', "format")]
)
def test_a_broken_model_is_refused_with_one_line(laid_out, capsys, content, says):
    (laid_out / "model.json").write_text(content)
    assert predict(laid_out, "full", "out") == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    assert "model.json" in error
    assert says in error


def test_a_missing_model_says_how_to_make_one(laid_out, capsys):
    (laid_out / "model.json").unlink()
    assert predict(laid_out, "full", "out") == 2
    assert "jointscope identify" in capsys.readouterr().err


def test_renaming_everything_renames_the_columns_and_nothing_else(laid_out):
    predict(laid_out, "inputs", "one", "--declared")
    text = (laid_out / "inputs/campaign.toml").read_text()
    assert read_campaign(laid_out / "inputs", missing_outputs="allow").runs[0].id == "hit"
    (laid_out / "inputs/campaign.toml").write_text(text.replace('"hit"', '"other"').replace('"a"', '"z"'))
    predict(laid_out, "inputs", "two", "--declared")
    one, two = rows(laid_out / "one/hit.csv"), rows(laid_out / "two/other.csv")
    assert [row["a"] for row in one] == [row["z"] for row in two]


def test_a_diagnosed_model_is_handed_to_the_room_that_wrote_it(laid_out, monkeypatch):
    """Any other kind goes to the diagnosis; its channels are known by their column, as it may have copied them."""
    from dataclasses import replace

    from jointscope.diagnosis import predict_file

    def predicted(model, campaign):
        assert model["kind"] == "diagnosis"
        return {
            run.id: [
                (
                    replace(signal, channel=replace(signal.channel, samples=None)),
                    np.full(signal.stream.length, 0.5),
                )
                for signal in run.select(role="output", recorded=False)
            ]
            for run in campaign.runs
        }

    monkeypatch.setattr(predict_file, "predict_campaign", predicted)
    (laid_out / "model.json").write_text('{"format": "jointscope-model/1", "kind": "diagnosis"}')
    assert predict(laid_out, "full", "out", "--no-pictures") == 0
    table = rows(laid_out / "out/hit.csv")
    assert table[0]["a"] == "0.5"
    assert float(table[0]["q, deg"]) == pytest.approx(np.degrees(0.5))
    scores = json.loads((laid_out / "out/scores.json").read_text())
    assert set(scores["runs"]["hit"]["channels"]) == {"a", "q, deg"}
