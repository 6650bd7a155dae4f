"""The score test is exact where everything is linear, and refuses signs that physics refuses."""

from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.screen import honest, pairs, score, tangent, trial_effects


def effect(lower=-1.0):
    """An effect whose amplitude may take either sign, or only one."""
    parameter = SimpleNamespace(name="amplitude", null=0.0, lower=lower, upper=1.0, log=False)
    return SimpleNamespace(
        spec=SimpleNamespace(parameters=(parameter,), amplitude=0, name="e", location="l"), values=(1.0,)
    )


def problem(seed=1, n=300, k=4):
    rng = np.random.default_rng(seed)
    jacobian = rng.standard_normal((n, k))
    w = rng.standard_normal(n)
    w -= jacobian @ np.linalg.lstsq(jacobian, w, rcond=None)[0]
    return rng, jacobian, w


def test_gain_is_the_decrease_of_the_refitted_least_squares():
    """(s'Pw)^2 / s'Ps equals chi2(base) - chi2(base + amplitude) with the base refitted."""
    rng, jacobian, w = problem()
    s = rng.standard_normal(len(w)) + 0.3 * w
    trial = score(effect(), s, tangent(w, jacobian))
    both = np.column_stack([jacobian, s])
    left = w - both @ np.linalg.lstsq(both, w, rcond=None)[0]
    assert np.isclose(trial.gain, w @ w - left @ left, rtol=1e-9)


def test_the_honest_gain_is_that_of_the_amplitude_that_was_tried():
    """w'w less |w - s|^2, the base refitted: a trial of a sixth of the right size is worth something, a double one nothing."""
    rng, jacobian, w = problem()
    direction = rng.standard_normal(len(w)) + 0.4 * w
    parents = tangent(w, jacobian)
    for size in (0.05, 0.2, 0.5, 1.5):
        trial = score(effect(), size * direction, parents)
        rest = w - size * direction
        left = rest - jacobian @ np.linalg.lstsq(jacobian, rest, rcond=None)[0]
        assert np.isclose(honest(trial), w @ w - left @ left, rtol=1e-6)


def test_a_candidate_inside_the_base_tangent_space_is_not_seen():
    """What the base's parameters reproduce is no evidence of anything."""
    _, jacobian, w = problem()
    assert score(effect(), jacobian @ np.array([1.0, -2.0, 0.5, 3.0]), tangent(w, jacobian)) is None


def test_a_one_sided_amplitude_gains_nothing_with_the_wrong_sign():
    """Friction that would have to drive the motion is no friction."""
    rng, jacobian, w = problem()
    s = rng.standard_normal(len(w)) - 0.5 * w
    parents = tangent(w, jacobian)
    assert score(effect(lower=0.0), s, parents).gain == 0.0
    assert score(effect(lower=-1.0), s, parents).gain > 0.0


def test_pair_gain_is_the_two_amplitude_least_squares():
    """Both amplitudes free at once, from the Gram matrix alone."""
    rng, jacobian, w = problem()
    parents = tangent(w, jacobian)
    columns = [rng.standard_normal(len(w)) + 0.2 * w for _ in range(2)]
    trials = [score(effect(), c, parents) for c in columns]
    both = np.column_stack([jacobian, *columns])
    left = w - both @ np.linalg.lstsq(both, w, rcond=None)[0]
    best = pairs(trials, parents.w)[0]
    assert np.isclose(best.gain, w @ w - left @ left, rtol=1e-4)
    together = np.linalg.lstsq(both, w, rcond=None)[0][-2:]
    assert np.allclose([t.factor for t in best.trials], together, rtol=1e-3)


def test_a_pair_that_undoes_itself_is_found_though_neither_explains_anything_alone():
    """w = 10 (s_1 - s_2) with s_1 and s_2 nearly alike, and w seen by neither."""
    rng, jacobian, _ = problem()
    common, apart = rng.standard_normal((2, len(jacobian)))
    first, second = common + 0.04 * apart, common - 0.04 * apart
    parents = tangent(10.0 * (first - second), jacobian)
    trials = [score(effect(), s, parents) for s in (first, second)]
    assert max(t.gain for t in trials) < 0.1 * parents.w @ parents.w
    assert pairs(trials, parents.w) == []  # less than 0.02 of either is its own
    first, second = common + 0.3 * apart, common - 0.3 * apart
    trials = [score(effect(), s, parents) for s in (first, second)]
    best = pairs(trials, parents.w)[0]
    assert max(t.gain for t in trials) < 0.3 * best.gain
    assert np.isclose(best.gain, parents.w @ parents.w, rtol=1e-3)


def test_sizes_below_the_smallest_are_tenths_of_it():
    """A law with a threshold is tried decades below: its forces in proportion, its other numbers as they are."""
    spec = SimpleNamespace(
        amplitude=0,
        scale=lambda problem: (1.0, 10.0, 100.0),
        starts=lambda problem: ((20.0, 0.5),),
        proportional=(1,),
    )
    found = [a.values for a in trial_effects(spec, None, (-2, -1, 0, 1))]
    assert found == [
        pytest.approx((0.01, 0.02, 0.5)), pytest.approx((0.1, 0.2, 0.5)), pytest.approx((1.0, 2.0, 0.5)),
        pytest.approx((10.0, 20.0, 0.5)),
    ]  # fmt: skip
