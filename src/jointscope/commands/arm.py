"""Arms with several elastic joints: find a robot, make it elastic, look at it, solve for wanted resonances.

  jointscope arm list                                   the arms of example-robot-data, by name
  jointscope arm template ur10 --out table.toml         a table to fill in: one row of placeholders per joint
  jointscope arm build table.toml --out robot.xml       robot + table -> MJCF with a rotor and a reducer at every joint
  jointscope arm show table.toml                        inertias, gravity, modes at the table's posture, by both engines
  jointscope arm solve --out solved.toml                the load, bend and stiffnesses that give the paper's Table 4
  jointscope arm identify CAMPAIGN --out DIR            K and c of single joints from hits at several points and postures
  jointscope arm recovery --seeds 40                    how well that works: error and coverage over simulated campaigns

A table names a robot of the library or your own URDF or MJCF beside it, and gives stiffness, damping, reduction ratio
and rotor inertia of each joint (`jointscope arm template` writes one with every key explained by its unit).
`build` also takes TABLE = `six-axis`, the solved arm that this package ships. `identify` writes joints.json and the arm's
MJCF with the found figures, which `jointscope predict` takes.
"""

from __future__ import annotations

import argparse
import json
import os
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from jointscope.models.arm.solve import Solution
    from jointscope.models.arm.table import ArmTable


def configure(parser: argparse.ArgumentParser) -> None:
    """Declare the options."""
    actions = parser.add_subparsers(dest="action", metavar="ACTION", required=True)
    listing = actions.add_parser("list", help="the arms that can be named")
    listing.add_argument("--json", action="store_true", help="for machines")
    template = actions.add_parser("template", help="write a table for a robot, to be filled in")
    template.add_argument("robot", help="a name from `arm list`, or a URDF or MJCF file")
    template.add_argument("--out", type=Path, required=True, help="table to write")
    build = actions.add_parser("build", help="make a robot elastic")
    build.add_argument("table", help="the table, or six-axis")
    build.add_argument("--out", type=Path, required=True, help="MJCF to write")
    show = actions.add_parser("show", help="inertias, gravity and modes of a table's arm")
    show.add_argument("table", help="the table, or six-axis")
    show.add_argument("--json", action="store_true", help="for machines")
    solve = actions.add_parser("solve", help="find load, bend, stiffness and damping for two wanted modes")
    solve.add_argument("table", nargs="?", default="six-axis-start", help="start table (default: the paper's arm)")
    solve.add_argument("--hit", default="shoulder_lift_joint", help="joint whose link is hit")
    solve.add_argument("--bend", default="elbow_joint", help="joint whose angle is free")
    solve.add_argument(
        "--mode", action="append", nargs=3, type=float, metavar=("J", "C", "K"),
        help="a wanted mode: kg m^2, N m s/rad, N m/rad; give it twice (default: the paper's Table 4)",
    )  # fmt: skip
    solve.add_argument("--starts", type=int, default=24, help="random starts (default 24)")
    solve.add_argument("--seed", type=int, default=0, help="of the starts (default 0)")
    solve.add_argument("--out", type=Path, required=True, help="solved table to write")
    identify = actions.add_parser("identify", help="K and c of single joints from hits on the braked arm")
    identify.add_argument("campaign", type=Path, help="folder with campaign.toml")
    identify.add_argument("--out", type=Path, required=True, help="folder to write")
    identify.add_argument("--joints", nargs="+", help="joints that are sought (default: those that were hit)")
    identify.add_argument("--band", nargs=2, type=float, default=(4.0, 50.0), metavar="HZ", help="lines to fit")
    identify.add_argument(
        "--inertia", type=float, default=0.0, metavar="SHARE",
        help="by how much the model's inertias may be off (0.05: 5 %%); one common factor is then estimated (default 0)",
    )  # fmt: skip
    recovery = actions.add_parser("recovery", help="error and coverage of the joints over simulated campaigns")
    recovery.add_argument("--seeds", type=int, default=40, help="how many campaigns (default 40)")
    recovery.add_argument("--seed", type=int, default=0, help="the first (default 0)")
    recovery.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    recovery.add_argument("--json", action="store_true", help="for machines")


