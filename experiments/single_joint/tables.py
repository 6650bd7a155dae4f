"""The paper's Tables 1 and 2 and Equation (26) beside what was identified here, as Markdown."""

from __future__ import annotations

from jointscope.identification.result import Identification
from jointscope.models.paper import paper, printed_agreement
from jointscope.models.parameters import Rig


def table1(rig: Rig) -> list[str]:
    """The bench's parameters."""
    bench, joint = paper().table1, rig.joint
    rows = (
        ("motor rated power", f"{bench.rated_power:g} W", "not simulated"),
        ("motor inertia J_m", f"{bench.motor_inertia:g} kg m^2", f"{joint.motor_inertia:g}"),
        ("reducer inertia J_s", f"{bench.reducer_inertia:g} kg m^2", f"{joint.reducer_inertia:g}"),
        (
            "reducer stiffness, maker's",
            f"{bench.reducer_stiffness:,.2f} N m/rad",
            f"{joint.stiffness:,.0f} (Table 2)",
        ),
        ("arm length, mass", f"{bench.arm_length:g} m, {bench.arm_mass:g} kg", f"{rig.arm_mass:g} kg"),
        ("reduction ratio n", "not printed", f"{joint.reduction_ratio:g} (inferred from 246 rad/s)"),
        ("J_M = (J_m + J_s) n^2", "", f"{joint.reflected_inertia:.4g} kg m^2"),
    )
    return ["| | paper | here |", "|---|---|---|", *(f"| {a} | {b} | {c} |" for a, b, c in rows)]


def table26(found: Identification) -> list[str]:
    """Coefficients of the direct parametric form (20)."""
    printed = paper().equation26
    J, K, c = (found.parameters[name] for name in ("inertia", "stiffness", "damping_total"))
    rows = (
        ("b1 = 1/J_L [1/(kg m^2)]", f"{printed.b1:g}", f"{1.0 / J.value:.4f}"),
        ("a1 = c/J_L [1/s]", f"{printed.a1:g}", f"{c.value / J.value:.3f}"),
        ("a2 = K/J_L [1/s^2]", f"{printed.a2:g}", f"{K.value / J.value:.5g}"),
        ("b2 [1/(kg m^2 s)]", f"{printed.b2:g}", "0: the arm starts at rest"),
        ("b3 [1/(kg m^2 s^2)]", f"{printed.b3:g}", "0"),
    )
    return ["| (26) | paper | here |", "|---|---|---|", *(f"| {a} | {b} | {c} |" for a, b, c in rows)]


def table2(found: Identification) -> list[str]:
    """Identified stiffness, inertia, damping with their 95 % intervals, beside both columns of the paper."""
    identified, reference = paper().table2_identified, paper().table2_reference
    lines = [
        "| Table 2 | paper, identified (the truth here) | paper, reference | here, 95 % interval |",
        "|---|---|---|---|",
    ]
    for name, key, unit in (
        ("stiffness K", "stiffness", "N m/rad"),
        ("load inertia J_L", "inertia", "kg m^2"),
        ("damping c", "damping", "N m s/rad"),
    ):
        estimate = found.parameters[key]
        low, high = estimate.low, estimate.high
        lines.append(
            f"| {name} [{unit}] | {getattr(identified, key):,g} | {getattr(reference, key):,g} "
            f"| {estimate.value:,.6g} ({low:,.6g} to {high:,.6g}) |"
        )
    return lines


def printed_rows() -> list[str]:
    """(21) on (26) against Table 2, and (24) on (27) against Table 4."""
    lines = ["| | from the printed coefficients | printed in the table | difference [%] |", "|---|---|---|---|"]
    lines += [
        f"| {a.where}, {a.quantity} | {a.from_equation:,.6g} | {a.printed:,.6g} "
        f"| {100.0 * (a.from_equation / a.printed - 1.0):+.2f} |"
        for a in printed_agreement()
    ]
    return lines
