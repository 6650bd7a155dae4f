"""Where the arm is known to have been: a model's own drift is no travel."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from jointscope.diagnosis.sizes import _where_known

T = np.arange(4096) / 1024.0
ANGLE = 0.06 * T**2 / 16.0 + 1e-3 * np.sin(2.0 * np.pi * 30.0 * T)


@pytest.mark.parametrize(
    ("experiment", "observed", "travel"),
    [
        ("torque-sweep", None, (1.9e-3, 8e-3)),
        ("torque-sweep", "angle", (0.06, 0.063)),
        ("speed-motion", None, (0.06, 0.063)),
    ],
)
def test_an_open_sweep_whose_angles_nobody_recorded_goes_nowhere(experiment, observed, travel):
    """60 mrad of drift under a vibration of 1 mrad; an angle that was recorded, or commanded, is believed."""
    run = SimpleNamespace(
        run=SimpleNamespace(experiment=experiment), motor_moves=True, observed=observed, grid_rate=1024.0
    )
    low, high = travel
    assert low < np.ptp(_where_known(run, ANGLE)) < high