def run(options: argparse.Namespace) -> int:
    """Do what was asked."""
    actions = {
        "list": _list, "template": _template, "build": _build, "show": _show, "solve": _solve,
        "identify": _identify, "recovery": _recovery,
    }  # fmt: skip
    return actions[options.action](options)


def _list(options: argparse.Namespace) -> int:
    from jointscope.models.arm.library import library_arms

    arms = library_arms()
    if options.json:
        print(json.dumps([{"name": a.name, "axes": list(a.axes), "mass": a.mass} for a in arms], indent=2))
        return 0
    for arm in arms:
        print(f"{arm.name:22s} {len(arm.axes)} axes  {arm.mass:6.2f} kg  {', '.join(arm.axes)}")
    print("\nA joint that is no axis of the arm (a gripper's) is welded with robot.lock in the table.")
    return 0


def _template(options: argparse.Namespace) -> int:
    from jointscope.models.arm.build import rigid_spec, source_file
    from jointscope.models.arm.table import ArmTable, ElasticJoint, write_table

    path = source_file(ArmTable(source=options.robot, joints=(), folder=Path.cwd()))
    is_file = bool(Path(options.robot).suffix)
    source = os.path.relpath(path, options.out.resolve().parent) if is_file else options.robot
    rows = tuple(
        ElasticJoint(
            name=joint.name, stiffness=1e5, damping=50.0, reduction_ratio=100.0,
            motor_inertia=None if joint.armature > 0.0 else 5e-4,
        )
        for joint in rigid_spec(path).joints
    )  # fmt: skip
    write_table(
        options.out,
        ArmTable(
            source=source, joints=rows, title="FILL IN: placeholders", posture={row.name: 0.0 for row in rows}
        ),
    )
    print(
        f"{options.out}: {len(rows)} joints; replace the placeholders (K, c in N m/rad, N m s/rad; inertia in kg m^2)"
    )
    return 0


def _table(name: str) -> ArmTable:
    from jointscope.models.arm.table import read_table

    shipped = {"six-axis": "six_axis.toml", "six-axis-start": "six_axis_start.toml"}
    path = Path(str(files("jointscope.models.arm") / shipped[name])) if name in shipped else Path(name)
    return read_table(path)


def _build(options: argparse.Namespace) -> int:
    from jointscope.models.arm.build import build_arm, write_arm

    arm = build_arm(_table(options.table))
    write_arm(options.out, arm)
    model = arm.spec.compile()
    print(
        f"{options.out}: {len(arm.rotors)} elastic joints, {model.nv} degrees of freedom, {model.body_mass.sum():.3f} kg"
    )
    return 0


def _show(options: argparse.Namespace) -> int:
    from jointscope.models.arm.agreement import compare_engines
    from jointscope.models.arm.build import build_arm
    from jointscope.models.arm.linear import joint_values, linear_arm, natural_modes
    from jointscope.models.arm.reference import arm_reference

    table = _table(options.table)
    arm = build_arm(table)
    reference = arm_reference(arm)
    posture = table.posture
    values = joint_values(arm)
    modes = natural_modes(linear_arm(reference, posture, values, {}))
    both = compare_engines(arm, reference, posture)
    locked, unlocked = reference.locked_inertia(posture), reference.unlocked_inertia(posture)
    gravity, slope = reference.gravity(posture), reference.gravity_stiffness(posture)
    if options.json:
        content: dict[str, Any] = {
            "joints": list(arm.rotors), "locked_inertia": locked.tolist(), "unlocked_inertia": unlocked.tolist(),
            "gravity": gravity.tolist(), "gravity_stiffness": slope.tolist(),
            "mass_matrix": reference.mass_matrix(posture).tolist(), "frequency_hz": modes.frequency.tolist(),
            "damping_ratio": modes.damping_ratio.tolist(), "strain_share": modes.strain.tolist(),
            "agreement": {"mass": both.mass, "gravity": both.gravity, "gravity_stiffness": both.gravity_stiffness,
                          "modes": both.modes},
        }  # fmt: skip
        print(json.dumps(content, indent=2))
        return 0
    print(
        "joint                    q [rad]  K [N m/rad]  J locked   J unlocked  g [N m]  dg/dq [N m/rad]  J_M [kg m^2]"
    )
    for k, name in enumerate(arm.rotors):
        print(
            f"{name:24s} {posture.get(name, 0.0):7.3f} {values.stiffness[k]:12.5g} {locked[k]:9.4f} {unlocked[k]:12.5f} "
            f"{gravity[k]:8.2f} {slope[k, k]:17.2f} {values.rotor_inertia[k]:13.3f}"
        )
    print("\nmodes with every rotor braked; share of each joint's reducer in the elastic energy")
    print("  f [Hz]   zeta [-]  " + "  ".join(name[:14].rjust(14) for name in arm.rotors))
    for m, frequency in enumerate(modes.frequency):
        shares = "  ".join(f"{100.0 * share:13.1f}%" for share in modes.strain[:, m])
        print(f"{frequency:8.3f} {modes.damping_ratio[m]:10.4f}  {shares}")
    print(
        f"\nMuJoCo against Pinocchio, largest relative difference: mass matrix {both.mass:.1e}, gravity torque "
        f"{both.gravity:.1e}, gravity stiffness {both.gravity_stiffness:.1e}"
        f"\nmodes by Pinocchio, by MuJoCo's matrices and by MuJoCo's stepping: {both.modes:.1e}"
    )
    return 0


