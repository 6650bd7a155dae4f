"""A likeness of a laboratory: its rig as fitted, its runs as they were driven, its channels with the noise they showed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d
from scipy.signal import butter, lfilter, resample_poly, sosfiltfilt

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.foretelling import unsettled
from jointscope.diagnosis.noise import ANGULAR, NoiseModel, block_key, inflation
from jointscope.errors import RefusedError
from jointscope.experiments.rehearsal.bench import SPEED_LOOP_HZ, Programme, Work, carry_out
from jointscope.models.parameters import STANDARD_GRAVITY, Joint, Rig
from jointscope.recordings.bandlimited import Bandlimited, bandlimited
from jointscope.recordings.campaign import Campaign, Channel, Run, Stream
from jointscope.sim.concealed.law import Effect, Kind, Moment, Setting
from jointscope.sim.concealed.measurement import Devices
from jointscope.sim.concealed.rehearsal import faults

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import PreparedRun, Problem

Real = NDArray[np.float64]

SLOW_HZ = 1.5  # a recorded torque below this belongs to the drive's hold, and is the rehearsed drive's own affair
SESSION_GAP = 30.0  # s between runs
SPARE = 0.98  # of the arm's inertia that its mass may account for
ACCELERATIONS = ("linear-acceleration", "acceleration", "angular-acceleration")


@dataclass(frozen=True, eq=False)
class Likeness:
    """What is rehearsed.

    Attributes:
        works: What is done, per run of ``problem.runs``.
        left_out: Runs and channels that are not simulated, and why, one line each.
    """

    campaign: Campaign
    problem: Problem
    rig: Rig
    setting: Setting
    works: tuple[Work, ...]
    noise: NoiseModel
    left_out: tuple[str, ...] = field(default=())


def rig_of(problem: Problem, theta: Real) -> Rig:
    """The rig with the fitted parameters; what the nameplate lacks and the runs can't tell takes a usual value."""
    plate = problem.rig
    b = {name: float(theta[index]) for name, index in BASE_INDEX.items()}
    n = plate.reduction_ratio or 100.0
    reflected = b["motor_inertia"] if b["motor_inertia"] > 0.0 else 2.0 * b["load_inertia"]
    slides = plate.motion == "translational"
    joint = Joint(
        stiffness=b["stiffness"], damping=max(b["damping"], 0.0), load_inertia=b["load_inertia"],
        motor_inertia=0.5 * reflected / n**2, reducer_inertia=0.5 * reflected / n**2, reduction_ratio=n,
        motor_damping=max(b["motor_damping"], 0.0), load_damping=max(b["load_damping"], 0.0),
        efficiency=min(b["efficiency"], 1.0) or 1.0,
    )  # fmt: skip
    accelerometer, hammer = _radius(problem, ACCELERATIONS), _radius(problem, ("force",))
    if slides:
        return Rig(
            joint=joint, arm_mass=0.6 * joint.load_inertia, arm_com_radius=1.0, hammer_radius=1.0,
            accelerometer_radius=1.0, gravity=0.0,
        )  # fmt: skip
    weight = abs(b["gravity_moment"])
    vertical = plate.plane == "vertical" and weight > 0.0
    radius = plate.arm_com_radius or 0.6 * accelerometer
    if vertical:  # m g r is what was fitted, m r^2 what the arm has room for
        radius = min(radius, SPARE * joint.load_inertia * STANDARD_GRAVITY / weight)
        mass = weight / (STANDARD_GRAVITY * radius)
    else:
        mass = min(plate.arm_mass or math.inf, 0.7 * joint.load_inertia / radius**2)
    if mass * radius**2 >= joint.load_inertia:
        radius = math.sqrt(SPARE * joint.load_inertia / mass)
    return Rig(
        joint=joint, arm_mass=mass, arm_com_radius=radius, hammer_radius=hammer, accelerometer_radius=accelerometer,
        gravity=STANDARD_GRAVITY if vertical else 0.0,
    )  # fmt: skip


def _radius(problem: Problem, quantities: Sequence[str]) -> float:
    found = [
        s.channel.radius
        for prepared in problem.runs
        for s in prepared.run.signals
        if s.channel.quantity in quantities and s.channel.location == "arm" and s.channel.radius
    ]
    return float(found[0]) if found else 0.5


def _shut(signal: Bandlimited, factor: float) -> Programme:
    """A recorded signal as a function of time, nothing outside its record."""

    def programme(times: Real) -> Real:
        inside = (times >= signal.start) & (times <= signal.end)
        return np.asarray(np.where(inside, factor * signal(times), 0.0))

    return programme


