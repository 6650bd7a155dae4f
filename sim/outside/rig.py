"""Which joints there are: rotating ones of three sizes, the paper's, and sliding masses with a spring or without."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from jointscope.sim.outside.physics import STANDARD_GRAVITY, Physics

Slide = Literal["spring", "rigid"]
Size = Literal["small", "middle", "large"]
Span = tuple[float, float]

# J_L [kg m^2] and sqrt(K/J_L)/(2 pi) [Hz]
SIZES: Final[dict[Size, tuple[Span, Span]]] = {
    "small": ((0.4, 2.0), (14.0, 60.0)),
    "middle": ((2.0, 15.0), (10.0, 55.0)),
    "large": ((15.0, 110.0), (8.0, 30.0)),
}
EFFICIENCIES: Final = (1.0, 0.9, 0.85, 0.8, 0.7)
RIGID_FREQUENCY: Final = 12.0  # Hz; sets time scales where there is no spring


@dataclass(frozen=True, kw_only=True)
class Rig:
    """A joint with its arm; of a sliding rig read m for rad, N for N m and kg for kg m^2.

    Attributes:
        rated_torque: Largest torque beside the holding torque [N m].
        centre: Centre of mass from the axis [m].
        slide: How it slides; ``None``: it turns.
        textbook: The paper's own rig.
    """

    load_inertia: float
    stiffness: float
    damping: float
    ratio: float
    rotor_inertia: float
    reducer_inertia: float
    motor_damping: float
    load_damping: float
    efficiency: float
    arm_mass: float
    centre: float
    length: float
    vertical: bool
    rated_torque: float
    torque_constant: float
    pole_pairs: int
    hammer_radius: float
    sensor_radius: float
    slide: Slide | None = None
    textbook: bool = False

    @property
    def motor_inertia(self) -> float:
        """J_M = (J_rotor + J_reducer) n^2 [kg m^2]."""
        return (self.rotor_inertia + self.reducer_inertia) * self.ratio**2

    @property
    def gravity(self) -> float:
        """m g r [N m]; 0 on a horizontal rig."""
        return self.arm_mass * STANDARD_GRAVITY * self.centre if self.vertical else 0.0

    @property
    def own_rate(self) -> float:
        """sqrt(K/J_L) [rad/s]."""
        return float(np.sqrt(self.stiffness / self.load_inertia)) if self.stiffness > 0.0 else self._rigid_rate()

    def _rigid_rate(self) -> float:
        return 2.0 * np.pi * RIGID_FREQUENCY

    @property
    def own_frequency(self) -> float:
        """sqrt(K/J_L)/(2 pi) [Hz]."""
        return self.own_rate / (2.0 * np.pi)

    @property
    def physics(self) -> Physics:
        """The joint without any effect."""
        return Physics(
            motor_inertia=self.motor_inertia, load_inertia=self.load_inertia, stiffness=self.stiffness,
            damping=self.damping, motor_damping=self.motor_damping, load_damping=self.load_damping,
            gravity=self.gravity, ratio=self.ratio,
        )  # fmt: skip


def log_uniform(rng: np.random.Generator, low: float, high: float) -> float:
    """A number whose logarithm is uniform between those of ``low`` and ``high``."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def rounded(value: float, digits: int = 4) -> float:
    """``value`` to so many significant digits, as a nameplate has it."""
    return float(f"{value:.{digits}g}")


def draw_rig(rng: np.random.Generator, *, vertical: bool, textbook: bool, slide: Slide | None) -> Rig:
    """A rig of one of the sizes, the paper's, or a sliding one."""
    size: Size = ("small", "middle", "large")[int(rng.integers(3))]
    load_range, frequency_range = SIZES[size]
    if slide is not None:
        load_range, frequency_range = (5.0, 150.0), (8.0, 50.0)
    load = log_uniform(rng, *load_range)
    stiffness = load * (2.0 * np.pi * log_uniform(rng, *frequency_range)) ** 2
    share = log_uniform(rng, 0.006, 0.04 if slide else 0.05)
    ratio = rounded(rng.uniform(30.0, 200.0), 3) if rng.random() < 0.5 else float(rng.integers(30, 200))
    motor = load * log_uniform(rng, 0.4, 3.0)
    rotor = float(rng.uniform(0.4, 0.8))
    motor_damping = motor * log_uniform(rng, 0.05, 0.4)
    load_damping = load * log_uniform(rng, 0.05, 0.4)
    efficiency = float(rng.choice(EFFICIENCIES))
    length = float(np.clip(0.75 * load**0.25, 0.35, 2.5))
    mass = rounded(load / (rng.uniform(0.38, 0.5) * length**2), 3)
    centre = rounded(length * rng.uniform(0.4, 0.52), 3)
    rotor_inertia, reducer_inertia = rounded(motor / ratio**2 * rotor), rounded(motor / ratio**2 * (1.0 - rotor))
    damping = 2.0 * share * np.sqrt(stiffness * load)
    if textbook and slide is None:  # the joint of the paper's sections 2-3
        load, stiffness, damping, ratio, efficiency = 3.02, 193_665.0, 57.7, 141.0, 0.7
        rotor_inertia, reducer_inertia, motor_damping, load_damping = 2.1e-4, 2.48e-4, 2.0, 2.0
        mass, centre, length = 7.2, 0.5, 1.0
    if slide is not None:
        ratio, efficiency, length, rotor_inertia, reducer_inertia = 1.0, 1.0, 1.0, 0.6, 0.4
        load_damping = load * log_uniform(rng, 0.3, 2.0)
    if slide == "rigid":
        stiffness = damping = 0.0
    hammer, sensor = rounded(length * rng.uniform(0.55, 0.95), 3), rounded(length * rng.uniform(0.6, 1.0), 3)
    return Rig(
        load_inertia=load, stiffness=stiffness, damping=float(damping), ratio=ratio, rotor_inertia=rotor_inertia,
        reducer_inertia=reducer_inertia, motor_damping=motor_damping, load_damping=load_damping,
        efficiency=efficiency, arm_mass=mass, centre=centre, length=length, vertical=vertical and slide is None,
        rated_torque=stiffness * float(rng.uniform(0.7, 2.2)) * 1e-3 if stiffness > 0.0 else 2.0 * load,
        torque_constant=rounded(rng.uniform(0.1, 1.2), 3), pole_pairs=int(rng.integers(3, 6)),
        hammer_radius=1.0 if slide else hammer, sensor_radius=1.0 if slide else sensor, slide=slide,
        textbook=textbook and slide is None,
    )  # fmt: skip