def _solve(options: argparse.Namespace) -> int:
    from dataclasses import replace

    import numpy as np

    from jointscope.errors import JointscopeError
    from jointscope.models.arm.solve import PAPER_TABLE_4, Target, solve_arm
    from jointscope.models.arm.table import write_table

    if options.mode and len(options.mode) != 2:
        raise JointscopeError(f"--mode was given {len(options.mode)} times: give the lower and the upper mode")
    wanted = [Target(inertia=J, damping=c, stiffness=K) for J, c, K in options.mode or ()]
    targets = (wanted[0], wanted[1]) if wanted else PAPER_TABLE_4
    rng = np.random.default_rng(options.seed)
    solution = solve_arm(_table(options.table), options.hit, options.bend, targets, starts=options.starts, rng=rng)
    for target, found in zip(targets, solution.found, strict=True):
        print(
            f"wanted {target.frequency:7.3f} Hz  J~ {target.inertia:8.4g} kg m^2  c~ {target.damping:7.4g} N m s/rad  "
            f"K~ {target.stiffness:10.7g} N m/rad   found {found.frequency:7.3f} Hz {found.inertia:8.4g} "
            f"{found.damping:7.4g} {found.stiffness:10.7g}"
        )
    table = solution.table
    print(f"mass_scale {table.mass_scale:.6f}, {options.bend} {np.degrees(table.posture[options.bend]):.3f} deg")
    for name in (options.hit, options.bend):
        row = table.joint(name)
        print(f"{name}: K = {row.stiffness:.6g} N m/rad, c = {row.damping:.6g} N m s/rad")
    print(
        f"coupling {solution.coupling:.3f}, at most {solution.coupling_bound:.3f} possible; "
        f"{solution.starts[1]} of {solution.starts[0]} starts end here; modes {np.round(solution.modes.frequency, 3)} Hz"
    )
    write_table(options.out, replace(table, computed=_how(options, solution)))
    print(options.out)
    return 0


def _how(options: argparse.Namespace, solution: Solution) -> dict[str, Any]:
    return {
        "command": f"jointscope arm solve {options.table} --hit {options.hit} --bend {options.bend} "
        f"--starts {options.starts} --seed {options.seed}",
        "sought": "mass_scale, the bend's angle, stiffness and damping of the hit and the bent joint",
        "wanted": "J~, c~, K~ of two modes of the braked arm at the hit joint; Table 4 of Sensors 2022, 22(16), 6170 "
        "unless --mode was given",
        "found_frequency_hz": [target.frequency for target in solution.found],
        "found_inertia": [target.inertia for target in solution.found],
        "found_damping": [target.damping for target in solution.found],
        "found_stiffness": [target.stiffness for target in solution.found],
        "largest_relative_error": solution.error,
        "coupling": solution.coupling,
        "coupling_bound": solution.coupling_bound,
        "starts_that_agree": list(solution.starts),
        "all_modes_hz": solution.modes.frequency.tolist(),
        "not_unique": "payload, the other joints and the arm's other angles were given; other choices give other solutions",
    }