def work_of(run: PreparedRun, rig: Rig, noise: NoiseModel, rng: np.random.Generator) -> Work | str:
    """What was done in a run, or why it can't be rehearsed."""
    kind = run.run.experiment
    if kind == "free" or run.mode.startswith("prescribed"):
        return "its motion is given, not driven"
    if not run.spring:
        return "a carriage without a spring has no elastic joint to rehearse"
    duration = run.steps / run.grid_rate + run.t0
    force: Programme | None = None
    if run.load is not None:
        force = _shut(run.load.signal, 1.0 / rig.hammer_radius)
    struck = kind == "hammer" and force is not None
    kinds: Kind = kind
    common = Work(
        kind=kinds, angle=run.initial_angle, duration=duration, braked=run.mode == "braked",
        force=force,
        gain=float(rng.normal(0.0, noise.gain)) if struck else 0.0,
        late=float(rng.normal(0.0, noise.timing)) if struck else 0.0,
        one_device=len(run.run.streams) == 1,
    )  # fmt: skip
    if common.braked:
        return common if force is not None else "a held motor and no force on the arm"
    resonance = math.sqrt(rig.joint.stiffness / rig.joint.load_inertia) / (2.0 * math.pi)
    if run.command is not None:
        bandwidth = min(SPEED_LOOP_HZ, 0.2 * resonance)
        return replace(common, speed=_shut(run.command.signal, 1.0), bandwidth=bandwidth)
    if run.motor is None:
        return "the motor moves and neither its torque nor a command was recorded"
    lively = np.asarray(run.motor.samples, dtype=np.float64)
    sections = butter(2, SLOW_HZ, "highpass", fs=run.motor.signal.rate, output="sos")
    fast = sosfiltfilt(sections, lively - lively[0])
    return replace(common, torque=_shut(bandlimited(fast, run.motor.signal.rate, run.motor.signal.start), 1.0))


def likeness(campaign: Campaign, problem: Problem, theta: Real, noise: NoiseModel, seed: int) -> Likeness:
    """The laboratory's likeness.

    Args:
        theta: Fitted base parameters.
        noise: As the diagnosis measured it.
        seed: Of the hits' scatter.

    Raises:
        RefusedError: No run can be rehearsed.
    """
    rig = rig_of(problem, theta)
    rng = np.random.default_rng([seed, 1])
    works: list[Work] = []
    kept: list[PreparedRun] = []
    left_out: list[str] = []
    for run in problem.runs:
        work = work_of(run, rig, noise, rng)
        if isinstance(work, str):
            left_out.append(f"run {run.run.id}: {work}")
        else:
            works.append(work)
            kept.append(run)
    if not works:
        raise RefusedError(f"{campaign.path}: nothing to rehearse: {left_out[0]}")
    s = problem.scales
    setting = Setting(
        rig=rig, kinds=frozenset(w.kind for w in works), devices=any(len(r.run.streams) > 1 for r in kept),
        force=max(_peak(r) / rig.hammer_radius for r in kept), torque=s.torque, drive_torque=s.motor_torque,
        acceleration=max(s.acceleration, 1e-9), speed=s.speed, travel=s.travel, angle=works[0].angle,
        daq_rate=max(_rates(r)[0] for r in kept), log_rate=max(_rates(r)[1] for r in kept), runs=len(works),
    )  # fmt: skip
    narrowed = replace(problem, runs=tuple(kept))
    return Likeness(campaign, narrowed, rig, setting, tuple(works), noise, tuple(left_out))


def _peak(run: PreparedRun) -> float:
    return float(np.max(np.abs(run.load_half))) if run.load is not None else 0.0


def _rates(run: PreparedRun) -> tuple[float, float]:
    """Rates of the device with the mechanics and of the drive's log [Hz]."""
    rates = [stream.sampling_rate for stream in run.run.streams if stream.length]
    log = [s.sampling_rate for s in run.run.signals if s.channel.location == "motor"]
    daq = [s.sampling_rate for s in run.run.signals if s.channel.location != "motor"]
    return (daq or rates)[0], (log or daq or rates)[0]


def rehearsed(like: Likeness, effects: Sequence[Effect], seed: int) -> Campaign:
    """The campaign with every output simulated anew in MuJoCo, the effects concealed in it, the noise as measured."""
    rng = np.random.default_rng([seed, 2])
    runs = []
    for index, (run, work) in enumerate(zip(like.problem.runs, like.works, strict=True)):
        daq_rate, log_rate = _rates(run)
        full_scale = next((s.channel.full_scale for s in run.run.signals if s.channel.full_scale), None)
        cutoff = next((s.channel.low_cutoff for s in run.run.signals if s.channel.coupling == "ac"), None)
        devices = Devices(
            daq_rate=daq_rate, log_rate=log_rate, low_cutoff=cutoff or 0.0, full_scale=full_scale or 1e9,
            motor_counts=2.0**17, arm_counts=2.0**20, motor_encoder=True, arm_encoder=True,
        )  # fmt: skip
        begin = SESSION_GAP * index
        clean = carry_out(
            like.rig, like.setting, work, effects, devices, index=index, runs=len(like.works), begin=begin
        )
        moment = Moment(
            index=index,
            runs=len(like.works),
            begin=begin,
            braked=work.braked,
            kind=work.kind,
            duration=work.duration,
        )
        force_gain = faults(effects, moment).force_gain
        runs.append(
            _recorded(like, run, clean, (daq_rate, daq_rate if work.one_device else log_rate), force_gain, rng)
        )
    return replace(like.campaign, runs=tuple(runs), title="rehearsal", notes="")


