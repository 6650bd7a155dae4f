"""What counts as visible: nothing that only the ends of a record make of a slow drift."""

import numpy as np
import pytest

from jointscope.sim.concealed.yardstick import whiten

N = 2400


def visible(name, y, above=20):
    """|w| of one channel whose noise is white above bin ``above`` and hides everything below it."""
    weight = np.where(np.arange(N // 2 + 1) > above, np.sqrt(2.0 / N), 0.0)
    return float(np.linalg.norm(whiten([{name: y}], [{name: weight}])))


@pytest.mark.parametrize("name", ["motor", "arm"])
def test_an_angle_that_has_drifted_does_not_jump_back(name):
    """It moves by 30 standard deviations over the first second of three, and stays."""
    t = np.linspace(0.0, 3.0, N)
    drift = 30.0 * (1.0 - np.exp(-2.0 * t) * (1.0 + 2.0 * t))
    assert visible(name, drift) < 0.03 * visible("acceleration", drift)
    assert visible("acceleration", drift) > 50.0


def test_what_moves_in_the_record_is_as_visible_as_before():
    tone = np.sin(2.0 * np.pi * 60.0 * np.arange(N) / N)
    assert visible("motor", tone) == pytest.approx(np.sqrt(N / 2), rel=1e-3)
    assert visible("motor", tone) == pytest.approx(visible("acceleration", tone), rel=1e-3)
