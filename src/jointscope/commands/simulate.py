"""Write a campaign of simulated recordings, as a laboratory would hand them over.

`single-joint` is the bench of Li et al., Sensors 2022, 22(16), 6170: hammer hits on the arm with the motor braked,
swept motor torque from a hanging arm, and motion there and back under speed control, two levels each. MuJoCo moves
the rig; sensors, anti-alias filters, converters and clocks make recordings of it. The campaign holds the nameplate
and the recordings; the rig's stiffness, inertia and damping are not in it.

examples:
  jointscope simulate single-joint --out bench --seed 1
  jointscope simulate single-joint --out hits --experiments hammer --hits 20 --tip hard
  jointscope simulate single-joint --out late --plc-delay 0.004 --torque-log hold --torque-log-rate 250
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import mujoco

    from jointscope.models.parameters import Rig
    from jointscope.sim.arm.plan import ArmPlan, HammerSpot
    from jointscope.sim.chain import Chain
    from jointscope.sim.plan import SingleJointPlan

_EXPERIMENTS = ("hammer", "sweep", "motion")


def configure(parser: argparse.ArgumentParser) -> None:
    """Add the command's options."""
    rigs = parser.add_subparsers(dest="rig", metavar="RIG", required=True)
    single = rigs.add_parser(
        "single-joint",
        help="the paper's bench",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    _configure_single_joint(single)
    arm = rigs.add_parser(
        "six-axis", help="the paper's arm: hits on the braked arm, joint 2 swept and moved by its drive"
    )
    arm.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="campaign to write; must not exist yet"
    )
    arm.add_argument("--seed", type=int, default=0, help="of hit scatter and noise (default 0)")
    arm.add_argument(
        "--arm", metavar="TABLE", help="table of a UR10 with other figures (default: the solved six-axis arm)"
    )
    arm.add_argument(
        "--experiments", nargs="+", choices=_EXPERIMENTS, default=_EXPERIMENTS, help="which ones (default all)"
    )
    arm.add_argument("--hits", type=int, default=5, metavar="N", help="at each point and posture (default 5)")
    arm.add_argument(
        "--point", type=float, nargs=3, metavar=("X", "Y", "Z"),
        help="hit only here, on the link of joint 2, in its frame [m] (default: two points in two postures)",
    )  # fmt: skip
    arm.add_argument(
        "--direction", type=float, nargs=3, default=(1.0, 0.0, 0.0), metavar=("X", "Y", "Z"),
        help="of that hit, in the link's frame (default 1 0 0)",
    )  # fmt: skip
    arm.add_argument(
        "--posture", nargs="+", default=(), metavar="JOINT=RAD", help="joints that stand elsewhere during that hit"
    )


