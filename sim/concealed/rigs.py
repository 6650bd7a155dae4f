"""Rigs, plans and noise of the cases: what a laboratory may have, drawn apart for development, calibration and test."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from jointscope.models.parameters import Joint, Rig
from jointscope.sim.concealed.law import Draw, Kind, Setting
from jointscope.sim.concealed.measurement import Devices, Noise
from jointscope.sim.concealed.rehearsal import DriveGains, Plan, Take, act

ExperimentSet = Literal["H", "S", "M", "HS", "HSM"]
SETS: dict[str, tuple[Kind, ...]] = {
    "H": ("hammer",), "S": ("torque-sweep",), "M": ("speed-motion",), "HS": ("hammer", "torque-sweep"),
    "HSM": ("hammer", "torque-sweep", "speed-motion"),
}  # fmt: skip
COUNTS: dict[Kind, int] = {"hammer": 16, "torque-sweep": 4, "speed-motion": 4}


@dataclass(frozen=True)
class Ranges:
    """Ranges of the nuisances that differ between the draws: (low, high) each."""

    stiffness: tuple[float, float]  # N m/rad
    frequency: tuple[float, float]  # Hz, joint with the motor held
    damping_ratio: tuple[float, float]
    inertia_ratio: tuple[float, float]  # reflected motor inertia over the arm's
    windup: tuple[float, float]  # rad, largest
    noise: tuple[float, float]  # white noise over the median peak, as a power of ten
    hit_gain: tuple[float, float]
    daq_rates: tuple[float, ...]
    log_rates: tuple[float, ...]


RANGES: dict[Draw, Ranges] = {
    "development": Ranges(
        (4e4, 4e5), (22.0, 50.0), (0.015, 0.05), (1.5, 5.0), (4e-4, 1.4e-3), (-2.7, -1.8), (0.005, 0.02),
        (1024.0, 2048.0), (500.0, 1000.0),
    ),
    "calibration": Ranges(
        (3e4, 5e5), (20.0, 52.0), (0.012, 0.06), (1.2, 5.0), (3e-4, 1.6e-3), (-2.8, -1.7), (0.005, 0.03),
        (1024.0, 1280.0, 2048.0), (500.0, 1000.0),
    ),
    "test": Ranges(
        (2.5e4, 6e5), (18.0, 55.0), (0.012, 0.06), (1.0, 6.0), (3e-4, 1.8e-3), (-2.9, -1.7), (0.005, 0.03),
        (1000.0, 1024.0, 1280.0, 2048.0), (500.0, 800.0, 1000.0),
    ),
}  # fmt: skip


def _log(rng: np.random.Generator, limits: tuple[float, float]) -> float:
    return float(np.exp(rng.uniform(np.log(limits[0]), np.log(limits[1]))))


def draw_rig(rng: np.random.Generator, draw: Draw, *, vertical: bool) -> Rig:
    """A rig of the paper's kind, some smaller, some larger; every number rounded as a nameplate would show it."""
    ranges = RANGES[draw]
    K = _log(rng, ranges.stiffness)
    w = 2.0 * np.pi * rng.uniform(*ranges.frequency)
    J_L = K / w**2
    J_M = J_L * rng.uniform(*ranges.inertia_ratio)
    n = round(float(rng.uniform(60.0, 180.0)), 1)
    part = rng.uniform(0.35, 0.6)
    b_l = 0.01 * 2.0 * float(np.sqrt(K * J_L)) * float(rng.uniform(0.1, 0.6))
    radius = round(float(0.42 * (J_L / 3.0) ** 0.2 * rng.uniform(0.8, 1.25)), 3)
    joint = Joint(
        stiffness=K, damping=2.0 * _log(rng, ranges.damping_ratio) * float(np.sqrt(K * J_L)), load_inertia=J_L,
        motor_inertia=_rounded(part * J_M / n**2), reducer_inertia=_rounded((1.0 - part) * J_M / n**2),
        reduction_ratio=n, motor_damping=b_l * float(rng.uniform(0.5, 2.0)), load_damping=b_l,
        efficiency=round(float(rng.uniform(0.6, 0.95)), 2),
    )  # fmt: skip
    mass = round(float(rng.uniform(0.6, 0.78) * J_L / radius**2), 3)
    reach = radius * float(rng.uniform(1.5, 2.0))
    return Rig(
        joint=joint, arm_mass=mass, arm_com_radius=radius, hammer_radius=round(reach * rng.uniform(0.7, 1.0), 3),
        accelerometer_radius=round(reach, 3), gravity=9.80665 if vertical else 0.0,
    )  # fmt: skip


