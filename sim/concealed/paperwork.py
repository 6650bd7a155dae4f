"""A concealed case as a campaign on disk that carries no trace of what it conceals.

One schema, fields and file names alike in every case, run ids without meaning, samples as stored (not compressed)
float64 behind the devices' converters, the same time stamp on every file.
"""

from __future__ import annotations

import io
import os
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jointscope.atomic import new_directory
from jointscope.models.parameters import Rig
from jointscope.recordings.campaign import Campaign, Channel, Location, Nameplate, Run, Stream, Topology
from jointscope.recordings.campaign import Motion as MotionOf
from jointscope.recordings.toml_text import campaign_text
from jointscope.sim.concealed.rehearsal import Plan, Take

Real = NDArray[np.float64]
MOMENT: Final = 1_000_000_000  # s since 1970, the time stamp of every file
_ZIP_MOMENT: Final = (1980, 1, 1, 0, 0, 0)


def nameplate(
    rig: Rig, topology: Topology, motion: MotionOf, rough: np.random.Generator, spread: float
) -> Nameplate:
    """What the lab knows: exact where the format says exact, off by ``spread`` (log) where it says rough."""
    joint = rig.joint

    def off(value: float, share: float) -> float:
        return float(f"{value * np.exp(share * spread * rough.standard_normal()):.4g}")

    if motion == "translational":
        return Nameplate(
            topology=topology,
            motion=motion,
            plane="horizontal",
            load_damping=off(joint.load_damping, 2.0),
            stiffness_reference=off(joint.stiffness, 1.0),
            inertia_reference=off(joint.load_inertia, 0.7),
            damping_reference=off(joint.damping, 2.5),
        )
    return Nameplate(
        topology=topology, motion=motion, plane="vertical" if rig.gravity else "horizontal",
        reduction_ratio=joint.reduction_ratio, motor_inertia=joint.motor_inertia,
        reducer_inertia=joint.reducer_inertia, motor_damping=off(joint.motor_damping, 2.0),
        load_damping=off(joint.load_damping, 2.0), arm_mass=rig.arm_mass, arm_com_radius=rig.arm_com_radius,
        efficiency=joint.efficiency, stiffness_reference=off(joint.stiffness, 1.0),
        inertia_reference=off(joint.load_inertia, 0.7), damping_reference=off(joint.damping, 2.5),
    )  # fmt: skip


def campaign(
    rig: Rig, plan: Plan, records: Sequence[Mapping[str, Real]], plate: Nameplate, ids: np.random.Generator
) -> Campaign:
    """The case as a campaign, runs in the order of the session."""
    names = ids.permutation(900)[: len(plan.takes)] + 100
    runs = tuple(
        _run(rig, plan, take, record, f"r{name}", slides=plate.motion == "translational")
        for take, record, name in zip(plan.takes, records, names, strict=True)
    )
    return Campaign(path=Path(), rig=plate, runs=runs, title="bench recordings")


def _run(rig: Rig, plan: Plan, take: Take, record: Mapping[str, Real], name: str, *, slides: bool) -> Run:
    devices = plan.devices
    place: Location = "load" if slides else "arm"
    daq: list[Channel] = []
    if "force" in record:
        daq.append(
            Channel(
                column="force",
                quantity="force",
                unit="N",
                location=place,
                role="input",
                radius=None if slides else rig.hammer_radius,
                samples=record["force"],
            )
        )
    daq.append(
        Channel(
            column="acceleration",
            quantity="acceleration" if slides else "linear-acceleration",
            unit="m/s^2",
            location=place,
            role="output",
            radius=None if slides else rig.accelerometer_radius,
            coupling="ac" if devices.low_cutoff else "dc",
            low_cutoff=devices.low_cutoff or None,
            full_scale=devices.full_scale,
            samples=record["acceleration"],
        )
    )
    if "arm" in record:
        daq.append(
            Channel(
                column="position" if slides else "arm_angle",
                quantity="position" if slides else "angle",
                unit="m" if slides else "rad",
                location=place,
                role="output",
                samples=record["arm"],
            )
        )
    log: list[Channel] = []
    if "torque" in record:
        log.append(
            Channel(
                column="torque",
                quantity="torque",
                unit="N m",
                location="motor",
                role="input",
                samples=record["torque"],
            )
        )
    if "command" in record:
        log.append(
            Channel(
                column="speed_command",
                quantity="speed-command",
                unit="rad/s",
                location="motor",
                role="input",
                samples=record["command"],
            )
        )
    if "motor" in record:
        log.append(
            Channel(
                column="motor_angle",
                quantity="angle",
                unit="rad",
                location="motor",
                role="output",
                samples=record["motor"],
            )
        )
    streams = [
        Stream(
            file=f"{name}-{device}.npz",
            sampling_rate=rate,
            length=channels[0].samples.size,  # type: ignore[union-attr]
            channels=tuple(channels),
        )
        for device, rate, channels in (("a", devices.daq_rate, daq), ("b", devices.log_rate, log))
        if channels
    ]
    return Run(id=name, experiment=take.kind, streams=tuple(streams), brake=take.braked, arm_angle=take.angle)


def write_case(case: Campaign, directory: Path) -> None:
    """Write ``case`` into a new ``directory``, every file stamped alike."""
    names = {(run.id, i): stream.file for run in case.runs for i, stream in enumerate(run.streams)}
    with new_directory(directory) as folder:
        for run in case.runs:
            for stream in run.streams:
                columns = {c.column: np.asarray(c.samples, dtype=np.float64) for c in stream.channels}
                (folder / stream.file).write_bytes(npz_bytes(columns))
        (folder / "campaign.toml").write_text(campaign_text(case, names), encoding="utf-8")
        for file in folder.iterdir():
            os.utime(file, (MOMENT, MOMENT))
    os.utime(directory, (MOMENT, MOMENT))


def npz_bytes(columns: Mapping[str, Real]) -> bytes:
    """An npz archive that depends on nothing but names and samples: stored, with a fixed time stamp."""
    archive = io.BytesIO()
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_STORED) as file:
        for name, values in columns.items():
            array = io.BytesIO()
            np.lib.format.write_array(array, values, allow_pickle=False)
            info = zipfile.ZipInfo(f"{name}.npy", date_time=_ZIP_MOMENT)
            file.writestr(info, array.getvalue())
    return archive.getvalue()
