"""Takes of the arm, measured and put together as a campaign."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jointscope.atomic import new_directory
from jointscope.models.arm.build import ElasticArm, build_arm, write_arm
from jointscope.recordings.campaign import Campaign, Channel, Experiment, Nameplate, Run, Stream
from jointscope.sim.arm.plan import ArmPlan, HammerSpot, Sensor
from jointscope.sim.arm.takes import Take, hammer_takes, motion_take, sweep_take
from jointscope.sim.chain import Chain, noiseless
from jointscope.sim.measurement import Clock, Converter
from jointscope.sim.measurement_sensors import iepe, phase_currents

Real = NDArray[np.float64]
MODEL = "arm.xml"


@dataclass(frozen=True, kw_only=True, eq=False)
class ArmRecording:
    """A run as a lab has it, and the same take through ideal converters.

    Attributes:
        run: Through the plan's chain.
        truth: Same devices and filters, without noise and rounding.
        take: On the stepping grid.
    """

    run: Run
    truth: Run
    take: Take


def simulate_arm(plan: ArmPlan, rng: np.random.Generator) -> Iterator[ArmRecording]:
    """Every run of ``plan``, one by one."""
    arm = build_arm(plan.truth)
    for spot in plan.spots:
        for number, take in enumerate(hammer_takes(arm, plan, spot, rng), start=1):
            yield _hammer_recording(plan, spot, take, f"{spot.name}-{number:02d}", rng)
    if plan.sweep is not None:
        for step, level in enumerate(plan.sweep.levels, start=1):
            for repeat in range(1, plan.sweep.repeats + 1):
                take = sweep_take(arm, plan, plan.sweep, level, rng)
                yield _driven_recording(plan, arm, take, "torque-sweep", f"sweep-level{step}", repeat, rng)
    if plan.motion is not None:
        for step, travel in enumerate(plan.motion.travels, start=1):
            for repeat in range(1, plan.motion.repeats + 1):
                take = motion_take(arm, plan, plan.motion, travel, rng)
                yield _driven_recording(plan, arm, take, "speed-motion", f"motion-level{step}", repeat, rng)


def arm_campaign(plan: ArmPlan, runs: tuple[Run, ...]) -> Campaign:
    """``runs`` with the lab's nameplate of the joint under test."""
    lab = build_arm(plan.lab)
    row = plan.lab.joint(plan.joint)
    motor = plan.chain.electrical
    return Campaign(
        path=Path("simulated"),
        rig=Nameplate(
            topology="arm", motion="rotational", plane="vertical", reduction_ratio=row.reduction_ratio,
            motor_inertia=row.motor_inertia, reducer_inertia=row.reducer_inertia, motor_damping=row.motor_damping,
            efficiency=1.0, torque_constant=motor.torque_constant, pole_pairs=motor.pole_pairs,
            stiffness_reference=row.stiffness,
        ),
        runs=runs,
        title=plan.title,
        mjcf=MODEL,
        joints=lab.rotors,
    )  # fmt: skip


def write_arm_campaign(campaign: Campaign, plan: ArmPlan, directory: Path) -> None:
    """Write the campaign with the lab's MJCF inside.

    Raises:
        FileExistsError: ``directory`` exists and isn't empty.
    """
    from jointscope.recordings.writer import write_campaign

    with new_directory(directory) as folder:
        write_campaign(campaign, folder)
        write_arm(folder / MODEL, build_arm(plan.lab))


def _hammer_recording(
    plan: ArmPlan, spot: HammerSpot, take: Take, name: str, rng: np.random.Generator
) -> ArmRecording:
    skew = float(rng.normal(0.0, spot.hammer.timing_scatter))
    base = Run(
        id=name, experiment="hammer", streams=(), brake=True, arm_angle=plan.upwards * take.posture[plan.joint],
        repeat_of=spot.name, joint=spot.joint, posture=dict(take.posture), hold=dict(take.hold),
    )  # fmt: skip
    chain = plan.chain
    if plan.relative_noise is not None:
        chain = _relative(chain, plan, take)
    run = replace(base, streams=(_daq(plan, chain, take, name, rng, spot, skew),))
    ideal = noiseless()
    truth = replace(base, streams=(_daq(plan, _same_devices(ideal, chain), take, name, rng, spot, 0.0),))
    return ArmRecording(run=run, truth=truth, take=take)


def _driven_recording(
    plan: ArmPlan, arm: ElasticArm, take: Take, kind: Experiment, group: str, repeat: int, rng: np.random.Generator
) -> ArmRecording:
    name = f"{group}-{repeat:02d}"
    base = Run(
        id=name, experiment=kind, streams=(), arm_angle=plan.upwards * take.posture[plan.joint], repeat_of=group,
        joint=plan.joint, posture=dict(take.posture), hold=dict(take.hold),
    )  # fmt: skip

    def streams(chain: Chain) -> tuple[Stream, ...]:
        return (
            _daq(plan, chain, take, name, rng, None, 0.0),
            _plc(plan, chain, arm, take, name),
            _currents(plan, chain, arm, take, name, rng),
        )

    return ArmRecording(
        run=replace(base, streams=streams(plan.chain)),
        truth=replace(base, streams=streams(_same_devices(noiseless(), plan.chain))),
        take=take,
    )


