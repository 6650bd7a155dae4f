"""A motor that turns a screw: what turns on a rig that slides is a known angle to the metre."""

import numpy as np
import pytest

from jointscope.errors import CampaignError
from jointscope.recordings.reader import read_campaign

LEAD = 0.02  # m per turn
TOML = """format = "jointscope-campaign/1"
[rig]
topology = "two-inertia"
motion = "translational"
plane = "horizontal"
reduction_ratio = {ratio}
motor_inertia = 4e-4
reducer_inertia = 1e-4
[[run]]
id = "a"
experiment = "speed-motion"
[[run.stream]]
file = "a.csv"
sampling_rate = 1000.0
start = 0.0
channels = [
  {{ column = "t", quantity = "torque", unit = "N m", location = "motor", role = "input" }},
  {{ column = "m", quantity = "angle", unit = "rad", location = "motor", role = "output" }},
  {{ column = "w", quantity = "angular-velocity", unit = "rad/s", location = "motor", role = "output" }},
  {{ column = "x", quantity = "position", unit = "m", location = "load", role = "output" }},
]
"""


@pytest.fixture
def slide(tmp_path):
    t = np.arange(256) / 1000.0
    x = 0.01 * t**2
    table = np.stack([np.ones_like(t), x / LEAD * 2.0 * np.pi, 0.02 * t / LEAD * 2.0 * np.pi, x], axis=1)
    np.savetxt(tmp_path / "a.csv", table, delimiter=",", header="t,m,w,x", comments="")
    (tmp_path / "campaign.toml").write_text(TOML.format(ratio=2.0 * np.pi / LEAD), encoding="utf-8")
    return tmp_path


def test_a_motors_shaft_is_read_beside_the_slide(slide):
    campaign = read_campaign(slide)
    (angle,) = campaign.runs[0].select("angle", location="motor")
    (position,) = campaign.runs[0].select("position", location="load")
    np.testing.assert_allclose(angle.samples / campaign.rig.reduction_ratio, position.samples, atol=1e-15)
    (torque,) = campaign.runs[0].select("torque")
    assert torque.channel.role == "input"


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("reduction_ratio", "# reduction_ratio", ["quantity", "torque", "angle per metre", "rig.reduction_ratio"]),
        ('role = "input"', 'role = "input", side = "output"', ["side", "output", "slides", "force"]),
        ('quantity = "torque"', 'quantity = "linear-acceleration"', ["linear-acceleration", "translational"]),
    ],
)
def test_what_has_no_meaning_there_is_refused(slide, old, new, words):
    path = slide / "campaign.toml"
    path.write_text(path.read_text(encoding="utf-8").replace(old, new, 1), encoding="utf-8")
    with pytest.raises(CampaignError) as caught:
        read_campaign(slide)
    line = str(caught.value)
    assert "\n" not in line and all(word in line for word in words)