def _identify(options: argparse.Namespace) -> int:
    from dataclasses import asdict

    from jointscope.atomic import write_text
    from jointscope.errors import InputError
    from jointscope.identification.arm_spots import read_spots
    from jointscope.identification.joint_stiffness import Belief, identify_joints
    from jointscope.models.arm.build import with_reducers, write_arm
    from jointscope.models.arm.linear import joint_values
    from jointscope.models.arm.reference import arm_reference
    from jointscope.prediction.arm_guess import guess_map, mapped_arm
    from jointscope.recordings.reader import read_campaign

    campaign = read_campaign(options.campaign)
    if campaign.mjcf is None:
        raise InputError(options.campaign / "campaign.toml", "model.mjcf", "is missing", fix="name the arm's MJCF")
    found = guess_map(campaign.path / campaign.mjcf, campaign)
    arm = mapped_arm(found)
    names = {str(joint.rotor): joint.campaign for joint in found.joints}
    spots, rejected = read_spots(campaign, arm_reference(arm))
    for left_out in rejected:
        print(f"left out: {left_out.run}: {left_out.finding}: {left_out.detail}")
    hit = dict.fromkeys(run.joint for run in campaign.runs if run.experiment == "hammer" and run.joint)
    sought = tuple(options.joints or hit)
    for name in sought:
        arm.index(name)
    rough = joint_values(arm)
    fit = identify_joints(
        spots, arm.rotors, rough.stiffness, rough.damping, sought,
        belief=Belief(inertia=options.inertia), band=tuple(options.band),
    )  # fmt: skip
    print(f"{fit.hits} hits at {len(spots)} points and postures; misfit {fit.misfit:.3f} of the noise")
    for estimate in (*fit.stiffness, *fit.damping):
        kind = "K" if estimate.unit == "N m/rad" else "c"
        said = "" if estimate.identifiable else "   not identifiable from these hits: as believed before"
        print(
            f"{names[estimate.joint]:24s} {kind} = {estimate.value:11.6g} [{estimate.low:.6g}, {estimate.high:.6g}] "
            f"{estimate.unit}{said}"
        )
    if options.inertia > 0.0:
        factor, low, high = fit.inertia_factor
        print(f"inertias of the model times {factor:.4f} [{low:.4f}, {high:.4f}]; the MJCF written keeps its own")
    content = {
        "format": "jointscope-joints/1", "hits": fit.hits, "band_hz": list(options.band), "misfit": fit.misfit,
        "stiffness": [asdict(e) for e in fit.stiffness], "damping": [asdict(e) for e in fit.damping],
        "inertia_factor": list(fit.inertia_factor), "rejected": [asdict(r) for r in rejected],
    }  # fmt: skip
    write_text(options.out / "joints.json", json.dumps(content, indent=2, allow_nan=False) + "\n")
    identified = with_reducers(
        arm, {e.joint: e.value for e in fit.stiffness}, {e.joint: e.value for e in fit.damping}
    )
    write_arm(options.out / "arm.xml", identified)
    print(f"{options.out / 'joints.json'}, {options.out / 'arm.xml'}")
    print(f"next: jointscope predict {options.out / 'arm.xml'} CAMPAIGN --out DIR")
    return 0


def _recovery(options: argparse.Namespace) -> int:
    from jointscope.experiments.six_axis.recovery import recover, summary

    seeds = range(options.seed, options.seed + options.seeds)
    rows = recover(seeds, workers=options.workers)
    table = summary(rows)
    if options.json:
        print(json.dumps(table, indent=2))
    else:
        print(
            f"{len(rows)} campaigns: 20 hits, two points, two postures, noise 1 % on acceleration, 0.5 % on force"
        )
        for name, figures in table.items():
            print(
                f"{name:34s} bias {100 * figures['bias']:+.4f} %  scatter {100 * figures['scatter']:.4f} %  "
                f"worst {100 * figures['worst']:.3f} %  covered {100 * figures['coverage']:.1f} %"
            )
    return int(any(f["worst"] > 0.03 for name, f in table.items() if name.endswith(" K")))
