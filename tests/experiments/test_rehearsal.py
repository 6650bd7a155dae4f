"""A likeness repeats the recordings it was taken from; a concealed effect shows in it; the table counts what was said."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.noise import NoiseModel, block_key
from jointscope.diagnosis.power import Unseen
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.errors import RefusedError
from jointscope.experiments.prove.next_experiment_check import noisier, recorded, small
from jointscope.experiments.rehearsal.likeness import likeness, rehearsed, rig_of
from jointscope.experiments.rehearsal.page import text, write_page
from jointscope.experiments.rehearsal.rehearse import NOTHING, Case, summarise
from jointscope.experiments.rehearsal.sizing import sized
from jointscope.sim.concealed import catalogue as concealed
from jointscope.sim.concealed.bench import draw_bench


@pytest.fixture(scope="module")
def bench():
    found = noisier(small(draw_bench(np.random.default_rng(5), "development", experiments="HS")), 0.3)
    takes = found.plan.takes
    hits = [take for take in takes if take.braked][:2]
    return replace(found, plan=replace(found.plan, takes=(*hits, *[t for t in takes if not t.braked][:1])))


@pytest.fixture(scope="module")
def like(bench):
    campaign = recorded(bench, (), 1)
    problem = prepare(campaign)
    with ThreadPoolExecutor(1) as pool:
        stage = refit_base(problem, predict_outputs, tuple(range(len(problem.runs))), pool)
    theta, _ = stage.fit.coordinates.unpack(stage.fit.x)
    return likeness(campaign, problem, theta, stage.noise, 1)


def channel(run, quantity):
    return np.asarray(next(s for s in run.signals if s.channel.quantity == quantity).samples)


def test_the_likeness_has_the_rigs_numbers(like, bench):
    true = bench.rig.joint
    assert like.rig.joint.stiffness == pytest.approx(true.stiffness, rel=0.03)
    assert like.rig.joint.load_inertia == pytest.approx(true.load_inertia, rel=0.03)
    assert like.rig.gravity_torque(0.3) == pytest.approx(bench.rig.gravity_torque(0.3), rel=0.01)
    assert not like.left_out


def test_a_rehearsal_of_nothing_repeats_the_recordings(like):
    again = rehearsed(replace(like, noise=NoiseModel({}, 0.0, 0.0)), (), 1)
    for was, now in zip(like.problem.runs, again.runs, strict=True):
        a, b = channel(was.run, "linear-acceleration"), channel(now, "linear-acceleration")
        assert a.shape == b.shape
        if was.mode == "braked":  # nothing but the recording's own noise, seen in its tail, is left
            assert np.std(a - b) < 1.2 * np.std(a[-200:]) + 0.05 * np.std(a)
        assert np.corrcoef(a, b)[0, 1] > 0.85
        assert [s.channel.column for s in was.run.signals] == [s.channel.column for s in now.signals]


def test_the_rehearsed_noise_is_as_loud_as_the_diagnosis_measured(like):
    quiet, loud = rehearsed(replace(like, noise=NoiseModel({}, 0.0, 0.0)), (), 1), rehearsed(like, (), 1)
    for run, a, b in zip(like.problem.runs, quiet.runs, loud.runs, strict=True):
        added = channel(b, "linear-acceleration") - channel(a, "linear-acceleration")
        assert np.all(np.isfinite(added))
        output = next(o for o in run.outputs if o.quantity == "linear-acceleration")
        block = like.noise.blocks[block_key(run, output)]
        assert np.std(added[-200:]) > 0.5 * block.marginal


def test_noise_differs_from_seed_to_seed_and_repeats_with_it(like):
    one, two, again = (channel(rehearsed(like, (), seed).runs[0], "linear-acceleration") for seed in (1, 2, 1))
    assert np.array_equal(one, again) and not np.array_equal(one, two)


def test_a_concealed_effect_shows(like):
    law = next(x for x in concealed.laws("development") if x.effect == "stiffness-nonlinearity" and not x.departs)
    said = Unseen("stiffness-nonlinearity", "transmission", "", "cubic", "N m/rad^3", 1.0, {}, "noise", None)
    rng = np.random.default_rng(1)
    one, two = (sized(law, like.setting, said, factor, rng) for factor in (1e10, 2e10))
    assert one is not None and two is not None
    values = [e.reported(like.setting)["cubic"] for e in (one, two)]
    assert values[1] == pytest.approx(2.0 * values[0], rel=0.1)


def test_a_carriage_without_a_spring_is_refused(like):
    runs = tuple(replace(run, spring=False) for run in like.problem.runs)
    with pytest.raises(RefusedError, match="nothing to rehearse"):
        likeness(like.campaign, replace(like.problem, runs=runs), like.problem.base.start, like.noise, 1)


def test_a_rig_without_a_nameplate_still_has_room_for_its_mass(like):
    bare = replace(like.problem, rig=replace(like.problem.rig, arm_mass=None, arm_com_radius=None))
    rig = rig_of(bare, like.problem.base.start)
    assert rig.arm_mass * rig.arm_com_radius**2 < rig.joint.load_inertia


def test_the_table_counts_what_was_said(tmp_path):
    found = [
        Case("a", NOTHING, {}, (), "none", 0.9, "answered"),
        Case("b", "backlash@transmission", {"gap": 1e-4}, ("backlash@transmission",), "effects", 0.9, "answered"),
        Case("c", "backlash@transmission", {"gap": 1e-4}, (), "unknown", 0.6, "answered"),
        Case("d", "delay@acquisition", {"delay": 1e-3}, (), "timed-out", None, "timed-out"),
    ]
    summary = summarise(found, {"asked": {"size": 4.0}, "left_out": ["run x: no force"]})
    assert summary["named"]["hits"] == 1 and summary["named"]["cases"] == 3
    assert summary["noticed"]["hits"] == 2 and summary["false_alarms"]["hits"] == 0
    assert summary["confusion"]["delay@acquisition"] == {"failed": 1}
    told = text(summary)
    assert "backlash@transmission, unknown" in told and "left out: run x" in told
    write_page(summary, tmp_path)
    assert (tmp_path / "rehearsal.png").stat().st_size > 1000
    assert "on your recordings" in (tmp_path / "rehearsal.md").read_text(encoding="utf-8")
