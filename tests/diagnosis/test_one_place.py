"""What sits at one place of the travel is found there, and in runs that were not fitted; noise, lines and orders are not."""

from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.one_place import in_one_place
from jointscope.diagnosis.remainder import remainder_json

RATE, SECONDS, NOISE = 500.0, 8.0, 1e-3
PLACE, WIDTH = 0.35, 0.02


def run_of(rng, left):
    """A run that swings to and fro from a place and at a pace of its own; ``left(t, q, v)`` is what a model leaves."""
    t = np.arange(round(RATE * SECONDS)) / RATE
    half = np.arange(2 * t.size + 1) / (2.0 * RATE)
    pace, start = rng.uniform(0.5, 1.5), rng.uniform(-0.2, 0.2)

    def angle(times):
        return start + 0.8 * np.sin(pace * times) + 0.1 * np.sin(2.7 * pace * times)

    output = SimpleNamespace(
        quantity="angle", location="arm", direction=None, times=t, rate=RATE, data=angle(t), mask=np.ones(t.size, bool),
        radius=None, followed_to=0.5,
    )  # fmt: skip
    run = SimpleNamespace(
        run=SimpleNamespace(experiment="speed-motion", brake=False), outputs=(output,), t0=0.0, grid_rate=RATE,
        observed_half=angle(half), initial_angle=start, observed=SimpleNamespace(rate_signal=False, commanded=False),
        motor_moves=True, mode="observer",
    )  # fmt: skip
    return run, NOISE * rng.standard_normal(t.size) + NOISE * left(t, angle(t), np.gradient(angle(t), t))


def found_of(left, seed=1, skipped=7, motion="rotational"):
    """What three fitted and two held-out runs show, the first samples of each not scored."""
    rng = np.random.default_rng(seed)
    made = [run_of(rng, left) for _ in range(5)]
    keep = np.arange(skipped, round(RATE * SECONDS))
    whitener = SimpleNamespace(sizes=(keep.size,), filters=(SimpleNamespace(keep=keep),))

    def objective(rows):
        return SimpleNamespace(
            problem=SimpleNamespace(rig=SimpleNamespace(motion=motion)),
            prepared=[run for run, _ in rows],
            runs=tuple(range(len(rows))),
            whiteners=[whitener for _ in rows],
            whiten_run=lambda i, predicted: rows[i][1][keep] / NOISE,
            map=lambda f, items: [f(item) for item in items],
        )

    judgement = SimpleNamespace(objective=objective(made[:3]), held=objective(made[3:]))
    judged = SimpleNamespace(predictions=[((),)] * 3, predictions_held=[((),)] * 2)
    return in_one_place(judgement, judged)


def magnet(t, q, v, place=PLACE):
    """Felt less where it is passed faster, and with the sign of the way of passing."""
    u = (q - place) / WIDTH
    return -4.0 * u * np.exp(0.5 - 0.5 * u * u) * np.sign(v) / (0.5 + np.abs(v))


def test_a_magnet_is_found_at_its_place_and_in_the_runs_that_were_not_fitted():
    (found,) = found_of(magnet)
    assert found.stands
    assert found.place.angle == pytest.approx(PLACE, abs=WIDTH)
    assert found.place.width == pytest.approx(WIDTH, rel=0.6)
    told = remainder_json([found])[0]
    assert told["place"]["value"] == pytest.approx(PLACE, abs=WIDTH) and told["place"]["unit"] == "rad"
    assert "rad of the joint" in told["sentence"] and told["share_of_signal"] is None
    (slid,) = remainder_json(found_of(magnet, motion="translational"))
    assert slid["place"]["unit"] == "m" and "m of the joint" in slid["sentence"]


@pytest.mark.parametrize("seed", range(8))
def test_noise_has_no_place(seed):
    (found,) = found_of(lambda t, q, v: 0.0 * t, seed)
    assert not found.stands and found.gain < 0.0


@pytest.mark.parametrize(
    "left",
    [
        lambda t, q, v: 0.7 * np.sin(2.0 * np.pi * 9.0 * t),
        lambda t, q, v: 3.0 * np.exp(-0.5 * ((t - 2.0) / 0.02) ** 2),
    ],
    ids=["a line in time", "an event in time"],
)
def test_what_is_fixed_in_time_has_none_either(left):
    (found,) = found_of(left)
    assert not found.stands


def test_what_sits_elsewhere_in_every_run_is_not_fixed_to_the_joint():
    rng = np.random.default_rng(5)
    (found,) = found_of(lambda t, q, v: magnet(t, q, v, rng.uniform(-0.5, 0.5)))
    assert not found.stands


def test_what_can_hardly_be_heard_is_not_said():
    """A twentieth of the noise, however long it is listened to."""
    (found,) = found_of(lambda t, q, v: 0.02 * magnet(t, q, v))
    assert not found.stands
