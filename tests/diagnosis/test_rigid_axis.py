"""An axis without a spring: one motion, whichever side of the gear it was recorded on."""

import numpy as np
import pytest

from jointscope.diagnosis.predict import free_prediction, predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.recordings.campaign import Nameplate, Run, Stream


@pytest.mark.parametrize("quantity", ["angular-velocity", "angle"])
def test_of_a_rigid_axis_the_motor_turns_as_the_arm_does(builders, quantity):
    """J v' + b v = n T sin(w t) from rest; what the motor's encoder and tachometer say is n times that, followed and free."""
    J, b, n, w, T, rate = 11.0, 4.0, 50.0, 5.0, 1.5, 1000.0
    t = np.arange(3000) / rate
    scale, lag = n * T / (b * b + (J * w) ** 2), np.exp(-b * t / J)
    v = scale * (b * np.sin(w * t) - J * w * np.cos(w * t) + J * w * lag)
    q = scale * (b * (1.0 - np.cos(w * t)) / w - J * np.sin(w * t) + J * J * w / b * (1.0 - lag))
    shaft = (n * v, "rad/s") if quantity == "angular-velocity" else (n * q, "rad")
    channels = (
        builders.channel("T", "torque", "N m", "motor", "input", T * np.sin(w * t)),
        builders.channel("m", quantity, shaft[1], "motor", "output", shaft[0]),
        builders.channel("q", "angle", "rad", "arm", "output", q),
    )
    stream = Stream(file="m.csv", sampling_rate=rate, length=t.size, channels=channels)
    rig = Nameplate(topology="single-dof", motion="rotational", plane="horizontal", reduction_ratio=n)
    run = Run(id="m", experiment="speed-motion", streams=(stream,))
    problem = prepare(builders.campaign_of([run], rig))
    theta = problem.theta(load_inertia=J, load_damping=b)
    run = problem.runs[0]
    assert ("motor", quantity) in {(o.location, o.quantity) for o in run.outputs}
    for predict, most in ((predict_outputs, 2e-3), (free_prediction, 5e-3)):
        for output, y in zip(run.outputs, predict(run, theta, (), problem), strict=True):
            d = output.data[output.mask]
            assert np.std(d - y[output.mask]) < most * d.std()