def draw_carriage(rng: np.random.Generator, draw: Draw) -> Rig:
    """A mass on a spring that slides: a rig of unit radius in small motion, inertia as mass, torque as force."""
    ranges = RANGES[draw]
    m = _log(rng, (2.0, 60.0))
    K = m * float(2.0 * np.pi * rng.uniform(*ranges.frequency)) ** 2
    c = 2.0 * float(np.sqrt(K * m))
    joint = Joint(
        stiffness=K, damping=_log(rng, ranges.damping_ratio) * c, load_inertia=m, motor_inertia=_rounded(m / 100.0**2),
        reducer_inertia=_rounded(m / 100.0**2), reduction_ratio=100.0, motor_damping=0.002 * c, load_damping=0.002 * c,
    )  # fmt: skip
    return Rig(
        joint=joint, arm_mass=round(0.6 * m, 3), arm_com_radius=1.0, hammer_radius=1.0, accelerometer_radius=1.0,
        gravity=0.0,
    )  # fmt: skip


def _rounded(value: float) -> float:
    return float(f"{value:.4g}")


def draw_plan(rng: np.random.Generator, draw: Draw, rig: Rig, kinds: tuple[Kind, ...]) -> Plan:
    """Runs, devices and drive; numbers of runs depend on the experiment set alone."""
    ranges = RANGES[draw]
    joint = rig.joint
    w = np.sqrt(joint.stiffness / joint.load_inertia)
    windup = _log(rng, ranges.windup)
    pulse = float(rng.uniform(0.004, 0.008))
    peak = windup * joint.load_inertia * w / (rig.hammer_radius * pulse * 2.0 / np.pi)
    posture = float(rng.choice([0.0, 0.0, -np.pi / 3.0, np.pi / 6.0])) if rig.gravity else 0.0
    amplitude = joint.stiffness * windup * rng.uniform(0.12, 0.4) / (joint.efficiency * joint.reduction_ratio)
    hits, swings, moves = (float(rng.uniform(1.6, 2.2)), 3.0, 4.8)
    levels = np.geomspace(1.0 / rng.uniform(4.0, 9.0), 1.0, COUNTS["hammer"])
    sweep_from = float(rng.choice([-np.pi / 3.0, -np.pi / 4.0, 0.0])) if rig.gravity else 0.0
    travel = float(rng.uniform(1.2, 2.1))
    softer = float(rng.uniform(0.3, 0.6))
    exponent = float(rng.uniform(1.0, 1.6))
    takes: list[Take] = []
    for kind in kinds:
        for i in range(COUNTS[kind]):
            if kind == "hammer":
                takes.append(Take(
                    kind=kind, angle=posture, duration=hits, begin=0.0, exponent=exponent,
                    force=float(peak * levels[i] * np.exp(rng.normal(0.0, 0.08))),
                    pulse=float(pulse * np.exp(rng.normal(0.0, 0.03))), at=float(rng.uniform(0.03, 0.08)),
                ))  # fmt: skip
            elif kind == "torque-sweep":
                takes.append(Take(
                    kind=kind, angle=sweep_from, duration=swings, begin=0.0,
                    amplitude=amplitude * (1.0, softer)[i % 2], band=(4.0, 80.0), logarithmic=i >= 2,
                ))  # fmt: skip
            else:
                takes.append(Take(
                    kind=kind, angle=0.0, duration=moves, begin=0.0, travel=travel * (1.0, softer)[i % 2],
                    share=0.06 if i < 2 else 0.15,
                ))  # fmt: skip
    order = rng.permutation(len(takes))
    takes = [replace(takes[k], begin=30.0 * i) for i, k in enumerate(order)]
    encoders = int(rng.integers(0, 3))
    coupling = float(rng.choice([0.0, 0.3, 0.5]))
    devices = Devices(
        daq_rate=float(rng.choice(ranges.daq_rates)), log_rate=float(rng.choice(ranges.log_rates)),
        low_cutoff=coupling, full_scale=1.0, motor_counts=float(2 ** rng.integers(13, 18)),
        arm_counts=float(2 ** rng.integers(17, 21)), motor_encoder=encoders >= 1, arm_encoder=encoders == 2,
    )  # fmt: skip
    gains = DriveGains(
        hold=float(rng.uniform(0.4, 0.9)), bandwidth=float(rng.uniform(0.1, 0.22) * w / (2.0 * np.pi)),
        integral=float(rng.uniform(0.1, 0.3)), cycle=float(rng.choice([4e-4, 1e-3])),
        resolution=2.0 * np.pi / (devices.motor_counts * joint.reduction_ratio),
    )  # fmt: skip
    return Plan(takes=tuple(takes), devices=devices, gains=gains)


