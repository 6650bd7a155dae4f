"""The torque on the motor shaft is the same, whatever the drive logged of it."""

import math

import numpy as np
import pytest

from jointscope.errors import RefusedError
from jointscope.recordings.campaign import Channel, Nameplate, Run, Stream, gearing
from jointscope.recordings.motor_torque import motor_torque

RATE, N = 10_000.0, 8_000
RIG = Nameplate(
    topology="two-inertia", motion="rotational", reduction_ratio=141.0, torque_constant=0.458, pole_pairs=5
)
T = np.arange(N) / RATE
IQ = 3.0 * np.sin(2 * np.pi * 4.0 * T) + 0.4 * np.sin(2 * np.pi * 60.0 * T)
ANGLE = 40.0 + 300.0 * T + 20.0 * np.sin(2 * np.pi * 1.5 * T)


def stream(*channels, rate=RATE):
    return Stream(file="a.csv", sampling_rate=rate, length=channels[0].samples.size, channels=channels)


def channel(quantity, samples, unit="A", role="input", column="x", **more):
    return Channel(
        column=column, quantity=quantity, unit=unit, location="motor", role=role, samples=samples, **more
    )


def run(*streams):
    return Run(id="a", experiment="speed-motion", streams=streams)


def phases(count=3, gain=1.0, **more):
    electrical = 5 * ANGLE
    waves = [-gain * IQ * np.sin(electrical - 2 * np.pi * k / 3) for k in range(count)]
    return [channel("phase-current", i, column=c, **more) for i, c in zip(waves, "uvw", strict=False)]


def encoder(rate=1000.0):
    step = round(RATE / rate)
    return stream(channel("angle", ANGLE[::step], "rad", "output", "enc"), rate=rate)


@pytest.mark.parametrize(
    "recorded",
    [
        run(stream(channel("torque", 0.458 * IQ, "N m"))),
        run(stream(channel("torque", 141.0 * 0.458 * IQ, "N m", side="output"))),
        run(stream(channel("current", IQ))),
        run(stream(channel("current", IQ / math.sqrt(2.0), per="rms"))),
        run(stream(*phases()), encoder()),
        run(stream(*phases(gain=1 / math.sqrt(2.0), per="rms")), encoder()),
    ],
    ids=["torque", "at the output", "current", "rms", "phases", "rms phases"],
)
def test_every_way_to_log_it_gives_the_same_torque(recorded):
    found = motor_torque(recorded, RIG)
    assert found.signed and found.unit == "N m" and found.sampling_rate == RATE
    inside = slice(200, -200)
    assert np.max(np.abs(found.values - 0.458 * IQ)[inside]) < 5e-4


def test_without_the_torque_constant_it_is_per_ampere():
    bare = Nameplate(topology="two-inertia", motion="rotational")
    found = motor_torque(run(stream(channel("current", IQ))), bare)
    assert found.unit == "A"
    np.testing.assert_array_equal(found.values, IQ)


def test_an_uncalibrated_current_stays_uncalibrated():
    found = motor_torque(run(stream(channel("current", IQ, unit="1"))), RIG)
    assert found.unit == "1"


@pytest.mark.parametrize("count", [2, 3])
def test_phases_without_an_angle_give_the_magnitude(count):
    found = motor_torque(run(stream(*phases(count))), RIG)
    assert not found.signed
    assert np.max(np.abs(found.values - 0.458 * np.abs(IQ))) < 1e-9


def test_one_phase_gives_its_envelope():
    constant = [-2.0 * np.sin(5 * 300.0 * T)]
    found = motor_torque(run(stream(channel("phase-current", constant[0]))), RIG)
    assert not found.signed
    assert found.values[500:-500] == pytest.approx(0.458 * 2.0, rel=0.01)


def test_a_torque_is_preferred_to_a_current_and_an_input_to_an_output():
    both = run(
        stream(
            channel("current", 0 * IQ), channel("torque", 2 * IQ, "N m", "output"), channel("torque", IQ, "N m")
        )
    )
    np.testing.assert_array_equal(motor_torque(both, RIG).values, IQ)


def test_nothing_recorded_is_nothing_and_no_ratio_is_refused():
    assert motor_torque(run(encoder()), RIG) is None
    bare = Nameplate(topology="two-inertia", motion="rotational")
    with pytest.raises(RefusedError, match=r"rig\.reduction_ratio"):
        motor_torque(run(stream(channel("torque", IQ, "N m", side="output"))), bare)
    with pytest.raises(RefusedError, match=r"rig\.pole_pairs"):
        motor_torque(run(stream(*phases()), encoder()), bare)


def test_a_position_at_the_motor_is_the_slides_and_an_angle_the_shafts():
    assert gearing("angle", "motor", 314.0) == gearing("angular-velocity", "motor", 314.0) == 314.0
    assert gearing("position", "motor", 314.0) == gearing("velocity", "motor", 314.0) == 1.0
    assert gearing("angle", "arm", 314.0) == gearing("position", "load", 314.0) == 1.0
