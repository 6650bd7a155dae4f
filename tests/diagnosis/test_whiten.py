"""Whitening is exact linear algebra; noise models are recovered from their own samples."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from jointscope.diagnosis.energies import error_energies
from jointscope.diagnosis.noise import BlockNoise, NoiseModel, autocovariance, block_key, block_noise, fit_ar
from jointscope.diagnosis.own_hit import scatter_columns
from jointscope.diagnosis.whiten import hit_scatter, marginalised, output_filter, run_scale, run_whitener
from jointscope.diagnosis.zeros import AMPLIFIER


def hit(data, rate=1000.0, quantity="linear-acceleration", low_cutoff=0.5):
    """A hit with one accelerometer, coupled by AC unless ``low_cutoff`` is none, as far as whitening looks at it."""
    force = np.zeros(len(data))
    force[20:26] = 100.0
    output = SimpleNamespace(
        quantity=quantity, location="arm", direction="tangential", radius=0.9, rate=rate,
        data=data, mask=np.ones(len(data), bool), low_cutoff=low_cutoff, high_pass=None,
    )  # fmt: skip
    run = SimpleNamespace(experiment="hammer", brake=True)
    return SimpleNamespace(
        run=run, mode="braked", load_force=force, motor_torque=None, speed_command=None, outputs=(output,)
    )


def ringing(n=400, rate=1000.0, frequency=40.0):
    t = np.maximum(np.arange(n) / rate - 0.025, 0.0)
    return 30.0 * np.exp(-8.0 * t) * np.sin(2 * np.pi * frequency * t)


def test_whitened_energy_is_the_quadratic_form_of_the_full_covariance():
    """w'w = r' (AR(1) + s_g^2 y y' + s_t^2 y. y.')^-1 r: Woodbury's identity to rounding."""
    rng = np.random.default_rng(1)
    y = ringing()
    run = hit(y)
    a, sigma = 0.6, 0.05
    noise = NoiseModel(
        {block_key(run, run.outputs[0]): BlockNoise(np.array([1.0, -a]), sigma, sigma / np.sqrt(1 - a * a), 0.0)},
        gain=0.02, timing=4e-5,
    )  # fmt: skip
    whitener = run_whitener(run, noise, (y,))
    r = rng.standard_normal(len(y))
    w = whitener([r])[:, 0]
    prediction_error = toeplitz(np.r_[1.0, -a, np.zeros(len(y) - 2)], np.r_[1.0, np.zeros(len(y) - 1)])
    prediction_error = prediction_error / whitener.filters[0].sigma  # the take's own scale included
    filtered = prediction_error[1:]
    u = filtered @ (scatter_columns(run, (y,))[0] * np.array([0.02, 4e-5]))
    covariance = np.eye(len(filtered)) + u @ u.T
    assert np.isclose(w @ w, (filtered @ r) @ np.linalg.solve(covariance, filtered @ r), rtol=1e-9)


def test_an_encoder_says_nothing_of_where_between_two_steps_it_began():
    """w'w = r' (s^2 + s_0^2 1 1')^-1 r with s_0 the step: half a step's offset costs 4 nats at most, and not one a sample."""
    rng = np.random.default_rng(7)
    step = 1e-5
    true = 3e-4 * ringing(4000) / 30.0
    data = step * np.round(true / step)
    run = hit(data, quantity="angle")
    run.outputs[0].step, run.outputs[0].followed_to = step, 3.0
    sigma = step / np.sqrt(12.0)
    key = block_key(run, run.outputs[0])
    noise = NoiseModel({key: BlockNoise(np.array([1.0]), sigma, sigma, 0.0)}, gain=0.02, timing=4e-5)
    whitener = run_whitener(run, noise, (true,))
    own = whitener.filters[0].sigma
    r = sigma * rng.standard_normal(data.size)
    u = (
        np.column_stack([scatter_columns(run, (true,))[0] * np.array([0.02, 4e-5]), np.full(data.size, step)])
        / own
    )
    expected = (r / own) @ np.linalg.solve(np.eye(data.size) + u @ u.T, r / own)
    w = whitener([r])[:, 0]
    assert np.isclose(w @ w, expected, rtol=1e-9)
    offset = whitener([r + 0.5 * step])[:, 0]
    assert abs(offset @ offset - w @ w) < 8.0  # 2 nats are chi square's 4
    bare = whitener.filter([r + 0.5 * step])[:, 0]
    assert bare @ bare - w @ w > 0.5 * data.size
    moved = whitener([r + 0.5 * step * np.sin(np.arange(data.size) / 20.0)])[:, 0]
    assert moved @ moved - w @ w > 0.2 * data.size  # anything else than a constant is as loud as before


