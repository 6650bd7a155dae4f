"""Lines from outside: sought in every kind of channel, doubted only where the runs that show them ring there themselves."""

from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis import resonant
from jointscope.diagnosis.effects.lines import Residuals, spectral_peaks
from jointscope.diagnosis.vibration import beside

RATE, N, LINE = 1000.0, 3000, 29.1


def output(quantity):
    return SimpleNamespace(quantity=quantity, rate=RATE, mask=np.ones(N, dtype=bool))


def test_a_line_in_the_motors_angle_alone_is_found():
    """15 microradians beside a drift of 20 mrad, where the accelerometer shows nothing of it."""
    rng = np.random.default_rng(3)
    t = np.arange(N) / RATE
    acceleration = rng.normal(0.0, 0.3, N)
    angle = 0.02 * t**2 + 1.5e-5 * np.sin(2 * np.pi * LINE * t) + rng.normal(0.0, 2e-5, N)
    problem = SimpleNamespace(runs=[SimpleNamespace(outputs=[output("linear-acceleration"), output("angle")])])
    found = spectral_peaks(problem, Residuals([[acceleration, angle]]), 8.0, 400.0, 8, narrow=True)
    assert min(abs(f - LINE) for f in found[:1]) < 0.2


def test_the_noise_beside_a_line_is_that_of_its_own_band():
    rng = np.random.default_rng(4)
    noise = rng.normal(0.0, 1.0, N)
    slow = 50.0 * np.sin(2 * np.pi * 1.0 * np.arange(N) / RATE)
    white, drifting = (beside(np.hanning(N) * x, 100.0 / RATE) for x in (noise, noise + slow))
    assert drifting == pytest.approx(white, rel=0.05)
    assert white == pytest.approx(np.log(2.0) * 3.0 / 8.0, rel=0.5)  # median of a periodogram, Hann's own power


def test_a_log_too_slow_for_a_line_does_not_decide_its_phase():
    x = np.hanning(N) * np.random.default_rng(5).normal(0.0, 1.0, N)
    assert beside(x, 1.7) == pytest.approx(np.mean(np.square(x)))


@pytest.mark.parametrize(
    ("line", "held", "free", "doubted"),
    [
        (27.0, 100.0, 5.0, True),  # on the held joint's resonance, and seen by the hits alone
        (27.0, 100.0, 90.0, False),  # the motor's anti-resonance is none of its runs' resonances
        (38.0, 5.0, 90.0, True),
        (60.0, 5.0, 5.0, False),
    ],
)
def test_a_line_is_doubted_only_for_runs_that_ring_there(monkeypatch, line, held, free, doubted):
    monkeypatch.setattr(resonant, "joint_poles", lambda *_: {False: (27.0, 0.02), True: (38.0, 0.02)})
    effect = SimpleNamespace(
        values=(line, 1.0), spec=SimpleNamespace(profiled=1, name="external-vibration", location="base")
    )
    where = SimpleNamespace(unpack=lambda x: (None, (effect,)))
    child = SimpleNamespace(
        fit=SimpleNamespace(x=None, coordinates=where), fitted=np.zeros(2), held_out=np.zeros(0)
    )
    parent = SimpleNamespace(names=(), fitted=2.0 * np.array([held, free]), held_out=np.zeros(0))
    runs = tuple(SimpleNamespace(motor_moves=moves) for moves in (False, True))
    judgement = SimpleNamespace(
        objective=SimpleNamespace(problem=None, prepared=runs), held=SimpleNamespace(prepared=())
    )
    assert resonant.only_at_resonance(judgement, child, parent) is doubted
