"""The channels of one run, by device: what they measure, in which unit they are written."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from jointscope.recordings.campaign import Channel
from jointscope.sim.outside.case import Case
from jointscope.sim.outside.sensing import Record

Channels = list[Channel]


@dataclass(frozen=True, kw_only=True)
class Wiring:
    """How the signals of a case are written.

    Attributes:
        torque: As what the drive's torque is logged.
        motor_speed: Whether the motor's speed is logged in place of its angle.
        motor_unit: Of the motor's angle: rad, deg or counts.
        gravities: Whether the accelerometer is in g_n.
        command: Whether the speed command is logged where other channels would do.
    """

    torque: Literal["torque", "current", "phase-current"]
    motor_speed: bool
    motor_unit: str
    gravities: bool
    command: bool


def streams_of(case: Case, place: int, wiring: Wiring) -> tuple[Channels, Channels]:
    """Channels of the DAQ and of the log, in SI."""
    take, record, devices = case.session.takes[place], case.records[place], case.devices
    sliding = case.setup.rig.slide is not None
    daq: Channels = [_accelerometer(case, record, wiring)] if devices.accelerometer or take.hit else []
    log: Channels = []
    if take.hit:
        daq.append(_force(case, record))
    elif sliding:
        daq += [
            Channel(column="F", quantity="force", unit="N", location="load", role="input", samples=record["torque"]),
            Channel(column="x", quantity="position", unit="m", location="load", role="output", samples=record["position"]),
        ]  # fmt: skip
    if "arm" in record:
        arm = Channel(
            column="q_arm", quantity="angle", unit="rad", location="arm", role="output", samples=record["arm"]
        )
        (log if devices.arm_on_log and devices.two else daq).append(arm)
    if not take.hit and not sliding:
        log = [*_torque(case, place, wiring), *_motor(case, record, wiring), *log]
        if "command" in record and (wiring.command or not devices.torque):
            log.append(
                Channel(column="w_cmd", quantity="speed-command", unit="rad/s", location="motor", role="input",
                        samples=record["command"])
            )  # fmt: skip
    return daq, log


def _accelerometer(case: Case, record: Record, wiring: Wiring) -> Channel:
    rig, devices, samples = case.setup.rig, case.devices, record["acceleration"]
    cutoff = devices.low_cutoff or None
    if rig.slide is not None:
        return Channel(
            column="a", quantity="acceleration", unit="m/s^2", location="load", role="output", samples=samples,
            coupling="ac" if cutoff else "dc", low_cutoff=cutoff,
        )  # fmt: skip
    if devices.angular:
        return Channel(
            column="acc", quantity="angular-acceleration", unit="rad/s^2", location="arm", role="output", samples=samples
        )  # fmt: skip
    return Channel(
        column="acc", quantity="linear-acceleration", unit="g_n" if wiring.gravities else "m/s^2", location="arm",
        role="output", samples=samples, radius=rig.sensor_radius, coupling="ac" if cutoff else "dc", low_cutoff=cutoff,
    )  # fmt: skip


def _force(case: Case, record: Record) -> Channel:
    rig = case.setup.rig
    sliding = rig.slide is not None
    return Channel(
        column="F", quantity="force", unit="N", location="load" if sliding else "arm", role="input",
        radius=None if sliding else rig.hammer_radius, samples=record["force"],
    )  # fmt: skip


def _torque(case: Case, place: int, wiring: Wiring) -> Channels:
    rig, samples = case.setup.rig, case.records[place]["torque"]
    if not case.devices.torque:
        return []
    if wiring.torque == "torque":
        return [
            Channel(column="T_m", quantity="torque", unit="N m", location="motor", role="input", samples=samples)
        ]
    current = samples / rig.torque_constant
    if wiring.torque == "current":
        return [
            Channel(column="i_q", quantity="current", unit="A", location="motor", role="input", samples=current)
        ]
    turned = rig.pole_pairs * case.clean[place]["motor"]
    return [
        Channel(
            column=f"i_{name}", quantity="phase-current", unit="A", location="motor", role="input",
            samples=-current * np.sin(turned - 2.0 * np.pi * k / 3.0),
        )
        for k, name in enumerate("uvw")
    ]  # fmt: skip


def _motor(case: Case, record: Record, wiring: Wiring) -> Channels:
    if not case.devices.motor:
        return []
    if wiring.motor_speed:
        return [
            Channel(column="w_m", quantity="angular-velocity", unit="rad/s", location="motor", role="output",
                    samples=record["speed"])
        ]  # fmt: skip
    counts = 2.0 * np.pi / case.noise.motor_step if wiring.motor_unit == "counts" else None
    return [
        Channel(
            column="q_m", quantity="angle", unit=wiring.motor_unit, location="motor", role="output",
            samples=record["motor"], counts_per_turn=counts,
        )
    ]  # fmt: skip
