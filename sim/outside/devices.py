"""What is recorded of a case: channels, rates, one device or two, how the accelerometer is coupled."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal

import numpy as np

from jointscope.sim.outside.intent import Intent
from jointscope.sim.outside.setup import Setup

ChannelSet = Literal["full", "no-arm", "acc-torque", "no-torque"]
DAQ_RATES: Final = (1024, 1600, 2000, 2048, 2500, 4000, 5000)  # Hz
LOG_RATES: Final = (500, 1000, 2000)  # Hz
LOW_CUTOFFS: Final = (0.1, 0.3, 0.5, 1.0, 2.0)  # Hz
CLOCKS: Final = {"delay", "clock-drift"}  # need two devices
MANY: Final = {
    "sensor-gain", "delay", "clock-drift", "encoder-eccentricity", "transmission-error", "stiffness-per-motor-turn",
    "torque-ripple", "load-dependent-friction",
}  # fmt: skip
TORQUE_TO_SPARE: Final = {"transmission-error", "end-stop", "sensor-tilt", "clock-drift"}
LINEAR_ONLY: Final = {
    "sensor-tilt", "sensor-gain", "external-vibration", "base-compliance", "neighbour-flexibility", "sensor-saturation",
}  # fmt: skip


@dataclass(frozen=True, kw_only=True)
class Devices:
    """The measuring equipment.

    Attributes:
        daq_rate: [Hz], of the force and the accelerometer.
        log_rate: [Hz], of the drive's own log.
        two: Whether these are two devices with clocks of their own.
        accelerometer: Whether runs other than hits have one (hits always do).
        arm_on_hits: Whether the arm's angle is recorded on hits too.
        arm_on_log: Whether it is the log that records it.
        angular: The accelerometer measures the angular acceleration.
        low_cutoff: Corner of its first-order high-pass [Hz]; 0 where it is dc-coupled.
        uncertain: The log's start is known to 1 ms only, and is off by up to 0.8 ms.
    """

    daq_rate: float
    log_rate: float
    two: bool
    accelerometer: bool
    torque: bool
    motor: bool
    arm: bool
    arm_on_hits: bool
    arm_on_log: bool
    angular: bool
    low_cutoff: float
    uncertain: bool


def draw_devices(intent: Intent, setup: Setup, rng: np.random.Generator) -> Devices:
    """Equipment that lets the effects be seen."""
    names, rig, experiments = intent.names, setup.rig, setup.experiments
    daq, log = float(rng.choice(DAQ_RATES)), float(rng.choice(LOG_RATES))
    two = bool(names & CLOCKS) or bool(rng.random() >= 0.25)
    channels = _channel_set(intent, setup, rng)
    arm = channels not in ("no-arm", "acc-torque") and rig.slide is None
    accelerometer = True
    if setup.rigid:
        two, daq, accelerometer = False, float(rng.choice(LOG_RATES)), bool(rng.random() < 0.4)
    if experiments == "H":
        two = False
    angular = bool(rng.random() < 0.12) and not names & LINEAR_ONLY and rig.slide is None
    uncertain = intent.hard and experiments in ("HS", "HSM", "S") and intent.place % 2 == 1
    devices = Devices(
        daq_rate=daq, log_rate=log if two else daq, two=two, accelerometer=accelerometer,
        torque=channels != "no-torque", motor=channels != "acc-torque", arm=arm,
        arm_on_hits=arm and bool(rng.random() < 0.5), arm_on_log=bool(rng.random() < 0.5), angular=angular,
        low_cutoff=_low_cutoff(intent, setup, rng) if not angular else 0.0, uncertain=uncertain and two,
    )  # fmt: skip
    return replace(devices, arm_on_log=True) if devices.uncertain and arm else devices


def _channel_set(intent: Intent, setup: Setup, rng: np.random.Generator) -> ChannelSet:
    names, experiments = intent.names, setup.experiments
    sets: tuple[ChannelSet, ...] = ("full", "no-arm", "acc-torque", "no-torque")
    chosen = sets[int(rng.choice(len(sets), p=(0.45, 0.3, 0.15, 0.1)))]
    if experiments == "H":
        chosen = "full" if rng.random() < 0.5 else "no-arm"
    if names & MANY or len(names) > 1:
        chosen = "full" if rng.random() < 0.75 else "no-arm"
    if chosen == "no-torque" and not (experiments in ("HM", "M") and names <= TORQUE_TO_SPARE):
        chosen = "full"
    blind = ("M" in experiments and experiments != "HSM") or "drive-lag" in names
    if chosen == "acc-torque" and blind:
        chosen = "no-arm"
    return "full" if names & {"sensor-gain", "delay"} else chosen


def _low_cutoff(intent: Intent, setup: Setup, rng: np.random.Generator) -> float:
    coupled = bool(rng.random() < 0.5) and "sensor-tilt" not in intent.names
    if not setup.rig.vertical and (rng.random() < 0.6 or "gravity" in intent.names):
        coupled = True
    cutoff = float(rng.choice(LOW_CUTOFFS))
    return cutoff if coupled else 0.0
