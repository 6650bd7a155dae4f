r"""What can be left out of an arm's model, joint by joint: the catalogue's laws, each at every joint that shows it.

The recorder's faults are in :mod:`jointscope.diagnosis.arm.recorder`.

Laws, all at the joint output:

    motor         J_M s'' = ... - (T_c + (T_b - T_c) exp(-(s'/v_s)^2)) sgn(s')       Coulomb, Stribeck; exact stick
                  the same with Dahl's bristle in place of the stick, and unlike in the two directions
    transmission  T_S = K dz(Delta, gap) ; K Delta + k_3 Delta^3 ; K Delta - a K w tanh(Delta/w)
                  c + eta K/w at each posture's own resonance w: a structural loss
                  K Delta + T z(Delta): Dahl's loop, or springs that slip one after the other
    neighbour     a joint that the model has rigid: K_j = M_jj (2 pi f)^2, c_j = 2 zeta sqrt(K_j M_jj)
    base          the whole arm on its mount, a joint more at the root: K = M_00 (2 pi f)^2
    motor         n T_e times gain; n T_e behind a first-order lag
    lines         torque ripple and kinematic error (:mod:`jointscope.diagnosis.arm.periodic`)
    load          a link's own weight times more (:mod:`jointscope.diagnosis.arm.weight`)
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, cast

import numpy as np

from jointscope.diagnosis.arm import kernel
from jointscope.diagnosis.arm.law import SEPARATOR, Put, applied, arm_law
from jointscope.diagnosis.arm.periodic import lines
from jointscope.diagnosis.arm.plant import Mount
from jointscope.diagnosis.arm.problem import ArmProblem
from jointscope.diagnosis.arm.recorder import recorder_faults
from jointscope.diagnosis.arm.weight import weights
from jointscope.diagnosis.effects import catalogue, payloads
from jointscope.diagnosis.effects.spec import EffectSpec, Location, ParameterSpec, Values, one_start

if TYPE_CHECKING:
    from jointscope.diagnosis.arm.predict import ArmAssembly

MICRO = 1e-5  # rad/s: a rotor that moves less says nothing of its friction
TRIED = (
    14.0,
    22.0,
    35.0,
    55.0,
    90.0,
)  # Hz at which a neighbour's flexibility is screened: its shape changes with it
SLOWEST = 2.0 * math.pi * 10.0  # rad/s of a rotor's oscillation, by which its speed tells how far it turns
LEAST = 1e-3  # of the tested joint's inertia, that the last link gives to it, for its load to be told by that
DEPTHS = (0.0, 0.3)  # m of a mount's axis under the arm's origin, tried
UNLIKE_POSTURES = (
    1.2  # times the inertia in one posture that it must be in another, for a loss to be told from damping
)
HIGHEST = 400.0  # Hz of a neighbour's own resonance, beyond which it is rigid
HIGHEST_MOUNT = 120.0  # Hz, the same of a mount


def _setter(joint: int, *columns: int) -> Put:
    def put(assembly: ArmAssembly, values: Values) -> None:
        for column, value in zip(columns, values, strict=True):
            assembly.P[joint, column] = value

    return put


def _friction(problem: ArmProblem, j: int) -> list[EffectSpec]:
    joint, top = problem.facts.joints[j], _reach(problem, j)
    speed = max(float(problem.rotor_speed[j]), MICRO)
    scale = (0.01 * top, 0.06 * top, 0.3 * top)
    torque = ParameterSpec("torque", "N m", 0.0, 3.0 * top, null=0.0)

    def put_coulomb(assembly: ArmAssembly, values: Values) -> None:
        assembly.P[j, kernel.COULOMB] += values[0]
        assembly.P[j, kernel.BREAKAWAY] += values[0]

    coulomb = arm_law(
        "coulomb-friction", "motor", joint, "stick", "dissipative", (torque,), put_coulomb,
        "T_c sgn(s'), sticking while less than T_c acts", scale, ((),), ("torque-sweep", "speed-motion"),
        ("stribeck-friction", "backlash"),
    )  # fmt: skip

    def put_unlike(assembly: ArmAssembly, values: Values) -> None:
        put_coulomb(assembly, values)
        assembly.P[j, kernel.SIDED] = values[1]

    asymmetry = ParameterSpec("asymmetry", "1", -0.6, 0.6)
    unlike = replace(
        coulomb, variant="stick-unlike", parameters=(torque, asymmetry), starts=lambda problem: ((0.0,),),
        law="T_c (1 +- asymmetry) sgn(s'), sticking", apply=applied(put_unlike),
    )  # fmt: skip

    def put_presliding(assembly: ArmAssembly, values: Values) -> None:
        put_unlike(assembly, values)
        assembly.P[j, kernel.PRESLIDING] = values[2]

    turned = speed / SLOWEST
    presliding = replace(
        unlike, variant="presliding", parameters=(
            torque, asymmetry, ParameterSpec("presliding", "rad", 1e-3 * turned, 3.0 * turned, log=True)
        ), starts=lambda problem: tuple((0.0, share * turned) for share in (0.02, 0.1, 0.4)),
        law="T_c z (1 +- asymmetry), z' = (s' - |s'| z)/presliding", apply=applied(put_presliding),
    )  # fmt: skip

    def put_stribeck(assembly: ArmAssembly, values: Values) -> None:
        sliding, ratio, velocity = values[:3]
        assembly.P[j, kernel.COULOMB] += sliding
        assembly.P[j, kernel.BREAKAWAY] += sliding * ratio
        assembly.P[j, kernel.STRIBECK_SPEED] = velocity
        assembly.P[j, kernel.PRESLIDING] = values[3] if len(values) > 3 else 0.0

    wider = (
        torque,
        ParameterSpec("breakaway_ratio", "1", 1.15, 4.0),
        ParameterSpec("stribeck_velocity", "rad/s", 0.003 * speed, 1.0 * speed, log=True),
    )
    stribeck = arm_law(
        "stribeck-friction", "motor", joint, "stick", "dissipative", wider,
        put_stribeck, "(T_c + (T_b - T_c) exp(-(s'/v_s)^2)) sgn(s')", scale,
        tuple((1.6, share * speed) for share in (0.02, 0.08, 0.3)), ("torque-sweep", "speed-motion"),
        ("coulomb-friction",),
    )  # fmt: skip
    rising = replace(
        stribeck, variant="presliding", parameters=(*wider, presliding.parameters[2]),
        starts=lambda problem: tuple((1.6, share * speed, 0.1 * turned) for share in (0.02, 0.08, 0.3)),
        law="the same over Dahl's bristle",
    )  # fmt: skip
    return [coulomb, unlike, presliding, stribeck, rising]


def _reach(problem: ArmProblem, j: int) -> float:
    """Torque that friction at a motor is measured against [N m]: what its reducer hands on, or its drive gives."""
    own = [
        float(np.max(np.abs(r.motor_half - np.median(r.motor_half)))) for r in problem.arm_runs if r.driven == j
    ]
    return max(float(problem.torque[j]), *own, 1e-3) if own else max(float(problem.torque[j]), 1e-3)


def _transmission(problem: ArmProblem, j: int) -> list[EffectSpec]:
    joint = problem.facts.joints[j]
    wind_up, K = max(float(problem.wind_up[j]), 1e-9), float(problem.facts.stiffness[j])
    gap = ParameterSpec("gap", "rad", 0.0, 6.0 * wind_up, null=0.0)
    sizes = (0.02 * wind_up, 0.15 * wind_up, 0.7 * wind_up)
    found = []
    for variant, damped, sheds in (("undamped-gap", 0.0, 0.0), ("damped-gap", 1.0, 0.0), ("sheds", 0.0, 1.0)):

        def put(assembly: ArmAssembly, values: Values, damped: float = damped, sheds: float = sheds) -> None:
            assembly.P[j, kernel.GAP] = values[0]
            assembly.P[j, kernel.GAP_DAMPING] = damped
            assembly.P[j, kernel.SHEDS] = sheds

        found.append(
            arm_law(
                "backlash", "transmission", joint, variant, "stiffness", (gap,), put,
                "T_S = K dz(Delta, gap) + c Delta' (outside the gap, everywhere, or where a flank does not pull)", sizes, ((),),
                ("hammer", "torque-sweep", "speed-motion"), ("stiffness-nonlinearity", "coulomb-friction"),
            )
        )  # fmt: skip
    size = K / wind_up**2
    found.append(
        arm_law(
            "stiffness-nonlinearity", "transmission", joint, "cubic", "stiffness",
            (ParameterSpec("cubic", "N m/rad^3", -0.3 * size, 10.0 * size, null=0.0),), _setter(j, kernel.CUBIC),
            "T_S = K Delta + k_3 Delta^3", (0.02 * size, 0.1 * size, 0.5 * size), ((),), ("hammer", "torque-sweep"),
            ("backlash",),
        )
    )  # fmt: skip

    def put_soft(assembly: ArmAssembly, values: Values) -> None:
        assembly.P[j, kernel.SOFT_SHARE], assembly.P[j, kernel.SOFT_WIDTH] = values

    found.append(
        arm_law(
            "stiffness-nonlinearity", "transmission", joint, "soft-centre", "stiffness",
            (
                ParameterSpec("soft_share", "1", -3.0, 0.7, null=0.0),
                ParameterSpec("transition_angle", "rad", 0.03 * wind_up, 5.0 * wind_up, log=True),
            ),
            put_soft, "T_S = K Delta - a K w tanh(Delta/w)", (0.02, 0.1, 0.3),
            tuple((share * wind_up,) for share in (0.15, 0.6)), ("hammer", "torque-sweep"), ("backlash",),
        )
    )  # fmt: skip
    return [*found, *_structural(problem, j), *_loops(problem, j)]


def _structural(problem: ArmProblem, j: int) -> list[EffectSpec]:
    """A loss per cycle: what damps a resonance, eta K/w, goes with its frequency, by which postures tell it from c."""
    springs = [r for r in problem.arm_runs if problem.mask(r)[j]]
    felt = [float(r.plant.mass[0, j, j]) for r in springs]
    if max(felt) < UNLIKE_POSTURES * min(felt):
        return []

    def put(assembly: ArmAssembly, values: Values) -> None:
        P, inertia = assembly.P, float(assembly.run.plant.mass[0, j, j])
        P[j, kernel.DAMPING] += values[0] * math.sqrt(P[j, kernel.STIFFNESS] * inertia)

    return [
        arm_law(
            "structural-damping", "transmission", problem.facts.joints[j], "at-resonance", "dissipative",
            (ParameterSpec("loss_factor", "1", 0.0, 0.5, null=0.0),), put,
            "K (1 + i loss_factor), as it damps the joint's own resonance in each posture: c + loss_factor K/w",
            (0.003, 0.02, 0.08), ((),), ("hammer", "torque-sweep"), ("hysteresis",),
        )
    ]  # fmt: skip


def _loops(problem: ArmProblem, j: int) -> list[EffectSpec]:
    joint = problem.facts.joints[j]
    wind_up, K = max(float(problem.wind_up[j]), 1e-9), float(problem.facts.stiffness[j])
    top = K * wind_up
    starts = tuple((0.03 * top / (share * wind_up),) for share in (0.02, 0.1, 0.4, 1.2))
    found = []
    for variant, slips, law in (
        ("dahl", 0.0, "K Delta + T z, z' = (1 - z sgn Delta') Delta' stiffness/T"),
        ("maxwell-slip", 1.0, "K Delta + T z, z of four equal springs that slip one after the other"),
    ):

        def put(assembly: ArmAssembly, values: Values, slips: float = slips) -> None:
            torque, stiffness = values
            assembly.P[j, kernel.LOOP_TORQUE] = torque
            assembly.P[j, kernel.LOOP_ANGLE] = max(torque / stiffness, 1e-15)
            assembly.P[j, kernel.LOOP_SLIPS] = slips

        spec = arm_law(
            "hysteresis", "transmission", joint, variant, "hysteretic", (
                ParameterSpec("torque", "N m", 0.0, 2.0 * top, null=0.0),
                ParameterSpec("stiffness", "N m/rad", 1e-4 * K, 3.0 * K, log=True),
            ), put, law, (0.005 * top, 0.03 * top, 0.12 * top), starts, ("hammer", "torque-sweep"),
            ("coulomb-friction", "stiffness-nonlinearity", "backlash"),
        )  # fmt: skip
        found.append(replace(spec, proportional=(1,), decades=2))
    return found


def neighbour_laws(problem: ArmProblem, j: int) -> list[EffectSpec]:
    joint, inertia = problem.facts.joints[j], float(problem.locked_inertia[j])

    def put(assembly: ArmAssembly, values: Values) -> None:
        frequency, ratio, of_file = values
        if not math.isfinite(frequency):
            return
        own = inertia * of_file
        K = own * (2.0 * math.pi * frequency) ** 2
        assembly.elastic = assembly.elastic.copy()
        assembly.elastic[j] = True
        assembly.P[j, kernel.STIFFNESS] = K
        assembly.P[j, kernel.DAMPING] = 2.0 * ratio * math.sqrt(K * own)
        added = list(assembly.links.added)
        added[j] += own - inertia
        assembly.links = replace(assembly.links, added=tuple(added))

    return [
        arm_law(
            "neighbour-flexibility",
            "neighbour",
            joint,
            f"reducer, from {tried:g} Hz",
            "mode",
            (
                ParameterSpec("frequency", "Hz", 2.0, HIGHEST, log=True, null=math.inf),
                ParameterSpec("damping", "1", 0.002, 0.5, log=True),
                ParameterSpec("link_inertia", "1", 0.4, 2.5, log=True),
            ),
            put,
            "a reducer between the links: K_j = M_jj (2 pi f)^2, f with every other joint rigid; M_jj over the file's",
            (2.0 * tried, tried, 0.6 * tried),
            ((0.03, 1.0),),
            ("hammer", "torque-sweep", "speed-motion"),
            ("link-flexibility",),
        )
        for tried in TRIED
    ]


def _mount(problem: ArmProblem) -> list[EffectSpec]:
    mass = problem.arm_runs[0].plant.mass[0][-2:, -2:]

    def put(assembly: ArmAssembly, values: Values) -> None:
        frequency, ratio, depth, heavier = values
        if not math.isfinite(frequency):
            return
        lever = np.array([1.0, depth])
        inertia = float(lever @ mass @ lever) * (1.0 + heavier)
        K = inertia * (2.0 * math.pi * frequency) ** 2
        assembly.mount = Mount(depth, heavier)
        assembly.P[-1, kernel.STIFFNESS] = K
        assembly.P[-1, kernel.DAMPING] = 2.0 * ratio * math.sqrt(K * inertia)

    return [
        arm_law(
            "base-compliance", "base", None, f"mount, from {tried:g} Hz", "mode",
            (
                ParameterSpec("frequency", "Hz", 2.0, HIGHEST_MOUNT, log=True, null=math.inf),
                ParameterSpec("damping", "1", 0.002, 0.5, log=True),
                ParameterSpec("depth", "m", -2.0, 2.0),
                ParameterSpec("mount_inertia", "1", 0.0, 20.0),
            ),
            put,
            "the arm, its joints rigid, turns at f about an axis under its origin; the mount's inertia over the arm's",
            (2.0 * tried, tried, 0.6 * tried), tuple((0.03, depth, 0.3) for depth in DEPTHS),
            ("hammer", "torque-sweep", "speed-motion"), ("neighbour-flexibility",),
        )
        for tried in TRIED
    ]  # fmt: skip


@payloads.register(ArmProblem)
def arm_payloads(problem: ArmProblem) -> tuple[EffectSpec, ...]:
    """What the last link carries in some runs, by what it adds to the tested joint's inertia, without and with its weight."""
    j, n = problem.facts.tested, len(problem.facts.joints)
    link = float(problem.arm_runs[0].plant.shares[0, n - 1, j, j])
    inertia = float(problem.locked_inertia[j])
    if len(problem.runs) < 2 or not link > LEAST * inertia:
        return ()

    def carries(assembly: object, values: Values, weight: float) -> None:
        arm = cast("ArmAssembly", assembly)
        more = weight * values[0] / link
        arm.links = replace(arm.links, carried=(more, more * values[1] if len(values) > 1 else 0.0))

    added = ParameterSpec("inertia", "kg m^2", -0.6 * inertia, 3.0 * inertia, null=0.0)
    heavy = ParameterSpec("weight_share", "1", 0.0, 5.0)
    light = EffectSpec(
        name="payload", location=cast("Location", f"load{SEPARATOR}{problem.facts.joints[j]}"), variant="some-runs",
        family="inertia", exact=True, parameters=(added,), law="the last link's inertia times more in the loaded runs",
        revealed_by=("hammer", "torque-sweep", "speed-motion"), look_alikes=("torque-gain",), apply=carries,
        scale=lambda problem: (0.01 * inertia, 0.05 * inertia, 0.2 * inertia), starts=one_start,
        possible=lambda problem: None,
    )  # fmt: skip
    if problem.rig.plane != "vertical" or all(r.driven < 0 for r in problem.arm_runs):
        return (light,)
    lifted = replace(
        light, variant="lifted", parameters=(added, heavy), starts=lambda problem: ((1.0,),),
        law="the same, and the last link's weight times weight_share of that",
    )  # fmt: skip
    return light, lifted


