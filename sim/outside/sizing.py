"""How visible an effect is, and the search for a size that makes it as visible as is wanted.

z = the largest, over runs and channels, of rms(what a refit of the plain joint leaves)/rms(noise). The refit is linear
in the plain joint's constants, with a free gain per hit; the accelerometer is whitened by its noise's spectrum.
Counted are the accelerometer, the logged torque of motions (of sweeps for faults of the log and its clock), the wind-up
between two encoders, the arm's angle on hits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jointscope.sim.outside.devices import Devices
from jointscope.sim.outside.effect import Build, Law
from jointscope.sim.outside.noise import Noise
from jointscope.sim.outside.rig import Rig, log_uniform
from jointscope.sim.outside.sensing import Record
from jointscope.sim.outside.takes import Take

Real = NDArray[np.float64]
SHIFT: Final = 0.004  # relative, of a constant of the plain joint
TORQUE_MISMATCH: Final = 0.5  # of the torque log's noise share, in the accelerometer of a driven run
TRIES: Final = 5
LEVEL_FREE: Final = ("arm", "position", "windup")  # only changes of these count
SMALLEST: Final = 1e-30


@dataclass(frozen=True, kw_only=True)
class Visibility:
    """How visible a set of effects is.

    Attributes:
        z: See above.
        share: Largest share of a run's channel that the refit leaves (an NRMSE).
    """

    z: float
    share: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Yardstick:
    """The plain joint's clean records, what changing its constants does to them, and the noise.

    Attributes:
        shifted: Per constant, the records with it larger by ``SHIFT``.
        sweeps_count: Whether the torque log of sweeps counts.
    """

    takes: Sequence[Take]
    rig: Rig
    devices: Devices
    noise: Noise
    plain: Sequence[Record]
    shifted: Sequence[Sequence[Record]]
    sweeps_count: bool

    def counted(self, place: int) -> list[str]:
        """Channels of a run that count."""
        take, record = self.takes[place], self.plain[place]
        if take.hit:
            return ["acceleration", *(["arm"] if "arm" in record else [])]
        found = ["acceleration"] if self.devices.accelerometer else []
        if self.rig.slide is not None:
            return ["torque", "position", *found]
        if self.devices.torque and (take.travels or self.sweeps_count):
            found.append("torque")
        return [*found, "windup"] if self.devices.motor and "windup" in record else found

    def whitened(self, place: int, name: str, signal: Real) -> Real:
        """``signal`` in units of its noise; of the accelerometer as real and imaginary parts of its spectrum."""
        level = self.noise.levels[name]
        if name != "acceleration":
            return np.asarray((signal - signal.mean() if name in LEVEL_FREE else signal) / level)
        rate = self.devices.daq_rate
        frequency = np.asarray(np.fft.rfftfreq(signal.size, 1.0 / rate), dtype=np.float64)
        power = level**2 * self.noise.shape(frequency, rate)
        if not self.takes[place].hit:
            size = float(np.std(self.plain[place]["acceleration"]))
            power = power + (TORQUE_MISMATCH * self.noise.torque_share * size) ** 2
        spectrum = np.fft.rfft(signal) / np.sqrt(power * signal.size / 2.0)
        spectrum[0] /= np.sqrt(2.0)
        return np.concatenate([spectrum.real, spectrum.imag])


def visibility(yard: Yardstick, records: Sequence[Record]) -> Visibility:
    """How far ``records`` stay from the refitted plain joint."""
    residuals, columns, wholes, samples = [], [], [], []
    for place, record in enumerate(records):
        for name in yard.counted(place):
            plain = yard.plain[place][name]
            changes = [yard.whitened(place, name, record[name] - plain)]
            changes += [yard.whitened(place, name, (one[place][name] - plain) / SHIFT) for one in yard.shifted]
            block = np.stack(changes, axis=1)
            if yard.takes[place].hit:
                swing = yard.whitened(place, name, plain)
                swing /= max(float(np.linalg.norm(swing)), SMALLEST)
                block -= np.outer(swing, swing @ block)
            residuals.append(block[:, 0])
            columns.append(block[:, 1:])
            base = plain[0] if name in LEVEL_FREE else 0.0
            wholes.append(float(np.sum(yard.whitened(place, name, plain - base) ** 2)))
            samples.append(plain.size)
    left = _left_over(np.concatenate(residuals), np.concatenate(columns))
    parts = np.split(left, np.cumsum([residual.size for residual in residuals])[:-1])
    powers = [float(np.sum(part**2)) for part in parts]
    return Visibility(
        z=float(np.sqrt(max(power / n for power, n in zip(powers, samples, strict=True)))),
        share=float(
            np.sqrt(max(power / max(whole, SMALLEST) for power, whole in zip(powers, wholes, strict=True)))
        ),
    )


def _left_over(residual: Real, columns: Real) -> Real:
    sizes = np.linalg.norm(columns, axis=0)
    unit = columns / np.where(sizes == 0.0, 1.0, sizes)
    return np.asarray(residual - unit @ np.linalg.lstsq(unit, residual, rcond=1e-8)[0])


@dataclass(frozen=True)
class Sized:
    """A law whose size has been found."""

    size: float
    visibility: Visibility
    build: Build


def sized(
    law: Law, band: tuple[float, float], look: Callable[[Build], Visibility], rng: np.random.Generator
) -> Sized:
    """``law`` of a size whose z lies in ``band``, or as near to it as a few tries come within the law's limits.

    z is taken to grow as a power of the size; the power is corrected by what is found.

    Raises:
        FloatingPointError: Every size flew apart.
    """
    wanted, size, power = log_uniform(rng, *band), 1.0, 1.0
    tried: list[Sized] = []
    for _ in range(TRIES):
        build = law.build(size)
        found = look(build)
        if not np.isfinite(found.z):
            size *= 0.4
            continue
        tried.append(Sized(size, found, build))
        if band[0] <= found.z <= band[1]:
            break
        if len(tried) > 1 and abs(np.log(size / tried[-2].size)) > 1e-3:
            grown = np.log(max(found.z, 1e-9) / max(tried[-2].visibility.z, 1e-9))
            power = float(np.clip(grown / np.log(size / tried[-2].size), 0.4, 3.0))
        ahead = float(np.clip(size * (wanted / max(found.z, 1e-6)) ** (1.0 / power), law.least, law.most))
        if abs(ahead / size - 1.0) < 0.01:
            break
        size = ahead
    if not tried:
        raise FloatingPointError(f"{law.name} flew apart at every size")
    return min(tried, key=lambda one: abs(np.log(max(one.visibility.z, 1e-9) / wanted)))
