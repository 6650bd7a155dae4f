"""The single-joint bench's experiments, simulated: hammer hits, swept torque, motion under speed control."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.models.parameters import Rig
from jointscope.models.rig import rig_spec
from jointscope.recordings.campaign import Campaign, Experiment, Nameplate, Run, Stream
from jointscope.sim.bench import holding_command, set_up, take
from jointscope.sim.chain import Chain
from jointscope.sim.drive import speed_loop
from jointscope.sim.excitation import Sweep, ThereAndBack
from jointscope.sim.physics import BASE, Physics
from jointscope.sim.plan import HammerPlan, SingleJointPlan
from jointscope.sim.pulse import CONTACT_TIMES, Pulse, total_force
from jointscope.sim.recording import current_stream, daq_stream, plc_stream
from jointscope.sim.stepping import Trace, grid

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Take:
    """One run to be made.

    Attributes:
        id: Of the run.
        experiment: Which one.
        number: Of the run within the campaign, from 0.
        level: Peak force [N], torque amplitude [N m] or travel [rad].
        repeat_of: Shared by takes of one level.
    """

    id: str
    experiment: Experiment
    number: int
    level: float
    repeat_of: str


def base_physics(take: Take) -> Physics:
    """The base rig in every take."""
    del take
    return BASE


def planned_takes(plan: SingleJointPlan) -> tuple[Take, ...]:
    """Every run of the campaign in order."""
    groups: list[tuple[Experiment, str, tuple[float, ...], int]] = []
    if plan.hammer is not None:
        groups.append(("hammer", "hammer", plan.hammer.levels, plan.hammer.hits))
    if plan.sweep is not None:
        groups.append(("torque-sweep", "sweep", plan.sweep.levels, plan.sweep.repeats))
    if plan.motion is not None:
        groups.append(("speed-motion", "motion", plan.motion.travels, plan.motion.repeats))
    takes: list[Take] = []
    for experiment, name, levels, repeats in groups:
        for step, level in enumerate(levels, start=1):
            for repeat in range(1, repeats + 1):
                same = f"{name}-level{step}"
                takes.append(
                    Take(
                        id=f"{same}-{repeat:02d}",
                        experiment=experiment,
                        number=len(takes),
                        level=level,
                        repeat_of=same,
                    )
                )
    return tuple(takes)


def simulate_single_joint(
    rig: Rig,
    plan: SingleJointPlan,
    rng: np.random.Generator,
    physics: Callable[[Take], Physics] = base_physics,
) -> Campaign:
    """Record a whole campaign in memory.

    Args:
        rig: The truth.
        plan: What is recorded, and through which chain.
        rng: Each run draws from a child of its own, so a run does not depend on those before it.
        physics: What reality adds to the base rig in each take.
    """
    return Campaign(
        path=Path("simulated"),
        rig=nameplate(rig, plan),
        runs=tuple(simulate_runs(rig, plan, rng, physics)),
        title=plan.title,
        notes=plan.notes,
    )


def simulate_runs(
    rig: Rig, plan: SingleJointPlan, rng: np.random.Generator, physics: Callable[[Take], Physics] = base_physics
) -> Iterator[Run]:
    """The runs one by one, for a caller that shows progress; arguments as of :func:`simulate_single_joint`."""
    spec = rig_spec(rig)
    takes = planned_takes(plan)
    for take_, own in zip(takes, rng.spawn(len(takes)), strict=True):
        yield _RECORD[take_.experiment](spec, rig, plan, take_, physics(take_), own)


def nameplate(rig: Rig, plan: SingleJointPlan) -> Nameplate:
    """What the lab knows: the exact items of the format from the rig, the rough ones from the plan, nothing else."""
    joint, rough = rig.joint, plan.rough
    electrical = plan.chain.electrical if plan.chain.currents is not None else None
    return Nameplate(
        topology="two-inertia",
        motion="rotational",
        plane="vertical" if rig.gravity > 0.0 else "horizontal",
        reduction_ratio=joint.reduction_ratio,
        motor_inertia=joint.motor_inertia,
        reducer_inertia=joint.reducer_inertia,
        motor_damping=rough.motor_damping,
        load_damping=rough.load_damping,
        arm_mass=rig.arm_mass,
        arm_com_radius=rig.arm_com_radius,
        efficiency=joint.efficiency,
        torque_constant=electrical.torque_constant if electrical else None,
        pole_pairs=electrical.pole_pairs if electrical else None,
        stiffness_reference=rough.stiffness_reference,
        inertia_reference=rough.inertia_reference,
        damping_reference=rough.damping_reference,
    )


def draw_hit(hammer: HammerPlan, level: float, rng: np.random.Generator) -> tuple[Pulse, ...]:
    """One hit as a hand makes it: scattered in level, contact time and start, now and then with a rebound."""
    contact = CONTACT_TIMES[hammer.hardness] * math.exp(rng.normal(0.0, hammer.contact_scatter))
    peak = level * math.exp(rng.normal(0.0, hammer.level_scatter))
    first = Pulse(start=hammer.pre_trigger + rng.uniform(0.0, 1e-3), contact_time=contact, peak=peak)
    gap, share, rebounds = rng.uniform(0.03, 0.12), rng.uniform(0.1, 0.5), rng.random()
    if rebounds >= hammer.double_hit_probability:
        return (first,)
    second = Pulse(start=first.start + contact + gap, contact_time=contact * 1.1, peak=share * peak)
    return first, second


def _hammer_run(
    spec: mujoco.MjSpec, rig: Rig, plan: SingleJointPlan, what: Take, physics: Physics, rng: np.random.Generator
) -> Run:
    hammer = plan.hammer
    assert hammer is not None
    chain = physics.chain(plan.chain)
    setup = set_up(spec, hammer.arm_angle, plan.timestep, braked=True, physics=physics)
    times = grid(hammer.duration + chain.reach(plan.timestep), plan.timestep)
    force = total_force(draw_hit(hammer, what.level, rng), times)
    place = 1.0 + rng.normal(0.0, hammer.position_scatter) / rig.hammer_radius
    gain = 1.0 + rng.normal(0.0, hammer.gain_scatter)
    trace = take(setup, {"hammer": force * place * gain}, len(times))
    trace = physics.sensed(replace(trace, inputs={**trace.inputs, "hammer": force}))
    daq = daq_stream(
        what.id, trace, rig, chain, hammer.duration, rng,
        with_force=True, force_skew=rng.normal(0.0, hammer.timing_scatter),
    )  # fmt: skip
    return _run(what, hammer.arm_angle, (daq,), brake=True)


def _sweep_run(
    spec: mujoco.MjSpec, rig: Rig, plan: SingleJointPlan, what: Take, physics: Physics, rng: np.random.Generator
) -> Run:
    sweep = plan.sweep
    assert sweep is not None
    chain = physics.chain(plan.chain)
    setup = set_up(spec, sweep.arm_angle, plan.timestep, physics=physics)
    duration = sweep.lead + sweep.sweep_time + sweep.trail
    times = grid(duration + chain.reach(plan.timestep), plan.timestep)
    excitation = Sweep(
        start=sweep.lead,
        duration=sweep.sweep_time,
        first_frequency=sweep.first_frequency,
        last_frequency=sweep.last_frequency,
        amplitude=what.level,
    )
    trace = take(setup, {"motor": holding_command(setup) + excitation.torque(times)}, len(times))
    return _run(
        what, sweep.arm_angle, _motor_streams(physics.sensed(trace), rig, chain, what, duration, rng, None)
    )


def _motion_run(
    spec: mujoco.MjSpec, rig: Rig, plan: SingleJointPlan, what: Take, physics: Physics, rng: np.random.Generator
) -> Run:
    motion = plan.motion
    assert motion is not None
    chain = physics.chain(plan.chain)
    setup = set_up(spec, motion.arm_angle, plan.timestep, physics=physics)
    duration = motion.lead + motion.motion_time + motion.trail
    times = grid(duration + chain.reach(plan.timestep), plan.timestep)
    path = ThereAndBack(start=motion.lead, duration=motion.motion_time, travel=what.level)
    ratio = rig.joint.reduction_ratio
    loop = speed_loop(
        motion.drive,
        lambda t: ratio * path.speed(t),
        reduction_ratio=ratio,
        motor_angle=setup.motor_angle,
        holding_torque=holding_command(setup),
    )
    trace = physics.sensed(take(setup, {}, len(times), controller=loop))
    return _run(what, motion.arm_angle, _motor_streams(trace, rig, chain, what, duration, rng, path.speed))


def _motor_streams(
    trace: Trace,
    rig: Rig,
    chain: Chain,
    what: Take,
    duration: float,
    rng: np.random.Generator,
    speed_command: Callable[[float], float] | None,
) -> tuple[Stream, ...]:
    streams = [
        daq_stream(what.id, trace, rig, chain, duration, rng),
        plc_stream(what.id, trace, rig, chain, duration, rng, speed_command=speed_command),
    ]
    if chain.currents is not None:
        streams.append(current_stream(what.id, trace, rig, chain, duration, rng))
    return tuple(streams)


def _run(what: Take, arm_angle: float, streams: tuple[Stream, ...], *, brake: bool = False) -> Run:
    return Run(
        id=what.id,
        experiment=what.experiment,
        streams=streams,
        brake=brake,
        arm_angle=arm_angle,
        repeat_of=what.repeat_of,
    )


_RECORD = {"hammer": _hammer_run, "torque-sweep": _sweep_run, "speed-motion": _motion_run}
