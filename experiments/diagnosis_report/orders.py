"""Evidence 6: the residual's spectrum against speed: what turns with the motor or the output lies on lines."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.problem import PreparedRun
from jointscope.experiments.charts.chart import Chart, Heat, Missing, Panel, Series
from jointscope.experiments.diagnosis_report.traces import UNITS, Models, Trace

Vector = NDArray[np.float64]
LABEL = "Residual spectrum against speed"
_WINDOW = 0.5  # s
_SPEEDS = 20
_LINES = 110  # rows of the map
_FLOOR = -50.0  # dB
_RANK = (
    "linear-acceleration",
    "acceleration",
    "angular-acceleration",
    "angular-velocity",
    "velocity",
    "angle",
    "position",
)


def orders_chart(models: Models, traces: Sequence[Trace], answer: dict[str, Any]) -> Chart | Missing:
    """Over every run in motion, of the channel that shows most."""
    moving = [t for t in traces if t.experiment in ("speed-motion", "free")]
    if not moving:
        return Missing(LABEL, "a run in motion (speed-motion or free) with a response channel")
    quantity = min((t.quantity for t in moving), key=lambda q: _RANK.index(q) if q in _RANK else len(_RANK))
    pieces = []
    for t in (t for t in moving if t.quantity == quantity):
        speed = _speed(models.problem.runs[t.position], t.time)
        if speed is not None and t.time.size > 2 * _WINDOW * t.rate:
            pieces.append((t, speed))
    if not pieces:
        return Missing(LABEL, "an angle (or speed command) from which the speed follows, in a run in motion")
    return _drawn(pieces, models, answer)


def _speed(run: PreparedRun, times: Vector) -> Vector | None:
    """Speed of the output [rad/s or m/s]."""
    if run.observed is not None:
        return run.observed.signal(times, 0 if run.observed.rate_signal else 1)
    if run.speed_command is not None:
        return np.interp(times, run.time, run.speed_command)
    return None


def speed_map(pieces: Sequence[tuple[Vector, Vector, float]], top: float) -> tuple[Vector, Vector, Vector]:
    """Power of residuals by speed and frequency.

    Args:
        pieces: (residual, speed, sampling rate [Hz]) of each run.
        top: Highest frequency [Hz].

    Returns:
        Edges of speed, shape (m + 1,), edges of frequency [Hz], shape (n + 1,), and mean power spectral density,
        shape (n, m), NaN where no window moved at that speed.
    """
    fastest = max(float(np.max(np.abs(speed))) for _, speed, _ in pieces)
    speeds = np.linspace(0.0, fastest, _SPEEDS + 1)
    rows = int(min(_LINES, top * _WINDOW))
    frequencies = np.linspace(0.0, top, rows + 1)
    power, count = np.zeros((rows, _SPEEDS)), np.zeros((rows, _SPEEDS))
    for residual, speed, rate in pieces:
        n = int(_WINDOW * rate)
        window = np.hanning(n)
        f = np.fft.rfftfreq(n, 1.0 / rate)
        row = np.digitize(f, frequencies) - 1
        inside = (row >= 0) & (row < rows) & (f > 0.0)
        for begin in range(0, residual.size - n + 1, max(1, n // 8)):
            part = residual[begin : begin + n]
            density = 2.0 * np.abs(np.fft.rfft((part - part.mean()) * window)) ** 2 / (rate * np.sum(window**2))
            column = min(_SPEEDS - 1, int(_SPEEDS * float(np.mean(np.abs(speed[begin : begin + n]))) / fastest))
            np.add.at(power[:, column], row[inside], density[inside])
            np.add.at(count[:, column], row[inside], 1.0)
    with np.errstate(invalid="ignore"):
        return speeds, frequencies, power / np.where(count > 0.0, count, np.nan)


def _drawn(pieces: list[tuple[Trace, Vector]], models: Models, answer: dict[str, Any]) -> Chart:
    trace = pieces[0][0]
    ratio = models.problem.rig.reduction_ratio
    fastest = max(float(np.max(np.abs(speed))) for _, speed in pieces)
    resonance = models.problem.scales.frequency
    turning = (ratio or 1.0) * fastest / (2.0 * np.pi)
    top = float(min(0.45 * trace.rate, max(2.5 * resonance, 2.4 * turning, 20.0)))
    speeds, frequencies, power = speed_map([(t.recorded - t.base, s, t.rate) for t, s in pieces], top)
    decibel = 10.0 * np.log10(np.maximum(power / np.nanmax(power), 10.0 ** (_FLOOR / 10.0)))
    rotational = models.problem.rig.motion == "rotational"
    lines = _order_lines(answer, ratio, fastest, top) if rotational else []
    springs = any(run.spring for run in models.problem.runs)
    line = Series(name="resonance", x=np.array([0.0, fastest]), y=np.array([resonance, resonance]), look="noise")
    level = (line,) if springs else ()
    unit = "rad/s at the output" if rotational else "m/s"
    return Chart(
        stem="residual-orders",
        label=LABEL,
        shows=f"What the base model leaves of {trace.quantity.replace('-', ' ')} at the {trace.location} "
        f"[{UNITS.get(trace.quantity, 'SI')}], over {len(pieces)} run{'s' if len(pieces) > 1 else ''} in motion: the fuller the "
        f"colour the stronger, over {-_FLOOR:.0f} dB; empty: no recording at that speed."
        + ("" if rotational else " No order lines: nothing turns in this rig."),
        reading="a ridge along a line from the origin turns with the motor or the output (cogging, torque ripple, "
        "kinematic error); a ridge at one frequency whatever the speed is a mode or an outside disturbance; most of it at "
        "low speed is friction.",
        panels=(
            Panel(title="Residual spectrum", x_label=f"speed [{unit}]", y_label="frequency [Hz]",
                  series=(*lines, *level), heat=Heat(speeds, frequencies, decibel, "dB"), x_range=(0.0, fastest),
                  y_range=(0.0, top), height=360),
        ),
    )  # fmt: skip


def _order_lines(answer: dict[str, Any], ratio: float | None, fastest: float, top: float) -> list[Series]:
    """Order 1 and 2 of the motor, order 1 of the output, and every order that the answer names."""
    wanted = [("motor-order", k, k * ratio) for k in (1.0, 2.0)] if ratio else []
    wanted.append(("output-order", 1.0, 1.0))
    for effect in answer["effects"]:
        order = effect["parameters"].get("order")
        if order and order["value"]:
            per_motor = "motor" in str(order["unit"])
            factor = (ratio or 1.0) if per_motor else 1.0
            wanted.append(
                ("motor-order" if per_motor else "output-order", order["value"], order["value"] * factor)
            )
    found: list[Series] = []
    for look, order, per_output in {(a, round(b, 4)): (a, b, c) for a, b, c in wanted}.values():
        end = min(fastest, 2.0 * np.pi * top / per_output)
        x = np.array([0.0, end])
        if found and found[-1].look == look:
            look = "motor-order-2"
        name = f"order {order:g} of the {'motor' if look == 'motor-order' else 'output'}"
        found.append(Series(name=name, x=x, y=per_output * x / (2.0 * np.pi), look=look))
    return found
