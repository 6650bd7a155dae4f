"""What is held out depends on the recordings alone."""

from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.split import split_runs


def take(level, seed, experiment="hammer", role=None):
    force = np.zeros(100)
    force[10:14] = level
    data = np.random.default_rng(seed).standard_normal(100)
    return SimpleNamespace(
        run=SimpleNamespace(experiment=experiment, brake=True, id=f"{seed}"), role=role, load_force=force,
        motor_torque=None, speed_command=None, outputs=(SimpleNamespace(data=data),),
    )  # fmt: skip


def held_seeds(runs):
    split = split_runs(SimpleNamespace(runs=tuple(runs)))
    return {runs[i].run.id for i in split.held_out}


@pytest.mark.parametrize("seed", range(3))
def test_order_does_not_matter(seed):
    """A permutation of the runs holds out the same takes."""
    runs = [take(10.0 * (1 + i % 4), i) for i in range(11)] + [take(5.0, 50 + i, "torque-sweep") for i in range(4)]
    shuffled = [runs[i] for i in np.random.default_rng(seed).permutation(len(runs))]
    assert held_seeds(runs) == held_seeds(shuffled)


def test_every_experiment_recorded_twice_keeps_one_back():
    """Each stratum is both fitted and held out."""
    runs = [take(10.0, 1), take(20.0, 2), take(5.0, 3, "speed-motion"), take(5.0, 4, "speed-motion")]
    assert len(held_seeds(runs)) == 2
    assert {runs[i].run.experiment for i in split_runs(SimpleNamespace(runs=tuple(runs))).held_out} == {
        "hammer",
        "speed-motion",
    }


def test_the_campaigns_own_roles_are_obeyed():
    """Runs marked validate, and only they, are held out."""
    runs = [take(10.0, 1), take(20.0, 2, role="validate"), take(30.0, 3)]
    assert held_seeds(runs) == {"2"}


def test_one_run_is_never_split():
    """A part of a run is no independent test; the reason says so."""
    split = split_runs(SimpleNamespace(runs=(take(1.0, 1),)))
    assert split.held_out == ()
    assert "one run only" in split.reason


def test_what_is_kept_back_is_loud_enough_to_show_something():
    """Two quiet sweeps and two loud ones: one of the loud is kept back and one fitted."""
    runs = [take(level, seed, "torque-sweep") for seed, level in enumerate((1.0, 1.01, 4.0, 4.01))]
    assert held_seeds(runs) == {"2"}
