"""What counts as visible: nothing that only the ends of a record make of a slow drift."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.sim.concealed.bench import draw_bench
from jointscope.sim.concealed.rehearsal import clean_channels
from jointscope.sim.concealed.yardstick import STEP, representatives, whiten, whitener

N = 2400


def visible(name, y, above=20):
    """|w| of one channel whose noise is white above bin ``above`` and hides everything below it."""
    weight = np.where(np.arange(N // 2 + 1) > above, np.sqrt(2.0 / N), 0.0)
    return float(np.linalg.norm(whiten([{name: y}], [{name: weight}])))


@pytest.mark.parametrize("name", ["motor", "arm"])
def test_an_angle_that_has_drifted_does_not_jump_back(name):
    """It moves by 30 standard deviations over the first second of three, and stays."""
    t = np.linspace(0.0, 3.0, N)
    drift = 30.0 * (1.0 - np.exp(-2.0 * t) * (1.0 + 2.0 * t))
    assert visible(name, drift) < 0.03 * visible("acceleration", drift)
    assert visible("acceleration", drift) > 50.0


def test_what_moves_in_the_record_is_as_visible_as_before():
    tone = np.sin(2.0 * np.pi * 60.0 * np.arange(N) / N)
    assert visible("motor", tone) == pytest.approx(np.sqrt(N / 2), rel=1e-3)
    assert visible("motor", tone) == pytest.approx(visible("acceleration", tone), rel=1e-3)


@pytest.fixture(scope="module")
def hits():
    """A bench of hits alone, with its noise raised so that the force's counts, at the yardstick's timestep."""
    bench = draw_bench(np.random.default_rng(11), "development", experiments="H")
    takes = tuple(replace(take, gain=0.0, late=0.0) for take in bench.plan.takes)
    plan = replace(bench.plan, takes=takes, timestep=STEP)
    return bench.rig, plan, replace(bench.noise, force=1.0)


def test_a_louder_hit_lies_along_what_the_force_cells_noise_does(hits):
    """h of the closed form against the engine: a hit of 1 % more force is that share of every sample of its contact."""
    rig, plan, noise = hits
    run = representatives(plan)[0]
    base = clean_channels(rig, plan, run, ())
    takes = list(plan.takes)
    takes[run] = replace(takes[run], force=1.01 * takes[run].force)
    louder = clean_channels(rig, replace(plan, takes=tuple(takes)), run, ())
    white = whitener(rig, plan, noise, (run,), [base])
    change = {name: louder[name] - base[name] for name in white.weights[0]}
    w = whiten([change], white.weights)
    along = white.pushed.T @ w
    assert np.linalg.norm(w - white.pushed @ along) < 0.05 * np.linalg.norm(w)
    share = 0.01 * base["force"][base["force"] > 1e-3 * base["force"].max()]  # in units of the noise, 1 N
    stands_for = len(plan.takes)
    assert np.linalg.norm(along / np.sqrt(1.0 / white.kept**2 - 1.0)) == pytest.approx(
        np.sqrt(stands_for) * np.linalg.norm(share), rel=0.1
    )


def test_what_is_kept_makes_noise_of_both_kinds_white(hits):
    """(I + U U')^(-1/2) of white noise and of what the force cell's does; where that is silent nothing changes."""
    rig, plan, noise = hits
    noise = replace(noise, force=50.0)
    runs = representatives(plan)
    base = [clean_channels(rig, plan, run, ()) for run in runs]
    white = whitener(rig, plan, noise, runs, base)
    assert white.pushed.T @ white.pushed == pytest.approx(np.eye(white.kept.size), abs=1e-9)
    assert np.all((white.kept > 0.0) & (white.kept <= 1.0)) and white.kept.min() < 0.05
    silent = whitener(rig, plan, replace(noise, force=0.0), runs, base)
    assert silent.kept.size == 0
    assert silent(base) == pytest.approx(whiten(base, silent.weights))
    assert np.linalg.norm(white(base)) < np.linalg.norm(silent(base))
