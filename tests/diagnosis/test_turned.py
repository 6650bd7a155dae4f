"""A recorded speed holds the angle as a recorded angle does; a law that accounts for the whole torque log is the drive."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis import kernel
from jointscope.diagnosis.assembly import close_loop
from jointscope.diagnosis.predict import build, integrate
from jointscope.diagnosis.prepare import prepare
from jointscope.diagnosis.turned import turned
from jointscope.identification.drive_law import Drive


@pytest.mark.parametrize("rate", [250.0, 500.0, 1000.0])
def test_a_speed_adds_up_to_its_angle_to_second_order(rate):
    t = np.arange(round(3.0 * rate)) / rate
    angle = 0.4 + 0.3 * (1.0 - np.cos(20.0 * t))
    found = turned(6.0 * np.sin(20.0 * t), rate, 0.4)
    assert np.max(np.abs(found - angle)) == pytest.approx(0.6 * (20.0 / rate) ** 2 / 12.0, rel=0.1)


def test_a_missing_sample_stops_no_angle():
    speed = np.full(200, 2.0)
    speed[[40, 41, 100]] = np.nan
    assert turned(speed, 100.0, 0.0)[-1] == pytest.approx(3.98, rel=1e-6)


def _as_speed(channel):
    """An encoder's channel as a tachometer's."""
    if channel.quantity != "angle":
        return channel
    speed = np.gradient(np.asarray(channel.samples), 1.0 / 500.0)
    return replace(channel, quantity="angular-velocity", unit="rad/s", samples=speed)


@pytest.mark.parametrize("off", [-3.0, 4.0])
def test_a_torque_that_is_off_moves_a_speeds_angle_no_further_than_an_angle(builders, edited, off):
    """Were the speed alone followed, the angle would run away by a quarter of a radian per second."""
    plant = builders.Plant()
    run = builders.sweep_run(plant, 60.0, "sweep")
    ends = []
    for recorded in (run, edited(run, _as_speed)):
        problem = prepare(builders.campaign_of((recorded,), builders.NAMEPLATE))
        theta = problem.theta(torque_offset=off)
        states = integrate(build(problem.runs[0], theta, (), problem))
        right = integrate(build(problem.runs[0], problem.theta(), (), problem))
        ends.append(np.max(np.abs(states[:, kernel.X_QS] - right[:, kernel.X_QS])))
    assert ends[1] == pytest.approx(ends[0], rel=0.1)
    assert ends[1] < 0.02


def test_a_trusted_law_is_the_drive_and_another_holds_the_drift(builders):
    problem = prepare(
        builders.campaign_of((builders.sweep_run(builders.Plant(), 60.0, "sweep"),), builders.NAMEPLATE)
    )
    shares = []
    for trust in (0.0, 1.0):
        assembly = build(problem.runs[0], problem.theta(drive_trust=trust), (), problem)
        close_loop(assembly)
        shares.append(assembly.P[kernel.LOOP_MIX])
    assert shares[0] < 0.2 and shares[1] == 1.0


def test_what_a_law_lacks_is_what_neither_it_nor_the_logs_noise_accounts_for():
    whole = Drive(proportional=1.0, integral=2.0, residual=0.1, log_noise=0.0, explained=0.99)
    assert whole.lacking == pytest.approx(0.1)
    assert replace(whole, log_noise=0.1).lacking == 0.0
    assert Drive(proportional=1.0, integral=2.0).lacking == 0.0
