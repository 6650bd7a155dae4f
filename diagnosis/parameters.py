"""The base model's parameters: which these recordings can move, their rough values, bounds and sizes."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis.acquisition import carries
from jointscope.diagnosis.assembly import BASE_INDEX, BASE_NAMES
from jointscope.models.parameters import STANDARD_GRAVITY

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from jointscope.diagnosis.problem import BaseSpec, PreparedRun
    from jointscope.recordings.campaign import Nameplate

MAKERS_FIGURE = 4.0  # times K and J_L on the nameplate beyond which a start that no hit gave is not believed
ZERO_OFF = 0.03  # of the largest logged torque, by which the zero of a calibrated log may be off
AGE = 6.25e-5  # s by which a torque may act beside its log's clock: one cycle of a drive's current loop at 16 kHz
HALF = 0.5  # of a log's sample, to which its clock's start is found
OVERDAMPED = 0.5  # of the critical damping, beyond which no reducer is


def torque_calibrated(runs: tuple[PreparedRun, ...]) -> bool:
    """Whether a torque or force is known in SI anywhere: what drives a run, or what answers a motion that is prescribed."""
    return any(
        (run.load is not None and run.load.calibrated)
        or (run.motor is not None and run.motor.calibrated)
        or any(o.calibrated and run.takes(o) for o in run.outputs)
        for run in runs
    )


def zero_near(runs: tuple[PreparedRun, ...]) -> bool:
    """Whether the input's zero is off by no more than ``ZERO_OFF`` of the largest torque: a calibrated log of a motor."""
    return all(run.motor is None or run.motor.calibrated for run in runs) and not any(carries(run) for run in runs)


def _age(runs: tuple[PreparedRun, ...]) -> float:
    """Of a torque [s]: where a clock's start is found from the runs, beside another's, it is found to half a log's sample."""
    found = [
        HALF / run.motor.signal.rate
        for run in runs
        if run.motor is not None
        and len(run.run.streams) > 1
        and any(stream.start_uncertainty > 0.0 for stream in run.run.streams)
    ]
    return max((AGE, *found))


def _weighed(run: PreparedRun) -> bool:
    """Whether a run says what the arm weighs: something moves the arm or holds it up, and that is known."""
    pushed = run.load is not None and run.mode != "braked"
    return run.mode == "prescribed-load" or run.motor is not None or run.command is not None or pushed