@pytest.mark.parametrize(("low_cutoff", "told"), [(None, False), (0.5, True)])
def test_an_amplifiers_last_tenths_of_a_thousandth_of_g_say_nothing(low_cutoff, told):
    """What no quiet part shows costs two nats at most; thirty times that, a gain's share of g, is told as before."""
    y = ringing(4000)
    run = hit(y, low_cutoff=low_cutoff)
    key = block_key(run, run.outputs[0])
    noise = NoiseModel({key: BlockNoise(np.array([1.0]), 0.003, 0.003, 0.0)}, gain=0.02, timing=4e-5)
    r = 0.003 * np.random.default_rng(7).standard_normal(y.size)
    whitener = run_whitener(run, noise, (y,))
    w, moved, gained = (whitener([x])[:, 0] for x in (r, r + 0.5 * AMPLIFIER, r + 30.0 * AMPLIFIER))
    assert bool(abs(moved @ moved - w @ w) > 1000.0) is told
    assert told or abs(moved @ moved - w @ w) < 4.0
    assert gained @ gained - w @ w > 800.0


def test_an_autoregressive_process_is_recovered_and_white_noise_gets_no_filter():
    """Yule-Walker with BIC: the coefficients of an AR(2) within 0.03; order 0 for white noise."""
    rng = np.random.default_rng(2)
    true = np.array([1.0, -1.2, 0.5])
    x = lfilter([1.0], true, rng.standard_normal(20_000))
    ar, sigma, _ = fit_ar(autocovariance([x], 12), len(x), 0.0, 12)
    assert len(ar) == 3
    assert np.allclose(ar, true, atol=0.03)
    assert np.isclose(sigma, 1.0, atol=0.03)
    white = rng.standard_normal(20_000)
    assert len(fit_ar(autocovariance([white], 12), len(white), 0.0, 12)[0]) == 1


def test_error_that_follows_the_signal_is_told_from_a_noise_floor():
    """r ~ N(0, 0.05^2 + (0.03 env)^2) gives kappa back; a pure floor gives kappa near nothing."""
    rng = np.random.default_rng(3)
    y = np.tile(ringing(800), 8)
    run = hit(y)
    output = run.outputs[0]
    from jointscope.diagnosis.noise import envelope

    env = envelope(output)
    proportional = block_noise([output], [rng.standard_normal(len(y)) * np.sqrt(0.05**2 + (0.03 * env) ** 2)], 0)
    flat = block_noise([output], [0.05 * rng.standard_normal(len(y))], 0)
    assert np.isclose(proportional.kappa, 0.03, rtol=0.25)
    assert np.isclose(proportional.marginal, 0.05, rtol=0.15)
    assert proportional.grown == proportional.kappa
    assert flat.kappa * env.max() < 0.03
    assert flat.grown == 0.0


def test_few_bursts_of_coloured_noise_do_not_grow_with_the_signal():
    """Noise that remembers 30 samples falls on the envelope by chance, a record in three."""
    rng = np.random.default_rng(4)
    y = np.concatenate([np.sin(0.3 * np.arange(2000)), 0.05 * np.sin(0.3 * np.arange(6000))])
    run = hit(y)
    output = run.outputs[0]
    from jointscope.diagnosis.noise import envelope

    env = envelope(output)
    slow = [lfilter([math.sqrt(1.0 - 0.97**2)], [1.0, -0.97], rng.standard_normal(len(y))) for _ in range(20)]
    found = [block_noise([output], [0.2 * e], 12) for e in slow]
    assert sum(n.kappa > 0.0 for n in found) > 5
    assert all(n.grown == 0.0 for n in found)
    growing = [block_noise([output], [e * np.sqrt(0.2**2 + (0.8 * env) ** 2)], 12) for e in slow]
    assert all(n.grown > 0.0 for n in growing)


def followed_angle(level, n=6000, rate=1000.0):
    """An angle that swings at 10 Hz, as far as its noise is concerned."""
    data = level * np.sqrt(2.0) * np.sin(2.0 * np.pi * 10.0 * np.arange(n) / rate)
    return SimpleNamespace(
        quantity="angle", rate=rate, data=data, mask=np.ones(n, bool), followed_to=3.0, step=None
    )