def _recorded(
    like: Likeness, run: PreparedRun, clean: Mapping[str, Real], rates: tuple[float, float], force_gain: float,
    rng: np.random.Generator,
) -> Run:  # fmt: skip
    streams: list[Stream] = []
    for device, stream in enumerate(run.run.streams):
        channels: list[Channel] = []
        for place, channel in enumerate(stream.channels):
            if channel.samples is None:
                channels.append(channel)
                continue
            samples = _channel(like, run, channel, stream, clean, rates, force_gain)
            if samples is None:
                continue
            noise = _noise(like.noise, run, (device, place), samples, rng)
            channels.append(replace(channel, samples=samples + noise))
        if channels:
            streams.append(replace(stream, channels=tuple(channels)))
    return replace(run.run, streams=tuple(streams))


def _channel(
    like: Likeness, run: PreparedRun, channel: Channel, stream: Stream, clean: Mapping[str, Real],
    rates: tuple[float, float], force_gain: float,
) -> Real | None:  # fmt: skip
    """The channel without noise at its stream's times; inputs that are imposed stay as recorded; ``None`` where unknown."""
    quantity, motor = channel.quantity, channel.location == "motor"
    if channel.location in ("base", "neighbour") or channel.direction == "radial":
        return None
    if channel.role == "input" and not (motor and quantity in ("torque", "current", "voltage")):
        recorded = np.asarray(channel.samples, dtype=np.float64)
        return recorded * force_gain if quantity == "force" else recorded
    if quantity in ("torque", "current", "voltage") and motor:
        source = clean.get("torque")
        if source is None or run.motor is None:
            return None
        values = source * like.rig.joint.reduction_ratio / run.torque_factor
    elif quantity in ACCELERATIONS and not motor:
        values = clean["acceleration"]
        if quantity == "angular-acceleration":
            values = values / like.rig.accelerometer_radius
        elif channel.radius and abs(channel.radius / like.rig.accelerometer_radius - 1.0) > 1e-6:
            if like.rig.gravity:
                return None  # weight's share does not scale with the radius
            values = values * channel.radius / like.rig.accelerometer_radius
    elif quantity in ("angle", "position", "angular-velocity", "velocity"):
        values = clean["motor" if motor else "arm"]
        if quantity in ("angular-velocity", "velocity"):
            values = np.gradient(values) * rates[1 if motor else 0]
    else:
        return None
    return bandlimited(values, rates[1 if motor else 0])(stream.times)


def _noise(
    noise: NoiseModel, run: PreparedRun, channel: tuple[int, int], clean: Real, rng: np.random.Generator
) -> Real:
    """Noise as the diagnosis measured it on this channel, shape of ``clean``; nothing where it was not compared."""
    output = next((o for o in run.outputs if o.channel == channel), None)
    if output is None:
        return np.zeros(clean.size)
    if output.quantity in ANGULAR:  # what two neighbouring steps differ by is the sensor's, all else is motion
        steps = np.diff(output.data, 2) if output.data.size > 8 else np.zeros(1)
        sigma = 1.4826 * float(np.median(np.abs(steps - np.median(steps)))) / math.sqrt(6.0)
        return np.asarray(sigma * rng.standard_normal(clean.size))
    block = noise.blocks.get(block_key(run, output))
    if block is None:
        return np.zeros(clean.size)
    whole = output.recorded_rate or output.rate
    thinning = max(round(whole / output.rate), 1)
    shown = replace(output, data=unsettled(clean), mask=np.ones(clean.size, dtype=np.bool_), rate=whole)
    white = block.sigma * rng.standard_normal(-(-clean.size // thinning) + 256)
    coloured = lfilter([1.0], block.ar, white)[256:]
    if thinning > 1:  # measured below the thinned record's Nyquist rate; beyond it as dense as its innovation
        beyond = block.sigma * math.sqrt(thinning) * rng.standard_normal(clean.size)
        low = resample_poly(beyond, 1, thinning)[: coloured.size]
        coloured = beyond + resample_poly(coloured - low, thinning, 1)[: clean.size]
    return np.asarray(coloured * uniform_filter1d(inflation(shown, block), 3))