def _configure_single_joint(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="campaign to write; must not exist yet"
    )
    parser.add_argument("--seed", type=int, default=0, help="of hit scatter and noise (default 0)")
    parser.add_argument(
        "--experiments", nargs="+", choices=_EXPERIMENTS, default=_EXPERIMENTS, help="which ones (default all)"
    )
    parser.add_argument("--hits", type=int, default=10, metavar="N", help="hammer hits per level (default 10)")
    parser.add_argument("--hit-levels", type=float, nargs="+", metavar="N", help="mean peak forces [N]")
    parser.add_argument(
        "--tip", choices=("soft", "medium", "hard"), default="medium", help="10, 7 or 4 ms of contact"
    )
    parser.add_argument(
        "--repeats", type=int, default=2, metavar="N", help="of sweeps and motions, per level (default 2)"
    )
    parser.add_argument("--sweep-levels", type=float, nargs="+", metavar="NM", help="torque amplitudes [N m]")
    parser.add_argument("--travels", type=float, nargs="+", metavar="DEG", help="of the motions [deg]")
    parser.add_argument("--currents", action="store_true", help="also three phase currents at 10 kHz")
    parser.add_argument("--noiseless", action="store_true", help="ideal sensors, converters and hits")
    parser.add_argument(
        "--plc-delay", type=float, default=0.0, metavar="S", help="by which the PLC stamps late [s]"
    )
    parser.add_argument(
        "--plc-ppm", type=float, default=0.0, metavar="PPM", help="by which the PLC's clock runs fast"
    )
    parser.add_argument(
        "--torque-log", choices=("band-limited", "hold", "average", "alias", "none"), default="band-limited",
        help="how the torque gets into the PLC's log; none: the drive doesn't say it",
    )  # fmt: skip
    parser.add_argument("--torque-log-rate", type=float, metavar="HZ", help="rate at which it is refreshed [Hz]")
    parser.add_argument("--stiffness", type=float, metavar="K", help="of the simulated reducer [N m/rad]")
    parser.add_argument("--damping", type=float, metavar="C", help="of the simulated reducer [N m s/rad]")
    parser.add_argument("--inertia", type=float, metavar="J", help="of the simulated arm about the joint [kg m^2]")
    parser.add_argument(
        "--hardening", type=float, default=0.0, metavar="K3",
        help="cubic stiffness of the simulated reducer beside K [N m/rad^3] (default 0)",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print what was written for machines")


def run(options: argparse.Namespace) -> int:
    """Simulate and write."""
    if options.rig == "six-axis":
        return _run_six_axis(options)
    import json

    import numpy as np

    from jointscope.errors import JointscopeError
    from jointscope.progress import track
    from jointscope.recordings.campaign import Campaign
    from jointscope.recordings.writer import write_campaign
    from jointscope.sim.physics import BASE, Physics
    from jointscope.sim.single_joint import nameplate, planned_takes, simulate_runs

    if options.seed < 0:
        raise JointscopeError(f"--seed {options.seed}: must be 0 or more")
    if options.out.exists() and (not options.out.is_dir() or any(options.out.iterdir())):
        raise JointscopeError(f"--out {options.out}: exists already; choose another or remove it")
    rig, plan = _rig(options), _plan(options)
    hardening = Physics(edit=lambda spec: _harden(spec, options.hardening)) if options.hardening else BASE
    steps = simulate_runs(rig, plan, np.random.default_rng(options.seed), lambda take: hardening)
    runs = tuple(track(steps, "simulate", total=len(planned_takes(plan))))
    campaign = Campaign(path=options.out, rig=nameplate(rig, plan), runs=runs, title=plan.title, notes=plan.notes)
    path = write_campaign(campaign, options.out)
    if options.json:
        print(json.dumps({"campaign": str(path), "runs": [r.id for r in runs], "seed": options.seed}))
    else:
        kinds = {
            kind: sum(r.experiment == kind for r in runs) for kind in dict.fromkeys(r.experiment for r in runs)
        }
        print(
            f"{path}: "
            + ", ".join(f"{count} {kind}" for kind, count in kinds.items())
            + f" runs, seed {options.seed}"
        )
        print(f"next: jointscope inspect {path}")
    return 0


def _harden(spec: mujoco.MjSpec, cubic: float) -> None:
    """Give the reducer a torque ``cubic`` y^3 beside K y over its wind-up y [rad]."""
    spec.joint("reducer").stiffness[2] = cubic


def _chosen_spot(options: argparse.Namespace, plan: ArmPlan) -> HammerSpot:
    """The hit that the user placed, on the link of joint 2."""
    from dataclasses import replace

    from jointscope.errors import JointscopeError
    from jointscope.models.arm.holding import Probe

    posture = dict(plan.truth.posture)
    for word in options.posture:
        name, _, angle = word.partition("=")
        if name not in posture:
            raise JointscopeError(f"--posture {word}: no such joint; joints: {', '.join(posture)}")
        try:
            posture[name] = float(angle)
        except ValueError:
            raise JointscopeError(f"--posture {word}: write it as {name}=0.5, in rad") from None
    x, y, z = options.point
    first = plan.spots[0]
    hit = Probe(name="hit_chosen", body=first.hit.body, point=(x, y, z), axis=tuple(options.direction))
    return replace(first, name="hammer", hit=hit, radius=(x * x + z * z) ** 0.5, posture=posture)


def _run_six_axis(options: argparse.Namespace) -> int:
    from dataclasses import replace

    import numpy as np

    from jointscope.errors import JointscopeError
    from jointscope.experiments.six_axis.plans import joints_plan
    from jointscope.models.arm.table import read_table
    from jointscope.progress import track
    from jointscope.sim.arm.campaign import arm_campaign, simulate_arm, write_arm_campaign
    from jointscope.sim.arm.plan import ArmMotion, ArmSweep, lab_table

    if options.out.exists() and (not options.out.is_dir() or any(options.out.iterdir())):
        raise JointscopeError(f"--out {options.out}: exists already; choose another or remove it")
    plan = joints_plan(options.hits)
    if options.arm is not None:
        truth = read_table(Path(options.arm))
        plan = replace(plan, truth=truth, lab=lab_table(truth))
    if options.point is not None:
        plan = replace(plan, spots=(_chosen_spot(options, plan),))
    plan = replace(
        plan,
        spots=plan.spots if "hammer" in options.experiments else (),
        sweep=ArmSweep() if "sweep" in options.experiments else None,
        motion=ArmMotion() if "motion" in options.experiments else None,
        title="Six-axis arm, simulated",
    )
    made = simulate_arm(plan, np.random.default_rng(options.seed))
    total = (
        sum(spot.hammer.hits for spot in plan.spots) + 2 * (plan.sweep is not None) + 2 * (plan.motion is not None)
    )
    runs = tuple(recording.run for recording in track(made, "simulate", total=total))
    write_arm_campaign(arm_campaign(plan, runs), plan, options.out)
    print(f"{options.out}: {len(runs)} runs, seed {options.seed}; arm.xml is the arm as the lab believes it")
    print(f"next: jointscope arm identify {options.out} --out DIR")
    return 0


def _rig(options: argparse.Namespace) -> Rig:
    from dataclasses import replace

    from jointscope.models.paper import paper_rig

    rig = paper_rig()
    joint = rig.joint
    return replace(
        rig,
        joint=replace(
            joint,
            stiffness=joint.stiffness if options.stiffness is None else options.stiffness,
            damping=joint.damping if options.damping is None else options.damping,
            load_inertia=joint.load_inertia if options.inertia is None else options.inertia,
        ),
    )


def _plan(options: argparse.Namespace) -> SingleJointPlan:
    import math

    from jointscope import __version__
    from jointscope.sim.plan import HammerPlan, MotionPlan, SingleJointPlan, SweepPlan
    from jointscope.sim.stepping import TIMESTEP

    hammer, sweep, motion = HammerPlan(), SweepPlan(), MotionPlan()
    steady = 0.0 if options.noiseless else 1.0
    hammer = HammerPlan(
        hits=options.hits,
        levels=tuple(options.hit_levels or hammer.levels),
        hardness=options.tip,
        position_scatter=steady * hammer.position_scatter,
        gain_scatter=steady * hammer.gain_scatter,
        timing_scatter=steady * hammer.timing_scatter,
        double_hit_probability=steady * hammer.double_hit_probability,
    )
    sweep = SweepPlan(repeats=options.repeats, levels=tuple(options.sweep_levels or sweep.levels))
    travels = tuple(math.radians(t) for t in options.travels) if options.travels else motion.travels
    motion = MotionPlan(repeats=options.repeats, travels=travels)
    return SingleJointPlan(
        hammer=hammer if "hammer" in options.experiments else None,
        sweep=sweep if "sweep" in options.experiments else None,
        motion=motion if "motion" in options.experiments else None,
        chain=_chain(options),
        notes=f"Simulated by jointscope {__version__}, seed {options.seed}, step {TIMESTEP:g} s.",
    )


def _chain(options: argparse.Namespace) -> Chain:
    from dataclasses import replace

    from jointscope.sim.chain import Chain, CurrentProbes, noiseless
    from jointscope.sim.measurement import Clock
    from jointscope.sim.measurement_log import TorqueLog

    chain = noiseless() if options.noiseless else Chain()
    probes = CurrentProbes(converter=chain.force_cell) if options.noiseless else CurrentProbes()
    return replace(
        chain,
        plc=replace(chain.plc, clock=Clock(delay=options.plc_delay, ppm=options.plc_ppm)),
        torque_log=None
        if options.torque_log == "none"
        else TorqueLog(kind=options.torque_log, rate=options.torque_log_rate),
        currents=probes if options.currents else None,
    )
