"""A motion under speed control is foretold by its torque log; the drive's law only keeps it from drifting off."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis import assembly
from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.effects import ActiveEffect, catalogue
from jointscope.diagnosis.predict import free_prediction
from jointscope.diagnosis.prepare import prepare
from jointscope.models.effects.augment import DRIFT_HZ

FRICTION = 8.0  # N m


@pytest.fixture(scope="module")
def motion(builders):
    """Ten degrees there and back at 1 Hz with friction at the motor, logged with what its drive was commanded."""
    plant = builders.Plant(extra=lambda t, x: (-FRICTION * np.tanh(x[1] / 1e-2), 0.0))
    rate, duration, q0 = 500.0, 3.0, -1.047
    t = np.arange(int(duration * rate)) / rate
    hold = plant.weight * np.cos(q0)

    def motor(u):
        return hold + 60.0 * min(u / 0.2, 1.0) * np.sin(2.0 * np.pi * u)

    path, rates = plant.motion(lambda u: 0.0, motor, False, q0, duration)
    x = path(t)
    arm = np.array([rates(u, s)[3] for u, s in zip(t, x.T, strict=True)])
    torque = np.array([motor(u) for u in t]) / plant.n / plant.eta
    channel = builders.channel
    stream = replace(
        builders.sweep_run(plant, 30.0, "m", duration=0.1).streams[1],
        sampling_rate=rate, length=t.size,
        channels=(
            channel("T", "torque", "N m", "motor", "input", torque),
            channel("w", "speed-command", "rad/s", "motor", "input", x[1] * plant.n),
            channel("th", "angle", "rad", "motor", "output", x[0] * plant.n),
            channel("a", "angular-acceleration", "rad/s^2", "arm", "output", arm),
        ),
    )  # fmt: skip
    run = replace(builders.sweep_run(plant, 30.0, "m", duration=0.1), experiment="speed-motion", streams=(stream,))
    return prepare(builders.campaign_of([builders.hammer_run(plant, 100.0, "h"), run]))


def errors(problem, lag, *effects):
    """Error over signal of (angle, acceleration), the drive's law asking for ``lag`` of its speed beside what it was told."""
    theta = problem.theta(stiffness=1.9e5, damping=60.0, load_inertia=3.0, motor_damping=2.0, load_damping=2.0)
    total = theta[BASE_INDEX["load_inertia"]] + theta[BASE_INDEX["motor_inertia"]]
    for name, value in (("gain", 60.0), ("integral", 360.0), ("acceleration", 0.0)):
        theta[BASE_INDEX[f"drive_{name}"]] = value * total
    theta[BASE_INDEX["drive_velocity"]] = -lag * 60.0 * total
    run = next(r for r in problem.runs if r.run.experiment == "speed-motion")
    found = []
    for quantity in ("angle", "angular-acceleration"):
        k = next(k for k, o in enumerate(run.declared) if o.quantity == quantity)
        y, data = free_prediction(run, theta, effects, problem)[k], run.declared[k].data
        found.append(float(np.std(y - data) / np.std(data)))
    return found


@pytest.fixture(scope="module")
def friction(motion):
    wanted = ("coulomb-friction", "motor", "plain")
    return ActiveEffect(
        next(s for s in catalogue(motion) if (s.name, s.location, s.variant) == wanted), (FRICTION,)
    )


@pytest.mark.parametrize("lag", [0.0, 0.1])
def test_what_the_model_lacks_shows_whatever_the_drives_law_lacks(motion, friction, lag):
    """The log was made by no such law: held to it up to 3 Hz, the model with the friction came out no nearer."""
    named, base = errors(motion, lag, friction), errors(motion, lag)
    assert max(named) < 0.12
    assert named[0] < 0.5 * base[0] and named[1] < 0.7 * base[1]


def test_held_more_tightly_the_law_hides_it(motion, friction, monkeypatch):
    monkeypatch.setattr(assembly, "COMMAND_HZ", assembly.OBSERVER_HZ)
    named, base = errors(motion, 0.0, friction), errors(motion, 0.0)
    assert named[1] > base[1]


def test_the_replay_in_mujoco_is_held_as_tightly():
    assert DRIFT_HZ == assembly.COMMAND_HZ