def _daq(
    plan: ArmPlan,
    chain: Chain,
    take: Take,
    name: str,
    rng: np.random.Generator,
    spot: HammerSpot | None,
    skew: float,
) -> Stream:
    device, h = chain.daq, plan.timestep
    stamps = device.stamps(take.duration)
    channels = []
    if spot is not None and take.force is not None:
        skewed = replace(device, clock=Clock(delay=device.clock.delay + skew, ppm=device.clock.ppm))
        force = chain.force_cell.convert(skewed.sample(take.force, h, stamps), rng)
        channels.append(
            Channel(
                column="force", quantity="force", unit="N", location="arm" if spot.joint == plan.joint else "neighbour",
                role="input", samples=_frozen(force), joint=spot.joint, radius=spot.radius, body=spot.hit.body,
                point=spot.hit.point, axis=spot.hit.axis,
            )
        )  # fmt: skip
    for sensor in plan.sensors:
        felt = iepe(take.trajectory.accelerometer(sensor.probe.name), h, chain.accelerometer.low_cutoff)
        samples = chain.accelerometer.converter.convert(device.sample(felt, h, stamps), rng)
        channels.append(_acceleration(sensor, chain, samples))
    return Stream(
        file=f"{name}.csv", sampling_rate=device.sampling_rate, length=stamps.size, channels=tuple(channels)
    )


def _acceleration(sensor: Sensor, chain: Chain, samples: Real) -> Channel:
    return Channel(
        column=sensor.probe.name, quantity="linear-acceleration", unit="m/s^2", location=sensor.location, role="output",
        samples=_frozen(samples), joint=sensor.joint, radius=sensor.radius, coupling="ac",
        low_cutoff=chain.accelerometer.low_cutoff, full_scale=chain.accelerometer.converter.full_scale,
        body=sensor.probe.body, point=sensor.probe.point, axis=sensor.probe.axis,
    )  # fmt: skip


def _plc(plan: ArmPlan, chain: Chain, arm: ElasticArm, take: Take, name: str) -> Stream:
    device, h = chain.plc, plan.timestep
    stamps = device.stamps(take.duration)
    n = arm.reduction_ratio(plan.joint)
    angle = chain.encoder.read(device.sample(n * take.trajectory.rotor(plan.joint), h, stamps))
    assert take.speed_command is not None
    command = device.sample(take.speed_command, h, stamps)
    channels = (
        Channel(
            column="motor_angle", quantity="angle", unit="rad", location="motor", role="output",
            samples=_frozen(angle), joint=plan.joint,
        ),
        Channel(
            column="speed_command", quantity="speed-command", unit="rad/s", location="motor", role="input",
            samples=_frozen(command), joint=plan.joint,
        ),
    )  # fmt: skip
    return Stream(
        file=f"{name}-plc.csv", sampling_rate=device.sampling_rate, length=stamps.size, channels=channels
    )


def _currents(
    plan: ArmPlan, chain: Chain, arm: ElasticArm, take: Take, name: str, rng: np.random.Generator
) -> Stream:
    probes = chain.currents
    assert probes is not None and take.torque is not None
    stamps = probes.device.stamps(take.duration)
    motor = chain.electrical
    angle = arm.reduction_ratio(plan.joint) * take.trajectory.rotor(plan.joint)
    currents = phase_currents(take.torque, angle, motor.torque_constant, motor.pole_pairs)
    channels = tuple(
        Channel(
            column=f"i_{phase}", quantity="phase-current", unit="A", location="motor", role="input", joint=plan.joint,
            samples=_frozen(probes.converter.convert(probes.device.sample(current, plan.timestep, stamps), rng)),
        )
        for phase, current in zip("uvw", currents, strict=True)
    )  # fmt: skip
    return Stream(
        file=f"{name}-currents.npz",
        sampling_rate=probes.device.sampling_rate,
        length=stamps.size,
        channels=channels,
    )


def _relative(chain: Chain, plan: ArmPlan, take: Take) -> Chain:
    """The chain with noise as a share of this hit's peaks, as the paper's accuracy statements put it."""
    assert plan.relative_noise is not None and take.force is not None
    of_acceleration, of_force = plan.relative_noise
    heard = max(
        float(np.ptp(take.trajectory.accelerometer(s.probe.name))) / 2.0
        for s in plan.sensors
        if s.location != "base"
    )
    return replace(
        chain,
        accelerometer=replace(
            chain.accelerometer,
            converter=replace(chain.accelerometer.converter, noise_rms=of_acceleration * heard),
        ),
        force_cell=replace(chain.force_cell, noise_rms=of_force * float(take.force.max())),
    )


def _same_devices(ideal: Chain, chain: Chain) -> Chain:
    """``chain`` with the converters of ``ideal``."""
    fine = Converter(full_scale=1e4, bits=48)
    currents = None if chain.currents is None else replace(chain.currents, converter=fine)
    return replace(
        chain,
        accelerometer=replace(chain.accelerometer, converter=ideal.accelerometer.converter),
        force_cell=ideal.force_cell, torque_converter=ideal.torque_converter, encoder=ideal.encoder, currents=currents,
    )  # fmt: skip


def _frozen(samples: Real) -> Real:
    samples = np.array(samples)
    samples.setflags(write=False)
    return samples
