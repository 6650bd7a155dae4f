"""A case as a campaign: nameplate, runs, channels in various units, files of one format."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final, Literal

import numpy as np

from jointscope.recordings.campaign import Campaign, Channel, Experiment, Nameplate, Run, Stream
from jointscope.recordings.writer import FileFormat, write_campaign
from jointscope.sim.outside.case import Case
from jointscope.sim.outside.rig import rounded
from jointscope.sim.outside.run_channels import Wiring, streams_of
from jointscope.sim.outside.takes import Take

MOMENT: Final = 1_000_000_000  # s since 1970, the time stamp of every file
TITLES: Final = (
    "Bench series", "Joint test", "Axis check", "Arm rig", "Lab recording", "Test stand B", "Cell 4", "Acceptance run",
)  # fmt: skip
NOTES: Final = ("", "recorded after warm-up", "cold rig, morning", "as found", "second series")
PREFIXES: Final = ("r", "take", "m", "rec", "x")
FORMATS: Final[tuple[FileFormat, ...]] = ("csv", "csv", "npz", "npz", "npz", "h5")
PHASE_RATE: Final = 2000.0  # Hz, at least, of a log of phase currents


def paper_of(case: Case, rng: np.random.Generator) -> tuple[Campaign, FileFormat]:
    """The campaign of ``case``, and the format of its files."""
    single = case.setup.rig.slide is not None or (case.setup.experiments == "H" and bool(rng.random() < 0.4))
    wiring = _wiring(case, single, rng)
    plate = _nameplate(case, single, wiring, rng)
    prefix = str(rng.choice(PREFIXES))
    repeats, roles = bool(rng.random() < 0.5), bool(rng.random() < 0.15)
    takes = case.session.takes
    held_out = {int(i) for i in rng.permutation(len(takes))[: max(2, len(takes) // 4)]}
    runs = []
    for place, take in enumerate(takes):
        name = f"{prefix}{place + 1:02d}"
        role: Literal["estimate", "validate"] | None = None
        if roles:
            role = "validate" if place in held_out else "estimate"
        runs.append(
            Run(
                id=name, experiment=_experiment(take), streams=_streams(case, place, name, wiring), brake=take.hit,
                arm_angle=take.angle, repeat_of=take.level if repeats and take.hit else None, role=role,
            )
        )  # fmt: skip
    title = f"{rng.choice(TITLES)} {int(rng.integers(1, 99))}"
    campaign = Campaign(path=Path(), rig=plate, runs=tuple(runs), title=title, notes=str(rng.choice(NOTES)))
    return campaign, FORMATS[int(rng.integers(len(FORMATS)))]


def write_case(campaign: Campaign, directory: Path, file_format: FileFormat) -> None:
    """Write ``campaign`` into a new ``directory``, every file stamped alike."""
    write_campaign(campaign, directory, file_format=file_format)
    for path in (*directory.rglob("*"), directory):
        os.utime(path, (MOMENT, MOMENT))


def _experiment(take: Take) -> Experiment:
    if take.hit:
        return "hammer"
    return "torque-sweep" if take.swept else "speed-motion"


def _wiring(case: Case, single: bool, rng: np.random.Generator) -> Wiring:
    devices = case.devices
    torque: Literal["torque", "current", "phase-current"] = "torque"
    if not single and devices.torque:
        torque = ("torque", "current", "phase-current")[int(rng.choice(3, p=(0.6, 0.3, 0.1)))]
    if torque == "phase-current":
        if not devices.motor or devices.log_rate < PHASE_RATE or case.setup.experiments == "H":
            torque = "current"
        elif case.chain.log_rate:
            torque = "torque"
    speed = devices.motor and bool(rng.random() < 0.15) and not case.chain.eccentricity
    return Wiring(
        torque=torque, motor_speed=speed and torque != "phase-current",
        motor_unit=("rad", "deg", "counts")[int(rng.choice(3, p=(0.7, 0.15, 0.15)))],
        gravities=bool(rng.random() < 0.15), command=bool(rng.random() < 0.65),
    )  # fmt: skip


def _nameplate(case: Case, single: bool, wiring: Wiring, rng: np.random.Generator) -> Nameplate:
    """Exact where the format wants it exact; else rough, and silent at random."""
    rig = case.setup.rig

    def rough(value: float, spread: float, share: float) -> float | None:
        found = rounded(value * (1.0 + rng.uniform(-spread, spread)))
        return found if rng.random() < share and value > 0.0 else None

    load_damping, motor_damping = rough(rig.load_damping, 0.5, 0.7), rough(rig.motor_damping, 0.5, 0.7)
    stiffness, inertia = rough(rig.stiffness, 0.3, 0.8), rough(rig.load_inertia, 0.25, 0.8)
    damping = rough(rig.damping, 0.5, 0.5)
    weighed = rig.slide is None and (rig.vertical or bool(rng.random() < 0.3))
    constant = wiring.torque != "torque" or (not single and bool(rng.random() < 0.2))
    return Nameplate(
        topology="single-dof" if single else "two-inertia",
        motion="translational" if rig.slide else "rotational", plane="vertical" if rig.vertical else "horizontal",
        reduction_ratio=None if single else rig.ratio, motor_inertia=None if single else rig.rotor_inertia,
        reducer_inertia=None if single else rig.reducer_inertia, efficiency=None if single else rig.efficiency,
        motor_damping=None if single else motor_damping, load_damping=load_damping,
        arm_mass=rig.arm_mass if weighed else None, arm_com_radius=rig.centre if weighed else None,
        torque_constant=rig.torque_constant if constant else None,
        pole_pairs=rig.pole_pairs if wiring.torque == "phase-current" else None,
        ground_spring=None if rig.slide is None else rig.slide == "spring",
        stiffness_reference=stiffness, inertia_reference=inertia, damping_reference=damping,
    )  # fmt: skip


def _streams(case: Case, place: int, name: str, wiring: Wiring) -> tuple[Stream, ...]:
    """One stream per device that recorded anything, each cut to its shortest channel."""
    devices = case.devices
    daq, log = streams_of(case, place, wiring)
    if not devices.two:
        daq, log = [*daq, *log], []
    found = []
    for mark, channels, rate in (("a", daq, devices.daq_rate), ("b", log, devices.log_rate)):
        if channels:
            found.append(
                Stream(
                    file=f"{name}-{mark}" if devices.two else name, sampling_rate=rate,
                    length=_length(channels[0]), channels=tuple(channels),
                    start_uncertainty=1e-3 if mark == "b" and devices.uncertain else 0.0,
                )
            )  # fmt: skip
    return tuple(found)


def _length(channel: Channel) -> int:
    return 0 if channel.samples is None else channel.samples.size
