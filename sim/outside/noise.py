"""Noise of every channel, from what the plain joint would record."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jointscope.sim.outside.devices import Devices
from jointscope.sim.outside.rig import Rig, log_uniform
from jointscope.sim.outside.sensing import Record
from jointscope.sim.outside.takes import Take

Real = NDArray[np.float64]
STEP_NOISE: Final = 0.45  # rms error of an encoder in steps: rounding, and DITHER before it
DITHER: Final = 0.3  # steps
SPEED_NOISE: Final = 0.003  # of a speed's own rms
FORCE_NOISE: Final = 4e-5  # of a hit's peak
LOWEST: Final = 0.5  # Hz, below which the accelerometer's noise grows no more
HUMP_WIDTH: Final = 20.0  # Hz
SLIDING_STEPS: Final = (1e-6, 5e-7, 2e-6)  # m


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Levels of one case.

    Attributes:
        levels: rms by channel, in the channel's unit.
        corner: Where 1/f meets white in the accelerometer's noise [Hz].
        hump: Centre of a hump in it [Hz].
        hump_size: Relative to white.
        torque_share: White noise of the torque's log over the torque's rms.
        motor_step: Encoder step on the motor's shaft [rad].
        arm_step: At the arm [rad], of a sliding rig [m].
    """

    levels: dict[str, float]
    corner: float
    hump: float
    hump_size: float
    torque_share: float
    motor_step: float
    arm_step: float

    def shape(self, frequency: Real, rate: float) -> Real:
        """Power of the accelerometer's noise at ``frequency`` [Hz] relative to white noise of the same rms."""
        return self._raw(frequency) / float(self._raw(np.linspace(LOWEST, rate / 2.0, 4000)).mean())

    def _raw(self, frequency: Real) -> Real:
        hump = self.hump_size * np.exp(-(((frequency - self.hump) / HUMP_WIDTH) ** 2))
        return np.asarray(1.0 + self.corner / np.maximum(frequency, LOWEST) + hump)


def typical_acceleration(takes: Sequence[Take], clean: Sequence[Record]) -> float:
    """rms of the accelerometer [m/s^2] in the median hit; without hits that of the liveliest run."""
    sizes = [float(np.std(record["acceleration"])) for record in clean]
    hits = [size for size, take in zip(sizes, takes, strict=True) if take.hit]
    return float(np.median(hits or [max(sizes)]))


def draw_noise(
    takes: Sequence[Take], clean: Sequence[Record], rig: Rig, *, hard: bool, rng: np.random.Generator
) -> Noise:
    """Levels in proportion to what is measured; larger where the case is a ``hard`` null."""

    def sizes(name: str) -> list[float]:
        return [float(np.std(record[name])) for record in clean if name in record] or [1.0]

    relative = log_uniform(rng, 0.004, 0.02) * (3.0 if hard else 1.0)
    torque_share = log_uniform(rng, 0.005, 0.02) * (2.0 if hard else 1.0)
    motor_step = 2.0 * np.pi / 2 ** int(rng.integers(14, 20))
    arm_step = 2.0 * np.pi / 2 ** int(rng.integers(19, 24))
    if rig.slide is not None:
        arm_step = float(rng.choice(SLIDING_STEPS))
    peaks = [float(np.abs(record["force"]).max()) for record in clean if "force" in record]
    levels = {
        "acceleration": relative * typical_acceleration(takes, clean),
        "torque": torque_share * float(np.median(sizes("torque"))), "force": FORCE_NOISE * max(peaks or [1.0]),
        "motor": STEP_NOISE * motor_step, "arm": STEP_NOISE * arm_step, "position": STEP_NOISE * arm_step,
        "windup": STEP_NOISE * float(np.hypot(arm_step, motor_step / rig.ratio)),
        "speed": SPEED_NOISE * max(sizes("speed")),
    }  # fmt: skip
    return Noise(
        levels=levels, corner=log_uniform(rng, 2.0, 30.0), hump=log_uniform(rng, 60.0, 200.0),
        hump_size=float(rng.uniform(0.0, 2.0)), torque_share=torque_share, motor_step=motor_step, arm_step=arm_step,
    )  # fmt: skip


def _stepped(signal: Real, step: float, rng: np.random.Generator) -> Real:
    return np.asarray(np.round(signal / step + DITHER * rng.standard_normal(signal.size)) * step)


def noisy(record: Record, noise: Noise, devices: Devices, level: float, rng: np.random.Generator) -> Record:
    """``record`` with noise and encoder steps; the accelerometer clips at ``level`` [m/s^2]."""
    found = dict(record)
    for name, signal in record.items():
        if name == "acceleration":
            frequency = np.asarray(np.fft.rfftfreq(signal.size, 1.0 / devices.daq_rate), dtype=np.float64)
            white = np.fft.rfft(rng.standard_normal(signal.size))
            coloured = np.fft.irfft(white * np.sqrt(noise.shape(frequency, devices.daq_rate)), signal.size)
            found[name] = np.clip(signal + noise.levels[name] * coloured, -level, level)
        elif name == "motor":
            found[name] = _stepped(signal, noise.motor_step, rng)
        elif name in ("arm", "position"):
            found[name] = _stepped(signal, noise.arm_step, rng)
        elif name in ("torque", "force", "speed"):
            found[name] = signal + noise.levels[name] * rng.standard_normal(signal.size)
    return found
