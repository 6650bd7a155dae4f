"""The page of the six-axis reproduction: claims, the paper's tables beside the found ones, figures; and its JSON."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from jointscope.atomic import write_text
from jointscope.experiments.six_axis.claims import SYMBOLS, Claim, claims
from jointscope.experiments.six_axis.results import SixAxisResult
from jointscope.experiments.six_axis.windup import as_numbers
from jointscope.models.arm.solve import PAPER_TABLE_4
from jointscope.models.arm.table import ArmTable
from jointscope.models.joint import DirectForm

PAPER_27 = (
    DirectForm(b1=0.116, b2=-59.97, b3=-5.76e6, a1=7.11, a2=1.11e4),
    DirectForm(b1=0.074, b2=2.461e2, b3=-5.882e4, a1=6.062, a2=3.251e4),
)
"""Equation (27) as printed."""


def write_report(
    out: Path, result: SixAxisResult, table: ArmTable, figures: Sequence[tuple[str, str]], seed: int
) -> bool:
    """Write README.md and results.json into ``out``; whether every claim holds."""
    found = claims(result)
    write_text(out / "results.json", json.dumps(_numbers(result, found, seed), indent=2, allow_nan=False) + "\n")
    write_text(out / "README.md", "\n".join(_page(result, found, table, figures, seed)) + "\n")
    return all(claim.holds for claim in found)


def _page(
    result: SixAxisResult, found: Sequence[Claim], table: ArmTable, figures: Sequence[tuple[str, str]], seed: int
) -> list[str]:
    held = sum(claim.holds for claim in found)
    lines = [
        "# Section 4: the six-axis arm", "",
        "Li et al., Sensors 2022, 22(16), 6170. The arm is a UR10 of example-robot-data, its masses scaled by "
        f"{table.mass_scale:.4f}, {table.payload.mass if table.payload else 0:g} kg at the flange, elbow at "
        f"{table.posture.get('elbow_joint', 0.0):.4f} rad; load, bend and the reducers of joints 2 and 3 were solved for "
        "Table 4 by `jointscope arm solve` (models/arm/six_axis.toml says how). It is simulated in MuJoCo, recorded through a "
        f"measurement chain, identified and predicted from the recordings alone. Seed {seed}.", "",
        f"**{held} of {len(found)} claims hold.**", "",
        "| | claim | found | bound |", "|---|---|---|---|",
    ]  # fmt: skip
    lines += [f"| {'yes' if c.holds else '**NO**'} | {c.what} | {c.value} | {c.bound} |" for c in found]
    lines += ["", "## Table 3: the second joint's motor", "", *_table_3(table)]
    lines += ["", "## Equation (27) and Table 4", "", "| | paper | here | 95 % |", "|---|---|---|---|"]
    for number, (mode, target, printed) in enumerate(
        zip(result.hammer.modes.modes, PAPER_TABLE_4, PAPER_27, strict=False), start=1
    ):
        for name, symbol, unit in SYMBOLS:
            e = getattr(mode, name)
            wanted = getattr(target, name)
            lines.append(
                f"| {symbol} {number}{number} [{unit}] | {wanted:g} | {e.value:.6g} | {_span(e.low, e.high)} |"
            )
        for key in ("b1", "a1", "a2", "b2"):
            lines.append(
                f"| {key} of term {number} | {getattr(printed, key):g} | {getattr(mode.term, key):.5g} | |"
            )
    lines += [
        "", "The paper's b2 and b3 stand for initial-condition constants. Here the arm starts at rest; b2 is what the "
        "unlike damping of the joints makes of the modes, b3 is zero.", "", "## What the modes are", "",
    ]  # fmt: skip
    lines += [f"- {mode.summary}; 1/phi² at joint 2 = {mode.inertia:.4g} kg m²" for mode in result.hammer.physics]
    lines += ["", "## Single joints, from hits at two points and two postures", "",
              "| joint | K [N m/rad] | 95 % | c [N m s/rad] | 95 % | |", "|---|---|---|---|---|---|"]  # fmt: skip
    for k, c in zip(result.joints.stiffness, result.joints.damping, strict=True):
        said = "" if k.identifiable else "not identifiable from these hits: as believed before"
        lines.append(
            f"| {k.joint} | {k.value:.6g} | {_span(k.low, k.high)} | {c.value:.4g} | {_span(c.low, c.high)} | {said} |"
        )
    inertia = result.inertia
    lines += ["", f"Load inertia about joint 2: Pinocchio {inertia.locked:.4g} kg m² with the other joints locked, "
              f"{inertia.unlocked:.4g} kg m² with those beyond it free; from the hits, with one factor on all inertias let free, "
              f"{inertia.identified:.4g} [{inertia.low:.4g}, {inertia.high:.4g}] kg m² locked."]  # fmt: skip
    lines += ["", "## KUKA KR300: wind-up of axes 1 to 3 (recorded)", ""]
    lines += _windup_lines(result.windup)
    lines += ["", "## Figures", ""]
    for name, caption in figures:
        lines += [f"![{caption}]({name})", "", caption, ""]
    return lines


def _table_3(table: ArmTable) -> list[str]:
    row = table.joint("shoulder_lift_joint")
    return [
        "| | paper | here |", "|---|---|---|",
        f"| rotational inertia of the motor [kg m²] | 0.001 | {row.motor_inertia:g} |",
        f"| rotational inertia of the reducer [kg m²] | 0.00032 | {row.reducer_inertia:g} |",
        "| pole pairs | 5 | 5 |", "| torque constant [N m/A] | 0.458 | 0.458 |",
        f"| reduction ratio | not printed | {row.reduction_ratio:g} (assumed, as the bench's) |",
    ]  # fmt: skip


def _span(low: float, high: float) -> str:
    return f"{low:.6g} to {high:.6g}"


def _windup_lines(windup: Mapping[str, Any]) -> list[str]:
    if "missing" in windup:
        return [f"Not run: {windup['missing']}."]
    lines = [
        "| axis | authors [MN m/rad] | spring against torque | with skew, friction, rotor inertia | encoder skew [ms] |",
        "|---|---|---|---|---|",
    ]
    for axis in windup["axes"]:
        fit = axis["fit"]
        shown = [
            f"{e.value / 1e6:.2f} [{e.low / 1e6:.2f}, {e.high / 1e6:.2f}]"
            for e in (fit.plain_stiffness, fit.stiffness)
        ]
        skew = f"{1e3 * fit.skew.value:.2f} [{1e3 * fit.skew.low:.2f}, {1e3 * fit.skew.high:.2f}]"
        lines.append(f"| {axis['axis']} | {axis['authors'] / 1e6:.2f} | {shown[0]} | {shown[1]} | {skew} |")
    return [*lines, "", *(f"- {axis['statement']}" for axis in windup["axes"])]


def _numbers(result: SixAxisResult, found: Sequence[Claim], seed: int) -> dict[str, Any]:
    modes = result.hammer.modes.modes
    return {
        "format": "jointscope-six-axis/1",
        "seed": seed,
        "claims": [asdict(claim) for claim in found],
        "peaks_hz": list(result.hammer.peaks()),
        "between_peaks_db": result.hammer.between_peaks,
        "modes": [
            {name: {"value": e.value, "interval95": [e.low, e.high], "unit": e.unit}
             for name in ("frequency", "damping_ratio", "inertia", "damping", "stiffness") for e in [getattr(mode, name)]}
            for mode in modes
        ],
        "agreement": {"modes": result.agreement.modes, "mass": result.agreement.mass, "gravity": result.agreement.gravity,
                      "gravity_stiffness": result.agreement.gravity_stiffness},
        "joints": [asdict(e) for e in (*result.joints.stiffness, *result.joints.damping)],
        "torque": {t.run: dict(t.errors) for t in result.torque},
        "prediction": {p.run: {name: asdict(score) for name, score in p.scores.items()} for p in result.prediction},
        "steps_per_second": dict(result.speed),
        "windup": as_numbers(dict(result.windup)),
        "load_inertia_joint_2": asdict(result.inertia),
        "seconds": result.seconds,
        "processor_seconds": result.processor_seconds,
    }  # fmt: skip
