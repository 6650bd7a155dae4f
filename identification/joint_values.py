"""From modes to the joint's J_L, K and c: gravity and the load's own damping taken off, units spelled out."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from jointscope.identification.direct_parametric import ParametricFit
from jointscope.identification.intervals import Estimate, Uncertainty, logarithmic
from jointscope.identification.modal_model import ModalModel
from jointscope.identification.result import Mode, Refused
from jointscope.recordings.campaign import Nameplate

Real = NDArray[np.float64]

WIDEST = 0.5  # half a 95 % interval over the value above which a parameter is refused


@dataclass(frozen=True, kw_only=True)
class Units:
    """Units of inertia, stiffness and damping."""

    inertia: str
    stiffness: str
    damping: str


def units(rig: Nameplate, input_unit: str) -> Units:
    """Absolute units, or per unit of an input whose scale is unknown."""
    turning = rig.motion == "rotational"
    force = "N m" if turning else "N"
    base = Units(
        inertia="kg m^2" if turning else "kg",
        stiffness="N m/rad" if turning else "N/m",
        damping="N m s/rad" if turning else "N s/m",
    )
    if input_unit == force:
        return base
    per = f" per ({force} per {input_unit})"
    return Units(inertia=base.inertia + per, stiffness=base.stiffness + per, damping=base.damping + per)


@dataclass(frozen=True, kw_only=True, eq=False)
class ModeGradients:
    """Gradients of logarithms in ``model.vector()``, shape (p,), for one mode; b1 combined over the outputs."""

    a1: Real
    a2: Real
    b1: Real
    log_b1: float
    sign: float
    disagreement: float


def gradients(fit: ParametricFit, of: Uncertainty, mode: int) -> ModeGradients:
    """Logarithmic gradients of a1, a2 and of the outputs' best common b1 (generalised least squares over outputs)."""
    model = fit.model
    n, outputs = model.modes, model.outputs
    p = model.vector().size
    a1, a2 = np.zeros(p), np.zeros(p)
    a1[mode], a2[n + mode] = 1.0 / model.a1[mode], 1.0 / model.a2[mode]
    values = model.b1[:, mode]
    each = np.zeros((outputs, p))
    for o in range(outputs):
        each[o, 2 * n + o * n + mode] = 1.0 / values[o]
    logs = np.log(np.abs(values))
    covariance = each @ of.model @ each.T
    weight = np.linalg.pinv(covariance) @ np.ones(outputs)
    weight = weight / weight.sum() if outputs > 1 else np.ones(1)
    mean = float(weight @ logs)
    spread = np.abs(logs - mean) if outputs > 1 else np.zeros(1)
    return ModeGradients(
        a1=a1,
        a2=a2,
        b1=weight @ each,
        log_b1=mean,
        sign=float(np.sign(values[0])),
        disagreement=float(spread.max()),
    )


def mode_estimates(fit: ParametricFit, of: Uncertainty) -> tuple[Mode, ...]:
    """Frequency and damping ratio of every mode with intervals, by rising frequency."""
    model, rows = fit.model, []
    for mode in range(model.modes):
        own = gradients(fit, of, mode)
        frequency = float(model.natural_frequency[mode] / (2.0 * math.pi))
        rows.append(
            Mode(
                frequency=logarithmic(frequency, 0.5 * own.a2, "Hz", of),
                damping_ratio=logarithmic(float(model.damping_ratio[mode]), own.a1 - 0.5 * own.a2, "1", of),
                b1=tuple(float(value) for value in model.b1[:, mode]),
            )
        )
    return tuple(sorted(rows, key=lambda row: row.frequency.value))


def main_mode(fit: ParametricFit) -> int:
    """The mode with the largest share of the static compliance b1/a2 of the first output."""
    return main_mode_of(fit.model)


def main_mode_of(model: ModalModel) -> int:
    """As ``main_mode``, of a model."""
    return int(np.argmax(np.abs(model.b1[0] / model.a2)))


