"""A loop as large as half the spring is found alone where it has to come while stiffness and damping go."""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.effects import catalogue
from jointscope.diagnosis.loops import LOOP, loops
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.screen import trial_effects
from jointscope.diagnosis.search import Effort, Hypothesis, fit_child, name_of, profile_loss
from jointscope.recordings.campaign import Run, Stream

J, K, C = 3.4, 1.62e5, 34.0
SLIPS = np.array([0.4, 0.8, 1.2, 1.8, 2.8])  # N m, of five springs side by side
ANGLES = np.array([2e-5, 4.5e-5, 8e-5, 1.4e-4, 2.4e-4])  # rad, at which they slip
RATE, STEPS, NOISE = 1024.0, 24, 0.04
PEAKS = (40.0, 80.0, 80.0, 150.0, 260.0, 260.0, 420.0)


def struck(builders, rng, peak, name, slips):
    """A hit at 0.85 m of an arm on a spring and on springs that slip, and an accelerometer at 0.95 m."""
    t = np.arange(int(1.4 * RATE)) / RATE
    h = 1.0 / (RATE * STEPS)
    force, a = np.zeros(t.size), np.zeros(t.size)
    q = v = 0.0
    pulled = np.zeros(slips.size)
    stiff = slips / ANGLES
    for i in range(t.size):
        for k in range(STEPS):
            u = i / RATE + k * h - 0.1
            f = peak * math.sin(math.pi * u / 0.0055) if 0.0 <= u < 0.0055 else 0.0
            acceleration = (0.85 * f - K * q - C * v - float(pulled.sum())) / J
            if k == 0:
                force[i], a[i] = f, acceleration
            v += h * acceleration
            q += h * v
            pulled = np.clip(pulled + stiff * h * v, -slips, slips)
    y = 0.95 * a + NOISE * rng.standard_normal(t.size)
    channels = (
        builders.channel("f", "force", "N", "arm", "input", force, radius=0.85),
        builders.channel("a", "linear-acceleration", "m/s^2", "arm", "output", y, radius=0.95, direction="tangential"),
    )  # fmt: skip
    stream = Stream(file=f"{name}.csv", sampling_rate=RATE, length=t.size, channels=channels)
    return Run(id=name, experiment="hammer", streams=(stream,), brake=True, arm_angle=0.0)


def sought(builders, slips):
    """(the best of what single laws leave, what is found beside them), both losses, and the loop found."""
    rng = np.random.default_rng(51)
    runs = [struck(builders, rng, peak, f"h{k}", slips) for k, peak in enumerate(PEAKS)]
    rig = replace(
        builders.NAMEPLATE, topology="single-dof", plane="horizontal", arm_mass=None, arm_com_radius=None,
        stiffness_reference=1.5e5, inertia_reference=3.9, damping_reference=50.0,
    )  # fmt: skip
    problem = prepare(builders.campaign_of(runs, rig))
    specs = catalogue(problem)
    with ThreadPoolExecutor(2) as pool:
        stage = refit_base(problem, predict_outputs, tuple(range(len(runs))), pool)
        objective = stage.objective
        base = Hypothesis((), stage.fit, profile_loss(objective, stage.fit.w))
        singles = []
        for spec in (s for s in specs if name_of(s) == LOOP):
            fits = [fit_child(objective, stage.fit, [t], Effort()) for t in trial_effects(spec, problem, (1,))[:2]]
            singles.extend(Hypothesis((spec,), f, profile_loss(objective, f.w)) for f in fits if f is not None)
        found = loops(stage, objective, base, singles, specs)
    return min(h.loss for h in [base, *singles]), found


def test_springs_that_slip_one_after_the_other_are_found_whole(builders):
    near, found = sought(builders, SLIPS)
    (loop,) = found
    theta, (active,) = loop.fit.coordinates.unpack(loop.fit.x)
    assert loop.loss < near - 1000.0
    assert active.values[0] == pytest.approx(SLIPS.sum(), rel=0.1)
    assert active.values[1] == pytest.approx((SLIPS / ANGLES).sum(), rel=0.1)
    assert theta[0] == pytest.approx(K, rel=0.03)


def test_none_is_sought_where_the_base_explains_the_hits(builders):
    assert sought(builders, np.zeros(5))[1] == []
