"""A slide's drive follows a speed in m/s where its motor is counted in metres, and in no other case."""

import numpy as np
import pytest

from jointscope.errors import CampaignError
from jointscope.recordings.reader import read_campaign
from jointscope.recordings.units import si_unit

TOML = """format = "jointscope-campaign/1"
[rig]
topology = "two-inertia"
motion = "translational"
plane = "horizontal"
reduction_ratio = 1.0
motor_inertia = 5.0
[[run]]
id = "a"
experiment = "speed-motion"
[[run.stream]]
file = "a.csv"
sampling_rate = 1000.0
start = 0.0
channels = [
  { column = "w", quantity = "speed-command", unit = "m/s", location = "motor", role = "input" },
  { column = "x", quantity = "position", unit = "m", location = "load", role = "output" },
]
"""


@pytest.fixture
def slide(tmp_path):
    t = np.arange(256) / 1000.0
    np.savetxt(
        tmp_path / "a.csv", np.stack([0.02 * t, 0.01 * t**2], axis=1), delimiter=",", header="w,x", comments=""
    )
    (tmp_path / "campaign.toml").write_text(TOML, encoding="utf-8")
    return tmp_path


def test_its_command_is_read_as_it_is(slide):
    (command,) = read_campaign(slide).runs[0].select("speed-command")
    assert si_unit(command.channel) == "m/s"
    assert command.samples[-1] == pytest.approx(0.02 * 0.255)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("reduction_ratio = 1.0", "reduction_ratio = 20.0"),
        ('motion = "translational"', 'motion = "rotational"'),
    ],
)
def test_a_motor_that_turns_is_told_in_what_it_turns(slide, old, new):
    path = slide / "campaign.toml"
    text = path.read_text(encoding="utf-8").replace(old, new)
    if "rotational" in new:
        text = text.replace('quantity = "position", unit = "m"', 'quantity = "angle", unit = "rad"').replace(
            '"load"', '"arm"'
        )
    path.write_text(text, encoding="utf-8")
    with pytest.raises(CampaignError) as caught:
        read_campaign(slide)
    line = str(caught.value)
    assert "\n" not in line and all(word in line for word in ("unit", "m/s", "rad/s", "translational"))
