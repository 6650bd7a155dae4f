"""A ball screw: its motor is read along the slide or on its shaft, and is the same motor."""

from dataclasses import replace

import numpy as np
import pytest

from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.recordings.campaign import Nameplate


@pytest.mark.parametrize("seen", ["position", "velocity", "angle"])
def test_a_screws_motor_is_read_in_metres_along_the_slide_and_in_radians_on_its_shaft(builders, edited, seen):
    screw = builders.Plant(
        K=2.6e6, c=370.0, J_L=27.0, J_m=4.3e-4, n=314.16, b_m=100.0, b_l=40.0, eta=0.9, weight=0.0
    )
    rig = Nameplate(
        topology="two-inertia", motion="translational", plane="horizontal", reduction_ratio=screw.n,
        motor_inertia=screw.J_m, efficiency=screw.eta, motor_damping=100.0, load_damping=40.0,
        stiffness_reference=2.6e6, inertia_reference=27.0,
    )  # fmt: skip

    def slides(c):
        if c.quantity == "linear-acceleration":
            return replace(c, quantity="acceleration", location="load", samples=c.samples / 0.95, radius=None)
        if c.quantity != "angle" or seen == "angle":
            return c
        if seen == "position":
            return replace(c, quantity="position", unit="m", samples=c.samples / screw.n)
        speed = np.gradient(c.samples, edge_order=2) * 500.0 / screw.n
        return replace(c, quantity="velocity", unit="m/s", samples=speed)

    run = edited(builders.sweep_run(screw, 30.0, "a", q0=0.0), slides)
    problem = prepare(builders.campaign_of([run], rig))
    theta = problem.theta(
        stiffness=screw.K, damping=screw.c, load_inertia=screw.J_L, motor_damping=100.0, load_damping=40.0
    )
    (prepared,) = problem.runs
    for output, y in zip(prepared.outputs, predict_outputs(prepared, theta, (), problem), strict=True):
        d = output.data[output.mask]
        error = float(np.sqrt(np.mean((d - y[output.mask]) ** 2)) / d.std())
        assert error < (0.15 if seen == "velocity" else 0.01), (output.quantity, error)
