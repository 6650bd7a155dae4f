"""Evidence 4: the torque through the reducer against its wind-up, one mark while it winds up, another while it unwinds."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from jointscope.diagnosis.assembly import BASE_INDEX
from jointscope.diagnosis.problem import Output, PreparedRun
from jointscope.experiments.charts.chart import Chart, Mark, Missing, Panel, Series
from jointscope.experiments.diagnosis_report.traces import Models
from jointscope.experiments.diagnosis_report.wording import ARCMIN_PER_RAD

Vector = NDArray[np.float64]
LABEL = "Torque against wind-up"
_CORNER = 2.5  # of the resonance: the arm's swing on the spring is the wind-up
_RESOLVED = 4.0  # wind-up over encoder steps that is worth a drawing
_SHOWN = 700  # marks per direction
_EDGE = 0.05  # of the record, where the filter rings
_NOT = "an angle on both sides of the reducer"


@dataclass(frozen=True, eq=False)
class Loop:
    """One run's loop.

    Attributes:
        wind_up: [rad], shape (n,).
        torque: Through the reducer [N m], shape (n,).
        winding: Whether the wind-up rises, shape (n,).
        resolution: Largest wind-up over the encoders' steps [-].
    """

    run: str
    wind_up: Vector
    torque: Vector
    winding: NDArray[np.bool_]
    resolution: float


def windup_chart(models: Models) -> Chart | Missing:
    """The loop of the run whose wind-up stands out most from its encoders' steps."""
    rig = models.problem.rig
    if rig.topology != "two-inertia" or rig.motion != "rotational":
        return Missing(LABEL, f"{_NOT}; this rig has one inertia")
    runs = [r for r in models.problem.runs if r.spring]
    sides = {o.location for r in runs for o in r.declared if o.quantity == "angle"}
    both = [r for r in runs if _angles(r) is not None]
    if not both:
        wanted = [f"an angle at the {side}" for side in ("motor", "arm") if side not in sides]
        return Missing(LABEL, " and ".join(wanted) or f"{_NOT} in one run")
    loop = max((_loop(r, models) for r in both), key=lambda found: found.resolution)
    if loop.resolution < _RESOLVED:
        reached = ARCMIN_PER_RAD * float(np.max(np.abs(loop.wind_up)))
        return Missing(
            LABEL,
            f"encoders that resolve the wind-up (at most {reached:.2g} arcmin, {loop.resolution:.1f} of their steps)",
        )
    return _drawn(loop, models)


def _angles(run: PreparedRun) -> tuple[Output, Output] | None:
    found = {}
    for o in run.declared:
        if o.quantity == "angle" and run.run.streams[o.channel[0]].channels[o.channel[1]].samples is not None:
            found[o.location] = o
    return (found["motor"], found["arm"]) if {"motor", "arm"} <= found.keys() else None


def _recorded(run: PreparedRun, output: Output) -> tuple[Vector, Vector, float]:
    """Times, angle at the joint output [rad], and the encoder's step there [rad]."""
    stream = run.run.streams[output.channel[0]]
    samples = np.asarray(stream.channels[output.channel[1]].samples, dtype=np.float64)
    good = np.isfinite(samples)
    factor = output.polarity / (run.ratio if output.location == "motor" else 1.0)
    steps = np.abs(np.diff(np.unique(samples[good])))
    smallest = float(np.min(steps[steps > 1e-12], initial=np.inf))
    return np.asarray(stream.times)[good], factor * samples[good], abs(factor) * smallest


def _loop(run: PreparedRun, models: Models) -> Loop:
    """T_S = J_L q'' + b_l q' + G cos q - T_ext on the arm, all low-passed alike with zero phase."""
    pair = _angles(run)
    assert pair is not None
    (tm, motor, step_m), (ta, arm, step_a) = (_recorded(run, o) for o in pair)
    slow = min(1.0 / np.median(np.diff(tm)), 1.0 / np.median(np.diff(ta)))
    corner = min(_CORNER * models.problem.scales.frequency, 0.2 * slow)
    t = ta[(ta >= tm[0]) & (ta <= tm[-1])]
    rate = 1.0 / float(np.median(np.diff(t)))
    sos = butter(4, corner, fs=rate, output="sos")

    def smooth(x: Vector) -> Vector:
        return np.asarray(sosfiltfilt(sos, x))

    def base(name: str) -> float:
        return float(models.base_theta[BASE_INDEX[name]])

    q = smooth(np.interp(t, ta, arm))
    w = smooth(np.interp(t, tm, motor)) - q
    v = np.gradient(q) * rate
    a = np.gradient(v) * rate
    torque = base("load_inertia") * a + base("load_damping") * v
    weight = base("gravity_moment")
    posture = run.initial_angle + q - q[0]
    torque = torque + weight * (np.cos(posture) - np.cos(run.initial_angle))
    if run.load_force is not None:
        torque = torque - smooth(np.interp(t, run.time, run.load_force))
    edge = max(1, int(_EDGE * t.size))
    part = slice(edge, t.size - edge) if run.motor_moves else slice(0, t.size)
    w = w - np.median(w[: max(8, edge)])
    size = float(np.quantile(np.abs(w[part]), 0.995))
    return Loop(
        run.run.id, w[part], torque[part], (np.gradient(w) >= 0.0)[part], size / max(step_m, step_a, 1e-15)
    )


def _drawn(loop: Loop, models: Models) -> Chart:
    size = np.abs(loop.wind_up)
    moving = np.flatnonzero(size > 0.02 * size.max())
    generator = np.random.default_rng(0)
    series = []
    directions: tuple[tuple[str, bool, Mark, str], ...] = (
        ("winding up", True, "o", "recorded"),
        ("unwinding", False, "x", "base"),
    )
    for name, wanted, mark, look in directions:
        index = moving[loop.winding[moving] == wanted]
        if index.size > _SHOWN:
            index = np.sort(generator.choice(index, _SHOWN, replace=False))
        x, y = ARCMIN_PER_RAD * loop.wind_up[index], loop.torque[index]
        series.append(Series(name=name, x=x, y=y, look=look, mark=mark))
    K = float(models.base_theta[BASE_INDEX["stiffness"]])
    ends = np.array([loop.wind_up.min(), loop.wind_up.max()])
    line = Series(
        name=f"K = {K / ARCMIN_PER_RAD:.3g} N m/arcmin", x=ARCMIN_PER_RAD * ends, y=K * ends, look="reference"
    )
    return Chart(
        stem="windup",
        label=LABEL,
        shows=f"Run {loop.run}: the torque that the arm's motion takes from the reducer (J_L q'' + b_l q' + gravity less "
        "external torque), against motor angle / n less arm angle, changes from the start of the run; low-passed above "
        "the resonance.",
        reading="points along the line are a linear spring, its slope is K; an ellipse between the two marks is viscous "
        "damping, a loop with corners whose width does not depend on speed is hysteresis, a flat step in the middle is "
        "backlash (lost motion), a bend away from the line is a stiffness that hardens or softens.",
        panels=(
            Panel(
                title="The reducer's loop",
                x_label="wind-up [arcmin]",
                y_label="torque through the reducer [N m]",
                series=(*series, line),
                height=340,
            ),
        ),
    )
