"""An axis without a spring: one motion, whichever side of the gear it was recorded on."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from jointscope.diagnosis.base import refit_base
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


@pytest.mark.parametrize(
    ("plane", "mass", "free"), [("vertical", None, True), ("vertical", 5.0, False), ("horizontal", None, False)]
)
def test_a_vertical_arm_of_which_nothing_is_stated_is_weighed_by_the_torque_that_moves_it(
    builders, plane, mass, free
):
    """J a + M cos q + b v = T: the moment of a weight that no nameplate gives is the base's own number, and is found."""
    J, b, M, rate = 1.9, 1.4, 27.9, 500.0
    t = np.arange(4000) / rate
    q = -1.5 + 0.6 * np.sin(1.3 * t) * (1.0 - np.exp(-2.0 * t))
    v = np.gradient(q, t)
    torque = J * np.gradient(v, t) + M * np.cos(q) + b * v
    channels = (
        builders.channel("T", "torque", "N m", "arm", "input", torque),
        builders.channel("q", "angle", "rad", "arm", "output", q),
    )
    stream = Stream(file="m.csv", sampling_rate=rate, length=t.size, channels=channels)
    rig = Nameplate(
        topology="single-dof", motion="rotational", plane=plane, inertia_reference=1.1, arm_mass=mass,
        arm_com_radius=None if mass is None else 0.57,
    )  # fmt: skip
    runs = [Run(id=name, experiment="speed-motion", streams=(stream,), arm_angle=-1.5) for name in "ab"]
    problem = prepare(builders.campaign_of(runs, rig))
    assert bool(dict(zip(problem.base.names, problem.base.free, strict=True))["gravity_moment"]) is free
    if not free:
        return
    with ThreadPoolExecutor(2) as pool:
        fit = refit_base(problem, predict_outputs, (0, 1), pool).fit
    found = dict(zip(problem.base.names, fit.coordinates.unpack(fit.x)[0], strict=True))
    assert found["gravity_moment"] == pytest.approx(M, rel=0.01)
    assert found["load_inertia"] == pytest.approx(J, rel=0.03)