def _drive(problem: ArmProblem, j: int) -> list[EffectSpec]:
    joint = problem.facts.joints[j]

    def put_gain(assembly: ArmAssembly, values: Values) -> None:
        if assembly.run.driven == j:
            assembly.gain = values[0]

    def put_lag(assembly: ArmAssembly, values: Values) -> None:
        if assembly.run.driven == j:
            assembly.lag = values[0]

    return [
        arm_law(
            "torque-gain", "motor", joint, "factor", "input", (ParameterSpec("gain", "1", 0.5, 1.8, null=1.0),),
            put_gain, "n T_e times gain", (1.01, 1.05, 1.2), ((),), ("torque-sweep", "speed-motion"), ("sensor-gain",),
        ),
        arm_law(
            "drive-lag", "motor", joint, "first-order", "input",
            (ParameterSpec("time_constant", "s", 0.0, 0.02, null=0.0),), put_lag,
            "n T_e behind a first-order lag", (2e-4, 1e-3, 4e-3), ((),), ("torque-sweep",), ("delay",),
        ),
    ]  # fmt: skip


@catalogue.register(ArmProblem)
def arm_catalogue(problem: ArmProblem) -> tuple[EffectSpec, ...]:
    """Every law at every joint that these recordings can show it at."""
    found: list[EffectSpec] = []
    runs = problem.arm_runs
    for j in np.flatnonzero(problem.seen):
        springs = [r for r in runs if problem.mask(r)[j]]
        if any(r.kinds[j] != kernel.BRAKED for r in springs) and problem.rotor_speed[j] > MICRO:
            found.extend(_friction(problem, int(j)))
        if springs and problem.wind_up[j] > 0.0:
            found.extend(_transmission(problem, int(j)))
        if len(springs) < len(runs) and not springs:
            found.extend(neighbour_laws(problem, int(j)))
        if any(r.driven == j for r in runs):
            found.extend(_drive(problem, int(j)))
            found.extend(weights(problem, int(j), _reach(problem, int(j))))
            found.extend(lines(problem, int(j), _reach(problem, int(j))))
    return (*found, *_mount(problem), *recorder_faults(problem))