def base_spec(rig: Nameplate, runs: tuple[PreparedRun, ...]) -> BaseSpec:
    """Which parameters these recordings can move, from the nameplate alone for now."""
    from jointscope.diagnosis.problem import BaseSpec

    moving = any(run.motor_moves for run in runs)
    answered = moving or any(run.answers for run in runs)
    driven = any(run.motor is not None for run in runs)
    swung = any(run.mode != "braked" for run in runs)
    springs = any(run.spring for run in runs)
    exact = rig.motor_inertia is not None and rig.reducer_inertia is not None
    load_known = any(run.load is not None and run.load.calibrated for run in runs)
    motor_known = any(run.motor is not None and run.motor.calibrated for run in runs)
    unknown = known_inertia(rig) or 1.0  # a desk's joint is a thousandth of a robot's, and its motor as well
    J_L = rig.inertia_reference or (
        1.3 * rig.arm_mass * (rig.arm_com_radius or 0.5) ** 2 if rig.arm_mass is not None else unknown
    )
    if rig.motion == "translational":
        J_L = rig.inertia_reference or rig.arm_mass or unknown
    J_M = known_inertia(rig) or J_L
    K = rig.stiffness_reference or J_L * (2.0 * math.pi * 30.0) ** 2
    c = rig.damping_reference or 2.0 * 0.03 * math.sqrt(K * J_L)
    weight = 0.0
    gravity_free = False
    if rig.plane == "vertical":
        if rig.motion == "translational":
            weight = (rig.arm_mass or 0.0) * STANDARD_GRAVITY
        elif rig.arm_mass is not None and rig.arm_com_radius is not None:
            weight = rig.arm_mass * STANDARD_GRAVITY * rig.arm_com_radius
        else:
            gravity_free = swung and any(map(_weighed, runs))
    # the torque's way to the arm is known once an inertia is absolute: the arm's by a hammer, or the motor's where its
    # own motion shows resonance and antiresonance, which give the ratio of the two
    swept = exact and any(
        run.motor_moves
        and run.run.experiment == "torque-sweep"
        and any(o.location == "motor" for o in run.outputs)
        for run in runs
    )
    efficiency_free = rig.efficiency is None and driven and motor_known and moving and (load_known or swept)
    scale_free = driven and not motor_known and (load_known or (exact and moving))
    near_weight = motor_known and gravity_free  # a calibrated zero is off by less than a weight that nobody knows
    start = {
        "stiffness": K,
        "damping": c,
        "load_inertia": J_L,
        "motor_inertia": J_M,
        "motor_damping": rig.motor_damping if rig.motor_damping is not None else 0.0,
        "load_damping": rig.load_damping if rig.load_damping is not None else 0.0,
        "gravity_moment": weight,
        "efficiency": rig.efficiency or 1.0,
        "torque_scale": 1.0,
        "torque_offset": 0.0,
        "torque_age": 0.0,
        "drive_gain": (J_M + J_L) * 60.0,
        "drive_integral": (J_M + J_L) * 60.0 * 6.0,
        "drive_acceleration": 0.0,
        "drive_velocity": 0.0,
        "drive_limit": 0.0,
        "drive_trust": 0.0,
    }
    free = {
        "stiffness": springs,
        "damping": springs,
        "load_inertia": True,
        "motor_inertia": answered and not exact,
        "motor_damping": answered,
        "load_damping": swung,
        "gravity_moment": gravity_free,
        "efficiency": efficiency_free,
        "torque_scale": scale_free,
        # nobody knows an uncalibrated channel's zero, nor that of the amplifier that drives a carriage; a log's is off a little
        "torque_offset": (driven and swung and not near_weight) or any(carries(run) for run in runs),
        # nobody samples, holds and stamps to the last microsecond
        "torque_age": any(run.motor is not None and run.motor_moves for run in runs),
    }
    merged = {} if swung or not springs else {"damping": "damping_total"}
    if merged:
        start["damping"] += start["load_damping"]
        start["load_damping"] = 0.0
    nuisance = {name for name in BASE_NAMES if name.startswith(("drive_", "torque_"))}
    values = np.array([start[name] for name in BASE_NAMES])
    return BaseSpec(
        names=BASE_NAMES,
        start=values,
        lower=np.zeros(values.size),
        upper=np.full(values.size, np.inf),
        scale=np.ones(values.size),
        free=np.array([free.get(name, False) for name in BASE_NAMES]),
        nuisance=np.array([name in nuisance for name in BASE_NAMES]),
        merged=merged,
    )


def assumptions(rig: Nameplate, base: BaseSpec, runs: tuple[PreparedRun, ...]) -> tuple[str, ...]:
    """What had to be assumed because neither the nameplate nor the recordings say it, one line each."""
    lines = []
    driven = any(run.motor_moves and run.motor is not None and run.motor.calibrated for run in runs)
    if driven and rig.efficiency is None and not base.free[BASE_INDEX["efficiency"]]:
        lines.append(
            "efficiency: not on the nameplate and not identifiable here; 1 assumed, stiffness and inertia scale with it"
        )
    absolute = any(run.load is not None and run.load.calibrated for run in runs)
    if base.free[BASE_INDEX["motor_inertia"]] and not absolute:
        missing = "the reducer's part is not" if rig.motor_inertia is not None else "not"
        lines.append(
            f"motor inertia: {missing} on the nameplate; without a hammer only its ratio to the arm's may be identifiable"
        )
    return tuple(lines)


def known_inertia(rig: Nameplate) -> float:
    """What the nameplate says of the motor side's inertia, at the output [kg m^2]; the reducer's may be missing."""
    n = rig.reduction_ratio or 1.0
    return ((rig.motor_inertia or 0.0) + (rig.reducer_inertia or 0.0)) * n * n


def stated_figures(rig: Nameplate) -> dict[str, float]:
    """K and J_L as the nameplate states them, where it does."""
    figures = {"stiffness": rig.stiffness_reference, "load_inertia": rig.inertia_reference}
    return {name: value for name, value in figures.items() if value is not None}


def beyond_nameplate(start: NDArray[np.float64], runs: tuple[PreparedRun, ...], rig: Nameplate) -> bool:
    """Whether a start, shape (n_theta,), that no hit gave lies beyond what a maker may be off by; in SI only."""
    if any(run.mode == "braked" for run in runs) or not torque_calibrated(runs):
        return False
    return any(
        abs(math.log(value / start[BASE_INDEX[name]])) > math.log(MAKERS_FIGURE)
        for name, value in stated_figures(rig).items()
    )


