"""The settings of noise and scatter whose recovery is claimed, and a campaign of each with known answers."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from jointscope.recordings.campaign import Campaign

Real = NDArray[np.float64]

BAND = (2.0, 50.0)  # Hz
HITS = 20


@dataclass(frozen=True, kw_only=True)
class Case:
    """One setting of noise and scatter.

    Attributes:
        name: Short.
        acceleration: White noise on the acceleration, rms over each hit's peak.
        force: Likewise on the force.
        gain: Hit-to-hit gain scatter, relative standard deviation.
        timing: Hit-to-hit skew, standard deviation [s].
        bias: Bounds on |mean error| of K, J_L, c [%]; ``None``: not claimed.
        ratio: Bound on scatter over the Cramer-Rao bound; ``None``: not claimed.
        cover: Whether 95 % intervals must cover 93-97 %.
        index: Part of every seed.
        share: Every ``share``-th seed is run.
        mujoco: Truth by MuJoCo instead of the closed form.
    """

    name: str
    acceleration: float
    force: float
    gain: float = 0.0
    timing: float = 0.0
    bias: tuple[float, float, float] | None = None
    ratio: float | None = None
    cover: bool = False
    index: int
    share: int = 1
    mujoco: bool = False


CASES = (
    Case(name="1 % acceleration, 0.5 % force", acceleration=0.01, force=0.005, bias=(0.1, 0.1, 0.3), ratio=1.3,
         cover=True, index=0),
    Case(name="1 % acceleration, 5 % force", acceleration=0.01, force=0.05, bias=(0.5, 0.5, 0.5), ratio=2.0, index=1),
    Case(name="1 % gain and 30 us timing scatter", acceleration=0.01, force=0.005, gain=0.01, timing=30e-6, cover=True,
         index=2),
    Case(name="MuJoCo, 1 % acceleration, 0.5 % force", acceleration=0.01, force=0.005, bias=(0.1, 0.1, 0.3), index=3,
         share=20, mujoco=True),
)  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class Records:
    """One campaign's records for the other methods, the truth and the bound.

    Attributes:
        torque: Shape (n_hits, n) [N m].
        acceleration: Angular, shape (n_hits, n) [rad/s^2].
        rate: [Hz].
        truth: K, J_L, c.
        bound: Their Cramer-Rao bounds, standard deviations; NaN where not computed.
    """

    torque: Real
    acceleration: Real
    rate: float
    truth: Real
    bound: Real


def closed_form_campaign(case: Case, rng: np.random.Generator) -> tuple[Campaign, Records]:
    """A campaign of ``case`` with closed-form truth."""
    from jointscope.experiments.recovery_bound import fisher_matrix
    from jointscope.experiments.recovery_truth import Bench, draw_pulses, record
    from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream

    bench = Bench()
    pulses = draw_pulses(rng, HITS)
    runs, forces, accelerations, noise_y, noise_u = [], [], [], [], []
    for number, pulse in enumerate(pulses):
        force, acceleration = record(bench, pulse, late=rng.normal(0.0, case.timing) if case.timing else 0.0)
        acceleration = acceleration * (1.0 + (rng.normal(0.0, case.gain) if case.gain else 0.0))
        noise_u.append(case.force * float(np.abs(force).max()))
        noise_y.append(case.acceleration * float(np.abs(acceleration).max()))
        force = force + rng.normal(0.0, noise_u[-1], force.shape)
        acceleration = acceleration + rng.normal(0.0, noise_y[-1], acceleration.shape)
        forces.append(force * bench.hammer_radius)
        accelerations.append(acceleration / bench.accelerometer_radius)
        channels = (
            Channel(column="force", quantity="force", unit="N", location="arm", role="input", samples=force,
                    radius=bench.hammer_radius),
            Channel(column="acc", quantity="linear-acceleration", unit="m/s^2", location="arm", role="output",
                    samples=acceleration, radius=bench.accelerometer_radius),
        )  # fmt: skip
        stream = Stream(file="hit", sampling_rate=bench.rate, length=force.size, channels=channels)
        runs.append(Run(id=f"hit-{number:02d}", experiment="hammer", brake=True, streams=(stream,)))
    fisher = fisher_matrix(bench, pulses, noise_y, noise_u, BAND)
    campaign = Campaign(
        path=Path("recovery"), rig=Nameplate(topology="two-inertia", motion="rotational"), runs=tuple(runs)
    )
    return campaign, Records(
        torque=np.array(forces),
        acceleration=np.array(accelerations),
        rate=bench.rate,
        truth=np.array([bench.stiffness, bench.inertia, bench.damping]),
        bound=np.sqrt(np.diag(np.linalg.inv(fisher))),
    )


def mujoco_campaign(case: Case, rng: np.random.Generator) -> tuple[Campaign, Records]:
    """The same with MuJoCo's truth."""
    from jointscope.models.paper import paper_rig
    from jointscope.sim.chain import noiseless
    from jointscope.sim.measurement_noise import HitNoise, with_noise
    from jointscope.sim.plan import HammerPlan, SingleJointPlan
    from jointscope.sim.single_joint import simulate_single_joint

    rig = paper_rig()
    hits = HammerPlan(
        hits=HITS // 2, gain_scatter=0.0, timing_scatter=0.0, position_scatter=0.0, double_hit_probability=0.0
    )
    plan = SingleJointPlan(hammer=hits, sweep=None, motion=None, chain=noiseless())
    clean = simulate_single_joint(rig, plan, rng)
    noise = HitNoise(
        acceleration=case.acceleration, force=case.force, gain_scatter=case.gain, timing_scatter=case.timing
    )
    campaign = with_noise(clean, noise, rng)
    first = campaign.runs[0].streams[0]
    rows = {
        quantity: np.array([run.select(quantity)[0].samples for run in campaign.runs])
        for quantity in ("force", "linear-acceleration")
    }
    return campaign, Records(
        torque=rows["force"] * rig.hammer_radius,
        acceleration=rows["linear-acceleration"] / rig.accelerometer_radius,
        rate=first.sampling_rate,
        truth=np.array([rig.joint.stiffness, rig.joint.load_inertia, rig.joint.damping + rig.joint.load_damping]),
        bound=np.full(3, np.nan),
    )
