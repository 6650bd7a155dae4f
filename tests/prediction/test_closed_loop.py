"""Closed loops: no drift where an open loop drifts, and the law's share where it belongs."""

import math

import numpy as np
import pytest

from jointscope.identification.drive import identify_drive
from jointscope.prediction.base_model import predict_run
from jointscope.prediction.closed_loop import law_share
from jointscope.prediction.integrate import Loop, integrate
from jointscope.prediction.plant import plant_of
from jointscope.prediction.scores import contract_error

K_P, K_I = 0.08, 1.6


def command(t):
    """Smooth there and back, 246 rad/s at the motor."""
    return (
        246.0
        * np.sin(math.pi * np.clip((t - 0.2) / 4.0, 0.0, 1.0))
        * np.sin(2 * math.pi * np.clip((t - 0.2) / 4.0, 0.0, 1.0))
    )


def recorded(bench, rng, *, ripple=0.0, friction=0.0, offset=0.0, noise=0.001):
    """A speed motion whose torque is logged with an offset; ripple is torque that no law of the speed explains."""
    model = bench.model()
    run = bench.run("speed-motion", bench.stream(500.0, length=2400))
    plant = plant_of(model, run)
    rate, n = 4000.0, 19_200
    t = np.arange(2 * n + 1) / (2 * rate)
    w_c, hold = command(t), plant.holding_torque(0.0)
    # half of twice the law plus half of twice the ripple
    loop = Loop(
        command=w_c, command_rate=0 * t, law=2.0 * np.array([K_P, K_I, 0.0, 0.0, hold, math.inf]), share=0.5
    )
    drag = -friction * np.tanh(w_c / 5.0)
    extra = 2.0 * ripple * np.sin(2 * math.pi * 30.0 * t) * (t > 0.2)
    motion = integrate(plant, start=0.0, rate=rate, arm_angle=0.0, motor_torque=extra, load_torque=drag, loop=loop)
    every = slice(None, None, 8)
    log = motion.torque[every] + offset + noise * rng.standard_normal(n // 8 + 1)
    stream = bench.stream(
        500.0,
        bench.channel("torque", "motor", "input", log, column="T"),
        bench.channel("speed-command", "motor", "input", w_c[::16], column="w_c"),
        bench.channel("angle", "motor", "output", 141.0 * motion.motor_angle[every], column="theta"),
        bench.channel("angular-acceleration", "arm", "output", motion.acceleration[every], column="a"),
    )
    return bench.run("speed-motion", stream)


def errors(bench, run, share):
    drive = identify_drive(bench.campaign(run))
    prediction = predict_run(bench.model(), run, drive=drive, share=share)
    return {
        c.signal.channel.quantity: contract_error(c.signal.samples, c.values, c.signal.channel.quantity)
        for c in prediction.channels
    }


def test_half_a_bit_of_offset_drifts_open_loop_and_not_in_the_loop(bench, rng):
    """The log off by 2.4 mN m (half a bit of 12 over 10 N m): the replay leaves, the loop stays."""
    run = recorded(bench, rng, offset=2.4e-3)
    assert errors(bench, run, 0.0)["angle"] > 0.05
    assert errors(bench, run, None)["angle"] < 1e-3


def test_friction_inside_the_loop_asks_for_the_law(bench, rng):
    """A disturbance of the machine is divided by 1 + alpha P L: the larger the law's share, the better."""
    run = recorded(bench, rng, friction=15.0)
    found = [errors(bench, run, share)["angular-acceleration"] for share in (0.1, 0.3, 0.9)]
    assert found == sorted(found, reverse=True)
    assert law_share(identify_drive(bench.campaign(run))) > 0.8


def test_torque_that_the_law_does_not_explain_asks_for_the_log(bench, rng):
    """Ripple that the drive adds is in its log alone: the smaller the law's share, the better."""
    run = recorded(bench, rng, ripple=0.05)
    found = [errors(bench, run, share)["angular-acceleration"] for share in (0.9, 0.3, 0.1)]
    assert found == sorted(found, reverse=True)
    assert law_share(identify_drive(bench.campaign(run))) < 0.2


@pytest.mark.parametrize("quantity", ["angle", "angular-acceleration"])
def test_with_a_perfect_model_the_loop_leaves_noise_only(bench, rng, quantity):
    assert errors(bench, recorded(bench, rng), None)[quantity] < 0.01


def test_without_a_logged_torque_the_law_alone_drives_the_arm(bench, rng):
    from dataclasses import replace

    run = recorded(bench, rng)
    drive = identify_drive(bench.campaign(run))
    stream = run.streams[0]
    alone = replace(run, streams=(replace(stream, channels=stream.channels[1:]),))
    prediction = predict_run(bench.model(), alone, drive=drive)
    assert prediction.closed_loop
    angle = prediction.channels[0]
    assert contract_error(angle.signal.samples, angle.values, "angle") < 1e-3
