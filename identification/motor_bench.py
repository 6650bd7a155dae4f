"""Motor bench: the drive's torque or current in, the motion of motor and load out -> the two-inertia joint.

What the input's unknown scale allows is identified per unit of it; a known motor inertia gives the scale after all.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from jointscope.errors import RefusedError
from jointscope.identification.conditioning import Response, arm_responses
from jointscope.identification.intervals import Estimate
from jointscope.identification.joint_values import WIDEST, Units, units
from jointscope.identification.model_file import BaseModel, joint_values
from jointscope.identification.response_estimate import Responses, estimate_responses
from jointscope.identification.result import Identification, MatrixFit, Mode, Refused
from jointscope.identification.two_inertia import PARAMETERS, TwoInertiaFit, fit_two_inertia, fitted
from jointscope.recordings.bandlimited import resampled
from jointscope.recordings.campaign import Nameplate, Run, Signal
from jointscope.recordings.motor_torque import motor_torque

Real = NDArray[np.float64]

_MOTOR_ORDER = {"angle": 0, "angular-velocity": 1, "angular-acceleration": 2, "position": 0, "velocity": 1}
_PREFERRED = ("angle", "position", "angular-velocity", "velocity", "angular-acceleration", "linear-acceleration",
              "acceleration")  # fmt: skip


@dataclass(frozen=True, kw_only=True, eq=False)
class _Side:
    name: str
    order: int
    signal: Signal
    response: Response | None


def bench_runs(runs: Sequence[Run]) -> list[Run]:
    """Runs with a free motor, a motor input and at least one output of motor or load."""
    found = []
    for run in runs:
        if run.brake or run.experiment in ("hammer", "speed-motion"):
            continue
        drive = [
            s for s in run.select(location="motor") if s.channel.quantity in ("torque", "current", "phase-current")
        ]
        if drive and any(s.channel.quantity in _PREFERRED for s in run.select(role="output")):
            found.append(run)
    return found


def identify_bench(runs: Sequence[Run], rig: Nameplate) -> Identification:
    """Identify the two-inertia joint from all ``runs`` together.

    Raises:
        RefusedError: Too little was recorded or excited.
    """
    first_sides, unit, _ = _read(runs[0], rig)
    names = tuple(side.name for side in first_sides)
    responses = []
    for run in runs:
        sides, own_unit, answer = _read(run, rig)
        if tuple(side.name for side in sides) == names and own_unit == unit:
            responses.append(answer)
    known: dict[int, float] = {}
    absolute = unit in ("N m", "N")
    J_M = _motor_inertia(rig)
    if absolute and J_M is not None:
        known[0] = J_M
    fit = fit_two_inertia(responses, names, known)
    notes = _notes(fit, first_sides, rig)
    scale = 1.0
    if not absolute and J_M is not None:
        scale = J_M / float(fit.joint.values[0])
        notes.append(
            f"the input's scale follows from the motor's inertia: {scale:.4g} N m at the output per {unit}"
        )
    shown = units(rig, "N m" if rig.motion == "rotational" else "N") if scale != 1.0 else units(rig, unit)
    parameters, refused = _parameters(fit, shown, scale, absolute or scale != 1.0, unit)
    matrix = _matrix(fit, names, responses, first_sides)
    return Identification(
        method=f"two-inertia joint fitted to {len(names)} responses over {len(responses)} run"
        f"{'s' if len(responses) > 1 else ''}: {responses[0].averages} "
        + (f"periods of {responses[0].period} samples" if responses[0].period else "segments"),
        band=(float(responses[0].frequency[0]), float(responses[0].frequency[-1])),
        parameters=parameters,
        modes=_modes(fit),
        refused=tuple(refused),
        notes=tuple(notes),
        base=_base(fit, rig, scale, unit if scale == 1.0 and not absolute else "N m"),
        response=matrix,
    )


def bench_responses(run: Run, rig: Nameplate) -> tuple[tuple[str, ...], Responses]:
    """Sides recorded (``motor``, ``load``) and their accelerations per generalised torque, of one run.

    Raises:
        RefusedError: Too little was recorded or excited.
    """
    sides, _, responses = _read(run, rig)
    return tuple(side.name for side in sides), responses


def _motor_inertia(rig: Nameplate) -> float | None:
    if rig.motor_inertia is None:
        return None
    return (rig.motor_inertia + (rig.reducer_inertia or 0.0)) * (rig.reduction_ratio or 1.0) ** 2


def _read(run: Run, rig: Nameplate) -> tuple[list[_Side], str, Responses]:
    drive = motor_torque(run, rig)
    if drive is None or not drive.signed:
        raise RefusedError(
            f"run {run.id}: the motor's torque has no sign in this recording; record all three phases and the angle"
        )
    sides = _sides(run, rig)
    if not sides:
        raise RefusedError(f"run {run.id}: neither the motor's nor the load's motion was recorded")
    rows = [
        side.signal.samples
        if side.signal.device == drive.source.device
        else resampled(side.signal.samples, side.signal.sampling_rate, side.signal.stream.start, drive.times)
        for side in sides
    ]
    found = estimate_responses(
        drive.values, np.array(rows), drive.sampling_rate, tuple(side.order for side in sides)
    )
    ratio, efficiency = rig.reduction_ratio or 1.0, rig.efficiency or 1.0
    s = 2j * np.pi * found.frequency
    factors = []
    for side in sides:
        if side.response is None:
            factors.append(np.full(s.shape, 1.0 / ratio, dtype=complex))
        else:
            factors.append(1.0 / (side.response.sensor(s) * s ** (2 - side.order)))
    factor = np.array(factors) / (ratio * efficiency)
    unit = drive.unit if drive.unit != "1" else "input unit"
    return (
        sides,
        unit,
        Responses(
            frequency=found.frequency,
            values=found.values * factor,
            deviation=found.deviation * np.abs(factor),
            averages=found.averages,
            period=found.period,
        ),
    )


def _sides(run: Run, rig: Nameplate) -> list[_Side]:
    """One signal of the motor and one of the load, angles before speeds before accelerations."""
    found = []
    motor = [s for s in run.select(location="motor", role="output") if s.channel.quantity in _MOTOR_ORDER]
    if motor:
        best = min(motor, key=lambda s: _PREFERRED.index(s.channel.quantity))
        found.append(_Side(name="motor", order=_MOTOR_ORDER[best.channel.quantity], signal=best, response=None))
    load = arm_responses(run, rig)
    if load:
        chosen = min(load, key=lambda r: _PREFERRED.index(r.signal.channel.quantity))
        found.append(_Side(name="load", order=chosen.order, signal=chosen.signal, response=chosen))
    return found


def _notes(fit: TwoInertiaFit, sides: Sequence[_Side], rig: Nameplate) -> list[str]:
    notes = [
        f"{side.signal.channel.column} moves against the input at low frequency: its sign (or the input's) is inverted; "
        "the fit turned it"
        for side, sign in zip(sides, fit.signs, strict=True)
        if sign < 0.0
    ]
    if rig.reduction_ratio is None:
        notes.append("no reduction_ratio is given: everything is referred to the motor's shaft as if n = 1")
    notes.append(
        f"what the linear joint leaves: {100.0 * fit.share:.1f} % typically; RMS of ln|fitted/measured| "
        + ", ".join(f"{error:.3f} ({side.name})" for side, error in zip(sides, fit.log_errors, strict=True))
    )
    late = ", ".join(f"{1e6 * delay:.0f} us ({side.name})" for side, delay in zip(sides, fit.delays, strict=True))
    notes.append(f"outputs late against the input by {late}")
    return notes


def _estimate(fit: TwoInertiaFit, quantity: Callable[[Real], float], unit: str, scale: float = 1.0) -> Estimate:
    """A positive function of the joint's values, its interval from the logarithm's gradient by differences."""
    values = fit.joint.values
    centre = quantity(values)
    gradient = np.zeros(len(fit.free))
    for k, index in enumerate(fit.free):
        step = 1e-4
        up, down = values.copy(), values.copy()
        up[index] *= math.exp(step)
        down[index] *= math.exp(-step)
        gradient[k] = (math.log(quantity(up)) - math.log(quantity(down))) / (2.0 * step)
    with np.errstate(invalid="ignore"):
        spread = float(np.sqrt(max(np.nansum(np.outer(gradient, gradient) * fit.covariance), 0.0)))
    half = min(float(stats.t.ppf(0.975, max(fit.blocks - len(fit.free), 1))) * spread, 50.0)
    value = scale * centre
    ends = (value * math.exp(-half), value * math.exp(half))
    return Estimate(value=value, unit=unit, sd=value * spread, low=ends[0], high=ends[1], model=ends)


def _parameters(
    fit: TwoInertiaFit, unit: Units, scale: float, absolute: bool, input_unit: str
) -> tuple[dict[str, Estimate], list[Refused]]:
    kept: dict[str, Estimate] = {}
    refused: list[Refused] = []
    shown = {
        "motor_inertia_output": ("motor_inertia_output", unit.inertia),
        "load_inertia": ("inertia", unit.inertia),
        "stiffness": ("stiffness", unit.stiffness),
        "damping": ("damping", unit.damping),
        "motor_damping": ("motor_damping", unit.damping),
        "load_damping": ("load_damping", unit.damping),
    }
    for index in fit.free:
        name, spelled = shown[PARAMETERS[index]]
        found = _estimate(fit, lambda values, index=index: float(values[index]), spelled, scale)  # type: ignore[misc]
        if 0.5 * (found.high - found.low) <= WIDEST * found.value:
            kept[name] = found
        else:
            refused.append(
                Refused(
                    parameter=name,
                    reason=f"{found.low:.3g} to {found.high:.3g} {spelled} at 95 %: what the linear joint leaves over "
                    "hides it; a recording at smaller amplitude steps would part it from friction",
                )
            )
    kept["inertia_ratio"] = _estimate(fit, lambda values: float(values[1] / values[0]), "1")
    if not absolute:
        why = (
            f"the input is in {input_unit} and neither torque_constant nor motor_inertia is given: "
            f"values are per unit of torque per {input_unit}"
        )
        refused += [
            Refused(parameter=f"absolute {name}", reason=why) for name in ("stiffness", "inertia", "damping")
        ]
    return kept, refused


def _modes(fit: TwoInertiaFit) -> tuple[Mode, ...]:
    def oscillation(coefficients: Sequence[float]) -> complex:
        roots = np.roots(coefficients)
        return complex(roots[int(np.argmax(roots.imag))])

    def zero(values: Real) -> complex:
        _, J_L, K, c, _, b_l = values
        return oscillation([J_L, c + b_l, K])

    def pole(values: Real) -> complex:
        J_M, J_L, K, c, b_m, b_l = values
        return oscillation(
            [
                J_M * J_L,
                J_M * (b_l + c) + J_L * (b_m + c),
                (J_M + J_L) * K + (b_m + b_l) * c + b_m * b_l,
                K * (b_m + b_l),
            ]
        )

    rows = []
    for kind, root in (("antiresonance", zero), ("resonance", pole)):
        rows.append(
            Mode(
                kind=kind,
                frequency=_estimate(fit, lambda v, root=root: abs(root(v)) / (2.0 * math.pi), "Hz"),  # type: ignore[misc]
                damping_ratio=_estimate(fit, lambda v, root=root: -root(v).real / abs(root(v)), "1"),  # type: ignore[misc]
            )
        )
    return tuple(rows)


def _matrix(
    fit: TwoInertiaFit, names: Sequence[str], responses: Sequence[Responses], sides: Sequence[_Side]
) -> MatrixFit:
    first = responses[0]
    return MatrixFit(
        frequency=first.frequency,
        names=tuple(names),
        measured=first.values,
        deviation=first.deviation,
        fitted=fitted(fit, names, first.frequency),
        log_error=float(np.sqrt(np.nanmean(fit.log_errors**2))),
        quantities=tuple(side.signal.channel.column for side in sides),
    )


def _base(fit: TwoInertiaFit, rig: Nameplate, scale: float, input_unit: str) -> BaseModel:
    """The joint per unit of input; J_M is kept as motor inertia (less the reducer's) where it was identified."""
    values = fit.joint.values * scale
    J_M, J_L, K, c, b_m, b_l = (float(value) for value in values)
    ratio = rig.reduction_ratio or 1.0
    estimated = {"stiffness": K, "damping": c, "load_inertia": J_L, "motor_damping": b_m, "load_damping": b_l}
    names = {1: "load_inertia", 2: "stiffness", 3: "damping", 4: "motor_damping", 5: "load_damping"}
    if rig.motor_inertia is None:
        estimated["motor_inertia"] = J_M / ratio**2 - (rig.reducer_inertia or 0.0)
        names[0] = "motor_inertia"
    joint = joint_values(rig, **estimated)
    joint.setdefault("reducer_inertia", 0.0)
    joint.setdefault("reduction_ratio", ratio)
    used = [k for k, index in enumerate(fit.free) if index in names]
    held = [fit.free[k] for k in used]
    size = np.array([joint[names[index]] for index in held])
    logs = np.nan_to_num(fit.covariance[np.ix_(used, used)], posinf=1.0, neginf=-1.0)
    return BaseModel(
        rig=rig,
        joint=joint,
        parameters=tuple(names[index] for index in held),
        covariance=logs * np.outer(size, size),
        input_unit=input_unit,
    )
