"""Motor bench: a known two-inertia joint driven by a multisine comes back whole, or per unit of its input."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from jointscope.errors import RefusedError
from jointscope.identification.identify import identify
from jointscope.identification.response_estimate import estimate_responses, find_period
from jointscope.identification.two_inertia import TwoInertia, fit_two_inertia
from jointscope.models.joint import load_acceleration_per_torque, motor_acceleration_per_torque
from jointscope.models.parameters import Joint
from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream

RATE, PERIOD, PERIODS = 1000.0, 1000, 8
JOINT = np.array([4.0e-3, 6.0e-3, 600.0, 0.05, 0.04, 0.06])  # J_M, J_L, K, c, b_m, b_l at n = 1


def multisine(seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    spectrum = np.zeros(PERIOD // 2 + 1, dtype=complex)
    lines = np.arange(8, 200)
    spectrum[lines] = np.exp(2j * np.pi * rng.random(lines.size))
    return np.tile(np.fft.irfft(spectrum) * PERIOD / 10.0, PERIODS)


def angles(drive: np.ndarray, values: np.ndarray = JOINT) -> tuple[np.ndarray, np.ndarray]:
    """Periodic steady state of both sides, by the closed form line by line."""
    spectrum = np.fft.rfft(drive)
    s = 2j * np.pi * np.fft.rfftfreq(drive.size, 1 / RATE)
    s[0] = 1.0
    motor, load = TwoInertia(values=values).accelerations(s)
    spectrum[0] = 0.0
    return np.fft.irfft(spectrum * motor / s**2), np.fft.irfft(spectrum * load / s**2)


def campaign(
    *, load_sign: float = 1.0, unit: str = "A", noise: float = 1e-3, load: bool = True, **rig: float
) -> Campaign:
    rng = np.random.default_rng(1)
    drive = multisine()
    motor, arm = angles(drive)
    noisy = [x + noise * x.std() * rng.standard_normal(x.size) for x in (motor, load_sign * arm)]
    quantity = "torque" if unit == "N m" else "current"
    channels = [
        Channel(column="u", quantity=quantity, unit=unit, location="motor", role="input", samples=drive),
        Channel(column="m", quantity="angle", unit="rad", location="motor", role="output", samples=noisy[0]),
    ]
    if load:
        channels.append(
            Channel(column="l", quantity="angle", unit="rad", location="arm", role="output", samples=noisy[1])
        )
    stream = Stream(file="x", sampling_rate=RATE, length=drive.size, channels=tuple(channels))
    nameplate = Nameplate(
        topology="two-inertia", motion="rotational", plane="horizontal", reduction_ratio=1.0, **rig
    )
    run = Run(id="a", experiment="torque-sweep", streams=(stream,), initial="estimate")
    return Campaign(path=Path("x"), rig=nameplate, runs=(run,))


def test_the_model_is_the_papers_closed_form() -> None:
    joint = Joint(
        stiffness=600.0, damping=0.05, load_inertia=6e-3, motor_inertia=4e-3, reducer_inertia=0.0, reduction_ratio=1.0,
        motor_damping=0.04, load_damping=0.06,
    )  # fmt: skip
    s = 2j * np.pi * np.linspace(1, 200, 30)
    motor, load = TwoInertia(values=JOINT).accelerations(s)
    np.testing.assert_allclose(motor, motor_acceleration_per_torque(joint, s), rtol=1e-12)
    np.testing.assert_allclose(load, load_acceleration_per_torque(joint, s), rtol=1e-12)


def test_a_period_is_found_where_there_is_one_and_only_there() -> None:
    rng = np.random.default_rng(0)
    drive = multisine()
    assert find_period(drive) == PERIOD
    assert find_period(drive + 0.1 * drive.std() * rng.standard_normal(drive.size)) == PERIOD
    assert find_period(rng.standard_normal(8000)) == 0
    time = np.arange(8000) / RATE
    assert find_period(np.sin(2 * np.pi * (4 * time + 4 * time**2))) == 0


def test_responses_of_a_clean_multisine_are_exact() -> None:
    drive = multisine()
    found = estimate_responses(drive, np.array(angles(drive)), RATE, (0, 0))
    assert found.period == PERIOD and found.averages == PERIODS - 1
    motor, load = TwoInertia(values=JOINT).accelerations(2j * np.pi * found.frequency)
    np.testing.assert_allclose(found.values, [motor, load], rtol=1e-6)


def test_a_broadband_record_without_period_is_averaged_over_segments() -> None:
    rng = np.random.default_rng(3)
    drive = rng.standard_normal(60_000)
    found = estimate_responses(drive, np.array(angles(drive)), RATE, (0, 0))
    assert found.period == 0
    keep = (found.frequency > 10) & (found.frequency < 40)
    motor, _ = TwoInertia(values=JOINT).accelerations(2j * np.pi * found.frequency)
    assert np.median(np.abs(found.values[0] / motor - 1.0)[keep]) < 0.05


def test_everything_comes_back_with_a_known_torque_constant() -> None:
    found = identify(campaign(torque_constant=1.0, noise=1e-4))
    for name, truth in zip(
        ("motor_inertia_output", "inertia", "stiffness", "damping", "motor_damping", "load_damping"),
        JOINT,
        strict=True,
    ):
        assert found.parameters[name].value == pytest.approx(truth, rel=0.03), name
    assert found.parameters["stiffness"].unit == "N m/rad"
    zero, pole = found.modes
    assert zero.frequency.value == pytest.approx(np.sqrt(600 / 6e-3) / 2 / np.pi, rel=1e-3)
    assert pole.frequency.value == pytest.approx(np.sqrt(600 * (1 / 4e-3 + 1 / 6e-3)) / 2 / np.pi, rel=1e-3)


def test_without_a_torque_constant_values_are_per_ampere_and_absolutes_are_refused() -> None:
    found = identify(campaign())
    assert found.parameters["stiffness"].unit == "N m/rad per (N m per A)"
    assert any(row.parameter == "absolute stiffness" for row in found.refused)
    assert found.parameters["inertia_ratio"].value == pytest.approx(1.5, rel=0.01)


def test_a_known_motor_inertia_gives_the_scale() -> None:
    found = identify(campaign(motor_inertia=8e-3))
    assert found.parameters["stiffness"].value == pytest.approx(1200.0, rel=0.01)
    assert found.parameters["stiffness"].unit == "N m/rad"


def test_an_inverted_load_channel_is_turned_and_stated() -> None:
    upright, inverted = identify(campaign()), identify(campaign(load_sign=-1.0))
    assert inverted.parameters["stiffness"].value == pytest.approx(upright.parameters["stiffness"].value, rel=1e-4)
    assert any("inverted" in note for note in inverted.notes)
    assert not any("inverted" in note for note in upright.notes)


def test_one_side_alone_is_refused_without_the_motor_inertia() -> None:
    found = identify(campaign(load=False))
    assert not found.parameters
    assert "motor_inertia" in found.refused[0].reason


def test_noise_widens_intervals() -> None:
    quiet, loud = identify(campaign(noise=1e-3)), identify(campaign(noise=0.1))

    def width(found: object) -> float:
        mode = found.modes[1].frequency  # type: ignore[attr-defined]
        return mode.high - mode.low

    assert width(loud) > 3.0 * width(quiet)


def test_an_unexcited_input_is_refused() -> None:
    made = campaign()
    stream = made.runs[0].streams[0]
    flat = replace(stream.channels[0], samples=np.sin(2 * np.pi * 10.0 * np.arange(stream.length) / RATE))
    run = replace(made.runs[0], streams=(replace(stream, channels=(flat, *stream.channels[1:])),))
    assert not identify(replace(made, runs=(run,))).parameters


def test_the_fit_needs_both_sides_or_the_inertia() -> None:
    drive = multisine()
    found = estimate_responses(drive, np.array(angles(drive))[1:], RATE, (0,))
    with pytest.raises(RefusedError, match="motor_inertia"):
        fit_two_inertia([found], ["load"])
    fit = fit_two_inertia([found], ["load"], {0: float(JOINT[0])})
    assert fit.joint.values[2] == pytest.approx(600.0, rel=0.01)
