"""What the paper states does not agree, and for each statement a cause that could bring it about."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from jointscope.models.paper import paper, paper_rig
from jointscope.models.parameters import Joint, Rig
from jointscope.sim.concealed import catalogue, rigs
from jointscope.sim.concealed.law import Effect, Kind, Setting
from jointscope.sim.concealed.measurement import Devices, Noise
from jointscope.sim.concealed.rehearsal import DriveGains, Plan, Take

ALL: tuple[Kind, ...] = ("hammer", "torque-sweep", "speed-motion")


@dataclass(frozen=True, kw_only=True)
class Cause:
    """A concealed effect: which law, and its numbers.

    Attributes:
        label: ``name@location`` of the contract.
        law: The generator's own law under that name.
        values: Numbers that are not left to chance.
    """

    label: str
    law: str
    values: Mapping[str, float]

    def effect(self, setting: Setting) -> Effect:
        """The effect in a campaign of these scales."""
        law = next(
            law for law in catalogue.LISTED
            if f"{law.effect}@{law.location}" == self.label and law.law == self.law
        )  # fmt: skip
        shape = law.shape(setting, np.random.default_rng(0))
        return Effect(law, {**shape, **self.values})


@dataclass(frozen=True, kw_only=True)
class Mismatch:
    """One statement of the paper.

    Attributes:
        key: Short name.
        stated: What the paper says.
        figure: The paper's figure that shows it.
        kind: The experiment whose held-out runs are compared.
        band: Where the mismatch is stated [Hz].
        shown: What the picture shows [Hz].
        rig: The true rig, the concealed cause aside.
        kinds: Experiments of the campaign.
        causes: What is concealed.
        log_rate: Of the drive's log [Hz].
        counts: Of the motor's encoder per turn; a coarse one makes the speed loop shake the rig at all frequencies.
        reference: Damping that the identified one is compared with [N m s/rad], where that is the mismatch.
    """

    key: str
    stated: str
    figure: str
    kind: Kind
    band: tuple[float, float]
    shown: tuple[float, float]
    rig: Rig
    kinds: tuple[Kind, ...]
    causes: tuple[Cause, ...]
    log_rate: float = 500.0
    counts: float = 2.0**17
    reference: float | None = field(default=None)


def mismatches() -> tuple[Mismatch, ...]:
    """The four statements."""
    bench = paper_rig()
    reference = paper().table2_reference.damping
    return (
        Mismatch(
            key="sweep-low-below-15-hz", stated="torque sweep: below 15 Hz the prediction is low", figure="Figure 12",
            kind="torque-sweep", band=(5.0, 15.0), shown=(4.0, 80.0), rig=bench, kinds=ALL,
            causes=(Cause(label="base-compliance@base", law="sliding",
                          values={"frequency": 11.0, "share": 0.1, "damping": 0.04}),),
        ),
        Mismatch(
            key="motion-low-above-60-hz",
            stated="speed-controlled motion: above 60 Hz the prediction is low; a higher mode is missing and the log's low"
            " rate distorts the torque",
            figure="Figure 15", kind="speed-motion", band=(60.0, 100.0), shown=(5.0, 120.0), rig=bench, kinds=ALL,
            causes=(
                Cause(label="link-flexibility@load", law="two-masses",
                      values={"frequency": 85.0, "share": 0.2, "damping": 0.02}),
                Cause(label="torque-logging@acquisition", law="held", values={"every": 2.0, "log_rate": 1000.0}),
            ),
            log_rate=1000.0, counts=2.0**12,
        ),
        Mismatch(
            key="arm-large-0-80-hz", stated="joint 2 of the arm: over 0-80 Hz the prediction is slightly large",
            figure="Figure 23", kind="speed-motion", band=(1.0, 80.0), shown=(1.0, 80.0), rig=_second_joint(), kinds=ALL,
            causes=(Cause(label="torque-gain@motor", law="constant", values={"excess": 0.07, "sign": -1.0}),),
            counts=2.0**12,
        ),
        Mismatch(
            key="damping-97-percent-high", stated="identified damping 59.76 N m s/rad against 30.27: +97 %",
            figure="Figure 9, Table 2", kind="hammer", band=(30.0, 50.0), shown=(20.0, 60.0),
            rig=replace(bench, joint=replace(bench.joint, damping=reference)), kinds=("hammer",),
            causes=(Cause(label="coulomb-friction@load", law="tanh", values={"torque": 2.3, "asymmetry": 0.0}),),
            reference=reference,
        ),
    )  # fmt: skip


def _second_joint() -> Rig:
    """Joint 2 by its first mode (Tables 3 and 4); what the paper doesn't give is chosen: ratio, efficiency, mass, radii."""
    printed = paper()
    mode = printed.table4[0]
    joint = Joint(
        stiffness=mode.stiffness, damping=mode.damping, load_inertia=mode.inertia,
        motor_inertia=printed.table3.motor_inertia, reducer_inertia=printed.table3.reducer_inertia,
        reduction_ratio=120.0, motor_damping=4.0, load_damping=4.0, efficiency=0.8,
    )  # fmt: skip
    return Rig(joint=joint, arm_mass=20.0, arm_com_radius=0.5, hammer_radius=0.8, accelerometer_radius=0.95)