def settle_scales(rig: Rig, plan: Plan, kinds: tuple[Kind, ...]) -> Plan:
    """The plan with its scales, from a pilot of every kind of run without any effect."""
    provisional = Setting(
        rig=rig, kinds=frozenset(kinds), devices="torque-sweep" in kinds or "speed-motion" in kinds, force=1.0,
        torque=1.0, drive_torque=0.0, acceleration=1.0, speed=1.0, travel=0.0, angle=plan.takes[0].angle,
        daq_rate=plan.devices.daq_rate, log_rate=plan.devices.log_rate, runs=len(plan.takes),
    )  # fmt: skip
    plan = replace(plan, setting=provisional)
    torque, acceleration, speed, travel, drive_torque = [], [], [0.0], [0.0], [0.0]
    for kind in kinds:
        indices = [i for i, take in enumerate(plan.takes) if take.kind == kind]
        index = max(indices, key=lambda i: plan.takes[i].force + plan.takes[i].amplitude + plan.takes[i].travel)
        moved, _ = act(rig, plan, index, ())
        torque.append(float(np.max(np.abs(moved.windup - moved.windup[0]))) * rig.joint.stiffness)
        radial, tangential = moved.accelerometer[:, 0], moved.accelerometer[:, 1]
        acceleration.append(float(np.max(np.abs(tangential - tangential[0]))) + 1e-9 * float(radial[0]))
        speed.append(float(np.max(np.abs(np.gradient(moved.arm, moved.timestep)))))
        travel.append(float(np.max(np.abs(moved.arm - moved.arm[0]))))
        ratio = rig.joint.efficiency * rig.joint.reduction_ratio
        drive_torque.append(float(np.max(np.abs(moved.torque - moved.torque[0]))) * ratio)
    hit_angles = [take.angle for take in plan.takes if take.kind == kinds[0]]
    setting = replace(
        provisional, force=max(take.force for take in plan.takes), torque=float(np.median(torque)),
        drive_torque=max(drive_torque), acceleration=float(np.median(acceleration)), speed=max(speed),
        travel=max(travel), angle=hit_angles[0],
    )  # fmt: skip
    scale = 2.5 * max(acceleration) + 2.0 * rig.gravity + 2.0
    full_scale = next(
        full for full in (20.0, 50.0, 100.0, 200.0, 500.0, 1000.0, 5000.0) if full > min(scale, 4999.0)
    )
    return replace(plan, setting=setting, devices=replace(plan.devices, full_scale=full_scale))


def draw_noise(rng: np.random.Generator, draw: Draw, plan: Plan, *, hard: bool) -> Noise:
    """Noise of every channel; ``hard`` cases have more colour, more level dependence, more scatter, more outliers."""
    ranges = RANGES[draw]
    setting = plan.setting
    assert setting is not None
    ratio = setting.rig.joint.efficiency * setting.rig.joint.reduction_ratio
    worse = 1.0 if hard else 0.0
    return Noise(
        acceleration=float(setting.acceleration * 10.0 ** rng.uniform(*ranges.noise)),
        colour=float(rng.uniform(0.0, 0.8) + worse * rng.uniform(0.3, 1.2)),
        pole=float(rng.uniform(0.8, 0.99)),
        level=float(rng.uniform(0.0, 0.003) + worse * rng.uniform(0.001, 0.004)),
        force=float(max(setting.force, 1.0) * 10.0 ** rng.uniform(-3.0, -2.3)),
        torque=float(max(setting.drive_torque, 1e-3) / ratio * 10.0 ** rng.uniform(-2.7, -1.9)),
        arm=float(10.0 ** rng.uniform(-5.8, -4.8)),
        outliers=float(rng.choice([0.0, 0.05, 0.2]) + worse * rng.uniform(0.0, 0.4)),
        hit_gain=float(rng.uniform(*ranges.hit_gain) + worse * 0.01),
        hit_timing=float(rng.uniform(5e-6, 4e-5)),
    )  # fmt: skip


def scatter_hits(rng: np.random.Generator, plan: Plan, noise: Noise) -> Plan:
    """The plan with every hit's own gain and timing error."""
    takes = tuple(
        replace(take, gain=float(rng.normal(0.0, noise.hit_gain)), late=float(rng.normal(0.0, noise.hit_timing)))
        if take.kind == "hammer" else take
        for take in plan.takes
    )  # fmt: skip
    return replace(plan, takes=takes)
