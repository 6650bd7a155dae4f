"""Faults of the recording: clocks, accelerometer, torque log, encoder. They act on what is measured only."""

from __future__ import annotations

from typing import Final

import numpy as np

from jointscope.sim.outside.effect import Build, Law, Maker, Scene
from jointscope.sim.outside.rig import log_uniform

LOG_RATES: Final = (25.0, 40.0, 50.0, 80.0, 100.0, 125.0, 200.0, 250.0, 500.0)  # Hz
MIDDLE_RATE: Final = 4  # place of the rate of size 1
PICKUP: Final = 0.16  # of the acceleration, by a torque rate of T_r w_0


def delay(scene: Scene, rng: np.random.Generator) -> Law:
    """The log stamps late, seldom early."""
    unit = 8e-4 * float(rng.choice((1.0, 1.0, -1.0)))
    build = lambda size: Build(chain={"delay": unit * size}, parameters={"delay": unit * size})  # noqa: E731
    return Law("constant", "delay", build, least=0.01, most=6.0)


def clock_drift(scene: Scene, rng: np.random.Generator) -> Law:
    """The log's clock runs fast or slow."""
    unit = 300.0 * float(rng.choice((1.0, -1.0)))
    build = lambda size: Build(chain={"ppm": unit * size}, parameters={"ppm": unit * size})  # noqa: E731
    return Law("constant", "ppm", build, least=0.1)


def tilt(scene: Scene, rng: np.random.Generator) -> Law:
    """The accelerometer's axis is turned from tangential towards radially outward."""
    unit = 0.06 * float(rng.choice((1.0, -1.0)))
    build = lambda size: Build(chain={"tilt": unit * size}, parameters={"angle": unit * size})  # noqa: E731
    return Law("turned", "angle", build, most=6.0)


def resonance(scene: Scene, rng: np.random.Generator) -> Law:
    """The accelerometer's mount, of second order."""
    damping = log_uniform(rng, 0.03, 0.5)
    unit = log_uniform(rng, 2.5, 5.0) * max(scene.rig.own_frequency, 25.0)

    def build(size: float) -> Build:
        frequency = max(unit / float(np.sqrt(size)), 1.8 * scene.rig.own_frequency)
        chain = {"resonance": frequency, "resonance_damping": damping}
        return Build(chain=chain, parameters={"frequency": frequency, "damping": damping})

    return Law("second order", "frequency", build, least=0.004, most=3.0)


def saturation(scene: Scene, rng: np.random.Generator) -> Law:
    """The accelerometer clips."""

    def build(size: float) -> Build:
        level = scene.peak / (1.0 + 0.35 * size)
        return Build(chain={"level": level}, parameters={"level": level})

    return Law("hard", "level", build, least=0.02, most=4.0)


def sensor_gain(scene: Scene, rng: np.random.Generator) -> Law:
    """Recorded over true, of the accelerometer or the hammer's force."""
    sign, channel = float(rng.choice((-1.0, 1.0))), "accelerometer"
    if scene.hit and scene.experiments != "H" and rng.random() < 1.0 / 3.0:
        channel = "force"

    def build(size: float) -> Build:
        gain = 1.0 + sign * min(0.4, 0.07 * size)
        return Build(chain={f"{channel}_gain": gain}, parameters={"gain": gain})

    return Law(f"of the {channel}", "gain", build, most=5.0)


def torque_log(scene: Scene, rng: np.random.Generator) -> Law:
    """The logged torque is renewed at a low rate, held or averaged."""
    averaged = bool(rng.random() < 0.5)

    def build(size: float) -> Build:
        place = round(MIDDLE_RATE - 1.1 * float(np.log2(max(size, 1e-3))))
        rate = LOG_RATES[min(max(place, 0), len(LOG_RATES) - 1)]
        return Build(chain={"log_rate": rate, "log_averaged": averaged}, parameters={"rate": rate})

    return Law("averaged" if averaged else "held", "rate", build, least=0.05)


def eccentricity(scene: Scene, rng: np.random.Generator) -> Law:
    """The motor's encoder sits off its axis: an error of the reading only (in no catalogue)."""
    phase = float(rng.uniform(-3.0, 3.0))

    def build(size: float) -> Build:
        chain = {"eccentricity": 4e-3 * size, "eccentric_phase": phase}
        return Build(chain=chain, parameters={"amplitude": 4e-3 * size})

    return Law("once per motor turn", "amplitude", build, least=0.005, most=10.0, departs=True)


def pickup(scene: Scene, rng: np.random.Generator) -> Law:
    """The accelerometer's cable picks up the current's rate (in no catalogue)."""
    unit = PICKUP * scene.acceleration / (scene.rig.rated_torque * scene.rig.own_rate)
    build = lambda size: Build(chain={"pickup": unit * size}, parameters={"pickup": unit * size})  # noqa: E731
    return Law("torque's rate", "pickup", build, most=10.0, departs=True)


def rectified(scene: Scene, rng: np.random.Generator) -> Law:
    """The accelerometer's baseline is pulled down while it vibrates (in no catalogue)."""
    build = lambda size: Build(chain={"rectified": 0.25 * size}, parameters={"share": 0.25 * size})  # noqa: E731
    return Law("slow mean of |a|", "share", build, most=10.0, departs=True)


MAKERS: Final[dict[str, Maker]] = {
    "delay@acquisition": delay, "clock-drift@acquisition": clock_drift, "sensor-tilt@acquisition": tilt,
    "sensor-resonance@acquisition": resonance, "sensor-saturation@acquisition": saturation,
    "sensor-gain@acquisition": sensor_gain, "torque-logging@acquisition": torque_log,
    "encoder-eccentricity@acquisition": eccentricity, "pickup-of-dI/dt@acquisition": pickup,
    "iepe-rectified-baseline@acquisition": rectified,
}  # fmt: skip