def plan_of(mismatch: Mismatch, rng: np.random.Generator, *, quick: bool) -> tuple[Plan, Noise]:
    """The campaign that the paper's laboratory could have recorded, hits, sweeps and motions at several levels."""
    rig, joint = mismatch.rig, mismatch.rig.joint
    takes = [take for kind in mismatch.kinds for take in _takes(kind, joint, rng, quick=quick)]
    takes = [replace(take, begin=30.0 * i) for i, take in enumerate(takes)]
    devices = Devices(
        daq_rate=1024.0, log_rate=mismatch.log_rate, low_cutoff=0.0, full_scale=200.0, motor_counts=mismatch.counts,
        arm_counts=2.0**20, motor_encoder=mismatch.kinds != ("hammer",), arm_encoder=False,
    )  # fmt: skip
    gains = DriveGains(
        hold=0.6, bandwidth=5.0, integral=0.2, cycle=1e-3,
        resolution=2.0 * math.pi / (mismatch.counts * joint.reduction_ratio),
    )  # fmt: skip
    plan = rigs.settle_scales(rig, Plan(takes=tuple(takes), devices=devices, gains=gains), mismatch.kinds)
    assert plan.setting is not None
    noise = Noise(
        acceleration=0.01, colour=0.3, pole=0.9, level=0.001, force=0.3, torque=0.003, arm=1e-6, outliers=0.0,
        hit_gain=0.005, hit_timing=1e-5,
    )  # fmt: skip
    return rigs.scatter_hits(rng, plan, noise), noise


def _takes(kind: Kind, joint: Joint, rng: np.random.Generator, *, quick: bool) -> list[Take]:
    if kind == "hammer":
        peaks = np.geomspace(60.0, 480.0, 8 if quick else 16)
        return [
            Take(kind=kind, angle=0.0, duration=2.0, begin=0.0, force=float(peak), pulse=0.005,
                 at=float(rng.uniform(0.04, 0.06)))
            for peak in peaks
        ]  # fmt: skip
    repeats = 1 if quick else 2
    if kind == "torque-sweep":
        # the paper's bench is swept with up to 0.9 N m; the heavier joint with as much wind-up
        full = 0.9 * joint.stiffness / paper_rig().joint.stiffness
        return [
            Take(kind=kind, angle=-math.pi / 3.0, duration=3.0, begin=0.0, amplitude=share * full, band=(4.0, 80.0))
            for share in (0.4, 1.0) for _ in range(repeats)
        ]  # fmt: skip
    return [
        Take(kind=kind, angle=0.0, duration=4.8, begin=0.0, travel=travel)
        for travel in (math.pi / 3.0, 2.0 * math.pi / 3.0) for _ in range(repeats)
    ]  # fmt: skip