def joint_estimates(
    fit: ParametricFit, of: Uncertainty, rig: Nameplate, unit: Units, gravity: float | None
) -> tuple[dict[str, Estimate], list[Refused], list[str]]:
    """J_L, K, c of the main mode (paper, Equation 21), what is refused, and notes.

    ``gravity`` is K_g [N m/rad] or ``None`` where the nameplate doesn't say.
    """
    mode = main_mode(fit)
    own = gradients(fit, of, mode)
    b1 = math.exp(own.log_b1)
    refused: list[Refused] = []
    notes: list[str] = []
    found: dict[str, Estimate] = {}
    if own.sign < 0.0:
        notes.append(
            "input and output have opposite signs: one of them is inverted; values are given for the turned sign"
        )
    found["inertia"] = logarithmic(1.0 / b1, -own.b1, unit.inertia, of)
    total = logarithmic(float(fit.model.a2[mode]) / b1, own.a2 - own.b1, unit.stiffness, of)
    if gravity is None:
        found["stiffness_total"] = total
        refused.append(
            Refused(
                parameter="stiffness",
                reason="gravity's share is unknown: give rig.arm_mass and rig.arm_com_radius; K with it is stiffness_total",
            )
        )
    else:
        found["stiffness"] = shifted(total, -gravity)
    damping = logarithmic(float(fit.model.a1[mode]) / b1, own.a1 - own.b1, unit.damping, of)
    _damping(damping, rig, found, refused, notes)
    return found, refused, notes


def _damping(
    total: Estimate, rig: Nameplate, found: dict[str, Estimate], refused: list[Refused], notes: list[str]
) -> None:
    """c alone where b_l can be taken off, else c + b_l."""
    found["damping_total"] = total
    if rig.load_damping is not None:
        found["damping"] = shifted(total, -rig.load_damping, sd=0.5 * rig.load_damping)
        notes.append(
            f"damping is c alone: the nameplate's load_damping, {rig.load_damping:g} +- {0.5 * rig.load_damping:g} "
            f"{total.unit} (one standard deviation, a starting value), is taken off damping_total"
        )
    elif rig.topology == "single-dof":
        found["damping"] = total
    else:
        refused.append(
            Refused(
                parameter="damping",
                reason="with the motor braked only c + b_l shows (damping_total); give rig.load_damping to part them",
            )
        )


def shifted(of: Estimate, by: float, sd: float = 0.0) -> Estimate:
    """The estimate plus a constant known to ``sd``."""
    more = float(stats.norm.ppf(0.975)) * sd

    def moved(ends: tuple[float, float]) -> tuple[float, float]:
        low, high = of.value - ends[0], ends[1] - of.value
        return of.value + by - math.hypot(low, more), of.value + by + math.hypot(high, more)

    low, high = moved((of.low, of.high))
    return replace(
        of,
        value=of.value + by,
        sd=math.hypot(of.sd, sd),
        low=low,
        high=high,
        model=moved(of.model),
        repeats=None if of.repeats is None else moved(of.repeats),
    )


def sift(parameters: Mapping[str, Estimate], hits: int) -> tuple[dict[str, Estimate], list[Refused]]:
    """Take out what the data can't carry: a single hit's absolute values, and intervals wider than half the value."""
    kept, refused = {}, []
    for name, estimate in parameters.items():
        half = 0.5 * (estimate.high - estimate.low)
        if hits < 2:
            refused.append(
                Refused(
                    parameter=name,
                    reason=f"one usable hit: its gain error can't be told from the value ({estimate.value:.4g} "
                    f"{estimate.unit} by this hit); record at least three",
                )
            )
        elif not half <= WIDEST * abs(estimate.value):
            refused.append(
                Refused(
                    parameter=name,
                    reason=f"the 95 % interval {estimate.low:.3g} to {estimate.high:.3g} {estimate.unit} is wider than "
                    f"half the value {estimate.value:.3g}; more or harder hits would narrow it",
                )
            )
        else:
            kept[name] = estimate
    return kept, refused