def test_what_an_observer_lets_go_is_no_relative_error_of_an_angle():
    """A slow error as large as a tenth of the motion leaves the noise at 30 Hz and above what it is."""
    rng = np.random.default_rng(5)
    outputs = [followed_angle(level) for level in (0.03, 0.1, 0.3)]
    walks = [o.data.std() * np.cumsum(rng.standard_normal(6000)) * 2e-4 for o in outputs]
    residuals = [lfilter([1.0, -1.0], [1.0, -0.999], w) + 1e-5 * rng.standard_normal(6000) for w in walks]
    noise = block_noise(outputs, residuals, 12)
    assert max(np.std(r) for r in residuals) > 30 * 1e-5
    tone = np.sin(2.0 * np.pi * 60.0 * np.arange(6000) / 1000.0)
    for output, residual, loosest in zip(outputs, residuals, (3.0, 6.0, 16.0), strict=True):
        scale = run_scale(output, noise, residual)
        heard = np.std(output_filter(output, noise, scale)(tone[:, None]))
        at_best = np.std(tone) / 1e-5
        assert at_best / loosest < heard < 2.0 * at_best


def test_hit_scatter_is_found_with_its_size():
    """Gain scatter of 2 % and timing scatter of 50 us over 40 hits are estimated within a third."""
    rng = np.random.default_rng(4)
    y = ringing(600)
    dy = np.gradient(y) * 1000.0
    runs, predictions = [], []
    for _ in range(40):
        data = y * (1 + 0.02 * rng.standard_normal()) + 5e-5 * rng.standard_normal() * dy
        runs.append(hit(data + 0.02 * rng.standard_normal(len(y))))
        predictions.append((y,))
    noise = NoiseModel(
        {block_key(r, r.outputs[0]): BlockNoise(np.array([1.0]), 0.02, 0.02, 0.0) for r in runs}, 0.01, 3e-5
    )
    gain, timing, _ = hit_scatter(runs, noise, predictions)
    assert np.isclose(gain, 0.02, rtol=0.33)
    assert np.isclose(timing, 5e-5, rtol=0.33)


def test_what_an_effect_explains_of_a_hit_is_measured_less_the_hit_s_own_gain():
    """Hits that scatter by 3 %: of an effect of 1 % the energy is found to a tenth; in the raw errors it drowns."""
    rng = np.random.default_rng(3)
    y = ringing(2000)
    extra = 0.01 * np.std(y) * np.sqrt(2.0) * np.sin(2 * np.pi * 90.0 * np.arange(y.size) / 1000.0)
    runs = [
        hit((1.0 + 0.03 * rng.standard_normal()) * y + extra + 0.01 * rng.standard_normal(y.size))
        for _ in range(8)
    ]
    noise = NoiseModel(
        {block_key(runs[0], runs[0].outputs[0]): BlockNoise(np.array([1.0]), 0.01, 0.01, 0.0)}, 0.03, 3e-6
    )
    whiteners = [run_whitener(run, noise, (y + extra,)) for run in runs]
    before, after = (error_energies(runs, [(p,)] * len(runs), whiteners) for p in (y, y + extra))
    (key,) = before
    gained = before[key][0] - after[key][0]
    assert np.isclose(gained, len(runs) * float(extra @ extra), rtol=0.1)
    raw = sum(np.sum((run.outputs[0].data - y - extra) ** 2) for run in runs)
    assert raw > 5.0 * gained
    assert np.isclose(after[key][0], len(runs) * y.size * 0.01**2, rtol=0.1)


def test_a_model_that_lacks_a_hit_s_ring_is_not_excused_by_its_gain():
    """A hit's own gain is believed within three standard deviations: 50 of them would explain whatever the leader predicts."""
    y = ringing(2000)
    run = hit(y + 0.01 * np.random.default_rng(4).standard_normal(y.size))
    noise = NoiseModel({block_key(run, run.outputs[0]): BlockNoise(np.array([1.0]), 0.01, 0.01, 0.0)}, 0.01, 3e-6)
    whitener = run_whitener(run, noise, (y,))  # of a leader that rings as the hit does
    energies = error_energies([run], [(0.5 * y,)], [whitener])
    (found,) = energies.values()
    assert found[0] > 0.4**2 * float(y @ y)
    assert error_energies([run], [(0.98 * y,)], [whitener])[next(iter(energies))][0] < 0.01**2 * float(y @ y)


def test_a_model_that_flies_apart_scatters_nothing():
    """What its input's noise does is more than a number holds when squared: eigenvalues of that ended in a traceback."""
    y = ringing()
    run = hit(y)
    noise = NoiseModel({block_key(run, run.outputs[0]): BlockNoise(np.array([1.0]), 0.05, 0.05, 0.0)}, 0.01, 3e-5)
    bare = run_whitener(run, noise, None)
    whitener = marginalised(run, noise, (y,), bare, (np.full((y.size, 1), 1e200),))
    np.testing.assert_array_equal(whitener([y]), bare([y]))