def near_nameplate(base: BaseSpec, runs: tuple[PreparedRun, ...], rig: Nameplate) -> BaseSpec:
    """The same, started from the nameplate where motions alone gave a start beyond what a maker may be off by.

    A motion shows little more than the ratio of K and J_L, and a sensor's fault makes that ratio look like another
    joint's: where one of them only is stated, the other keeps the ratio. A hit gives both, whatever the nameplate says: its
    figures are starts, never bounds.
    """
    if not beyond_nameplate(base.start, runs, rig):
        return base
    apart = {name: value / base.start[BASE_INDEX[name]] for name, value in stated_figures(rig).items()}
    start = base.start.copy()
    for name in ("stiffness", "load_inertia"):
        start[BASE_INDEX[name]] *= apart.get(name, next(iter(apart.values())))
    if rig.damping_reference is not None:
        start[BASE_INDEX["damping"]] = rig.damping_reference
    return replace(base, start=start)


def bounded(base: BaseSpec, runs: tuple[PreparedRun, ...], rig: Nameplate) -> BaseSpec:
    """Bounds and scales around the start values: dampings may vanish, inertias and stiffness stay positive.

    In motions alone friction passes for inertia, 25 times the arm's own; there it stays within what a maker may be off by.
    """
    base = near_nameplate(base, runs, rig)
    b = dict(zip(BASE_NAMES, base.start, strict=True))
    critical = 2.0 * math.sqrt(b["stiffness"] * b["load_inertia"])
    largest = max((float(np.max(np.abs(run.motor_half))) for run in runs if run.motor is not None), default=0.0)
    carried = max((float(np.max(np.abs(run.load_half))) for run in runs if carries(run)), default=0.0)
    scale = {
        "stiffness": b["stiffness"],
        "damping": max(b["damping"], 0.02 * critical),
        "load_inertia": b["load_inertia"],
        "motor_inertia": b["motor_inertia"],
        "motor_damping": max(b["motor_damping"], 0.02 * critical),
        "load_damping": max(b["load_damping"], 0.02 * critical),
        "gravity_moment": max(abs(b["gravity_moment"]), 2.0 * b["load_inertia"]),
        "efficiency": 1.0,
        "torque_scale": b["torque_scale"],
        # its difference is taken of the whole torque: friction holds against less
        "torque_offset": max(largest, carried, 1e-12),
        "torque_age": 2e-3,
        "drive_gain": b["drive_gain"],
        "drive_integral": max(b["drive_integral"], b["drive_gain"]),
        "drive_acceleration": b["motor_inertia"] + b["load_inertia"],
        "drive_velocity": b["drive_gain"],
        "drive_limit": max(largest, 1e-12),
        "drive_trust": 1.0,
    }
    scales = np.array([scale[name] for name in BASE_NAMES])
    lower, upper = np.zeros(scales.size), np.full(scales.size, np.inf)
    for name in ("stiffness", "load_inertia", "motor_inertia", "torque_scale", "efficiency", "drive_gain"):
        i = BASE_INDEX[name]
        lower[i], upper[i] = 0.02 * base.start[i], 50.0 * base.start[i]
    weighed = torque_calibrated(runs) and not any(run.mode == "braked" for run in runs)
    if (
        weighed and rig.inertia_reference is not None
    ):  # in SI only: per unit of an unknown input it may be anything
        i = BASE_INDEX["load_inertia"]
        lower[i], upper[i] = rig.inertia_reference / MAKERS_FIGURE, rig.inertia_reference * MAKERS_FIGURE
    upper[BASE_INDEX["efficiency"]] = 2.0
    i = BASE_INDEX["motor_inertia"]
    lower[i] = max(lower[i], min(known_inertia(rig), base.start[i]))
    for name in ("damping", "motor_damping", "load_damping", "drive_integral"):
        upper[BASE_INDEX[name]] = 1e3 * scale[name]
    if b["damping"] > 0.0:
        upper[BASE_INDEX["damping"]] = max(OVERDAMPED * critical, 10.0 * b["damping"])
    for name in ("gravity_moment", "torque_offset"):
        i = BASE_INDEX[name]
        lower[i], upper[i] = -1e3 * scales[i], 1e3 * scales[i]
    age = _age(runs)
    lower[BASE_INDEX["torque_age"]], upper[BASE_INDEX["torque_age"]] = -age, age
    if zero_near(runs):
        lower[i], upper[i] = -ZERO_OFF * largest, ZERO_OFF * largest
    return replace(base, scale=scales, lower=lower, upper=upper)
