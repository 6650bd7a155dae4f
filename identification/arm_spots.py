"""Hits on an arm with several joints, gathered by point and posture, with what the arm's model says of each."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import RefusedError
from jointscope.identification.conditioning import Excitation, Response
from jointscope.identification.errors_in_variables import HitSpectrum
from jointscope.identification.hit_spectra import Rejected, hit_spectrum
from jointscope.identification.hits import find_contact, is_clipped, is_double_hit
from jointscope.models.arm.holding import Probe
from jointscope.models.arm.reference import Reference
from jointscope.recordings.campaign import Campaign, Run, Signal

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Spot:
    """Hits at one point in one posture, every rotor braked.

    Attributes:
        name: What the hits share.
        posture: Link angles [rad].
        mass: M(q) of the links [kg m^2], shape (n, n).
        gravity_stiffness: K_g(q) [N m/rad], shape (n, n).
        force: Generalised force per newton of the hammer [m], shape (n,).
        motion: Acceleration along each sensor per link acceleration [m], shape (n_outputs, n).
        tilt: What each sensor reads of gravity per link angle [m/s^2], shape (n_outputs, n).
        outputs: Columns.
        hits: Spectra, force in N, outputs in m/s^2.
    """

    name: str
    posture: Mapping[str, float]
    mass: Real
    gravity_stiffness: Real
    force: Real
    motion: Real
    tilt: Real
    outputs: tuple[str, ...]
    hits: tuple[HitSpectrum, ...] = field(repr=False)


def read_spots(campaign: Campaign, reference: Reference) -> tuple[tuple[Spot, ...], tuple[Rejected, ...]]:
    """Every usable hit of ``campaign``, by point and posture; and those that are left out, with the reason.

    Accelerometers on the base are left out: they show the floor.

    Raises:
        RefusedError: A channel doesn't say where on the arm it sits.
    """
    groups: dict[tuple[object, ...], list[Run]] = {}
    for run in campaign.runs:
        if run.experiment == "hammer" and run.select("force", role="input"):
            groups.setdefault(_place(run), []).append(run)
    spots, rejected = [], []
    for runs in groups.values():
        hits = []
        for run in runs:
            found = _read(run)
            if isinstance(found, Rejected):
                rejected.append(found)
            else:
                hits.append(found)
        if hits:
            spots.append(_spot(runs[0], reference, tuple(hits)))
    return tuple(spots), tuple(rejected)


def channel_probe(signal: Signal) -> Probe:
    """Where a channel sits.

    Raises:
        RefusedError: It doesn't say.
    """
    channel = signal.channel
    if channel.body is None or channel.point is None or channel.axis is None:
        raise RefusedError(
            f"{signal.stream.file}: {channel.column}: joints of an arm need body, point and axis of every channel"
        )
    return Probe(name=channel.column, body=channel.body, point=channel.point, axis=channel.axis)


def _accelerometers(run: Run) -> list[Signal]:
    signals = run.select("linear-acceleration", role="output")
    return [s for s in signals if s.channel.location != "base" and s.channel.direction != "radial"]


def _place(run: Run) -> tuple[object, ...]:
    hit = channel_probe(run.select("force", role="input")[0])
    sensors = tuple(channel_probe(s) for s in _accelerometers(run))
    return (tuple(sorted(run.posture.items())), hit, sensors, run.payload_mass, run.payload_com)


def _read(run: Run) -> HitSpectrum | Rejected:
    force, sensors = run.select("force", role="input")[0], _accelerometers(run)
    if not sensors:
        return Rejected(run=run.id, finding="no-output", detail="no accelerometer on the arm was recorded")
    contact = find_contact(force.samples, force.sampling_rate)
    if contact is None:
        return Rejected(
            run=run.id, finding="dead-channel", detail="the force channel shows no hit above its noise"
        )
    if is_double_hit(contact):
        return Rejected(run=run.id, finding="double-hit", detail="the hammer touched twice")
    for signal in (force, *sensors):
        if is_clipped(signal.samples, signal.channel.full_scale):
            return Rejected(run=run.id, finding="clipping", detail=f"{signal.channel.column} is cut off")
    excitation = Excitation(signal=force, lever=1.0, unit="N", low_cutoff=0.0)
    responses = [
        Response(
            signal=s, name=s.channel.column, order=2, lever=1.0, gravity=0.0,
            low_cutoff=(s.channel.low_cutoff or 0.0) if s.channel.coupling == "ac" else 0.0,
        )
        for s in sensors
    ]  # fmt: skip
    return hit_spectrum(run, excitation, responses, force.samples, contact)


def _spot(run: Run, reference: Reference, hits: Sequence[HitSpectrum]) -> Spot:
    if run.payload_mass:
        raise RefusedError(
            f"run {run.id}: put the payload into the arm's model; hits with another one are not fitted"
        )
    hit = channel_probe(run.select("force", role="input")[0])
    sensors = [channel_probe(s) for s in _accelerometers(run)]
    rows = [reference.rows(run.posture, sensor) for sensor in sensors]
    return Spot(
        name=run.repeat_of or run.id,
        posture=dict(run.posture),
        mass=reference.mass_matrix(run.posture),
        gravity_stiffness=reference.gravity_stiffness(run.posture),
        force=reference.rows(run.posture, hit)[0],
        motion=np.array([motion for motion, _ in rows]),
        tilt=np.array([tilt for _, tilt in rows]),
        outputs=tuple(sensor.name for sensor in sensors),
        hits=tuple(hits),
    )
