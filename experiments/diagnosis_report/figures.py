"""Evidence 3 and 5: recorded and predicted in time and by band, the residual against speed, position and level."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jointscope.experiments.charts.chart import Chart, Mark, Missing, Panel, Series
from jointscope.experiments.diagnosis_report.balance import Balance
from jointscope.experiments.diagnosis_report.traces import UNITS, Trace

Vector = NDArray[np.float64]
_PERIODS = 14.0  # of the strongest frequency, shown in time
_DECADE = 10.0  # beyond this span errors are drawn on a logarithmic axis
_DIRECTIONS: tuple[tuple[str, Mark, str], ...] = (("forward", "o", "recorded"), ("reverse", "x", "base"))
_MODELS: tuple[tuple[str, Mark, str], ...] = (("base", "x", "base"), ("corrected", "o", "corrected"))
_DOTS = 1200  # marks per direction: enough to see the law, few enough to print


def density(x: Vector, rate: float) -> tuple[Vector, Vector]:
    """Amplitude spectral density of ``x`` less its mean [unit/sqrt(Hz)] by Welch's method, without the zero line."""
    from scipy.signal import welch

    f, power = welch(x, rate, nperseg=min(x.size, max(64, int(2.0 * rate))), detrend="constant")
    return f[1:], np.sqrt(power[1:])


def bands(x: Vector, rate: float, per_octave: int = 3) -> tuple[Vector, Vector]:
    """Centres [Hz] and RMS of ``x`` in fractions of an octave, from its periodogram."""
    from scipy.signal import periodogram

    f, power = periodogram(x, rate, window="hann", detrend="constant")
    edges = _edges(f, per_octave)
    total = np.array([np.sqrt(f[1] * np.sum(power[(f >= a) & (f < b)])) for a, b in itertools.pairwise(edges)])
    return np.sqrt(edges[:-1] * edges[1:]), total


def _edges(f: Vector, per_octave: int) -> Vector:
    step = f[1]
    count = int(np.floor(per_octave * np.log2(f[-1] / (4.0 * step)))) if f[-1] > 8.0 * step else 1
    return np.asarray(4.0 * step * 2.0 ** (np.arange(count + 1) / per_octave))


def floor_by_band(trace: Trace, per_octave: int = 3) -> Vector | None:
    """RMS of the noise in the bands of ``bands``, from the noise model's spectrum; None where it is not known."""
    if trace.floor_density is None:
        return None
    f = np.asarray(np.fft.rfftfreq(trace.time.size, 1.0 / trace.rate), dtype=np.float64)
    power = trace.floor_density(f) ** 2
    edges = _edges(f, per_octave)
    return np.array([np.sqrt(f[1] * np.sum(power[(f >= a) & (f < b)])) for a, b in itertools.pairwise(edges)])


def window(trace: Trace) -> slice:
    """The stretch drawn in time: all of an angle, else some periods where the base model's error is largest."""
    n = trace.time.size
    if trace.quantity in ("angle", "position"):
        return slice(0, n)
    f, amplitude = density(trace.recorded, trace.rate)
    strongest = max(f[int(np.argmax(amplitude))], 1.0)
    length = int(min(n, max(32.0, _PERIODS / strongest * trace.rate)))
    energy = np.concatenate([[0.0], np.cumsum((trace.recorded - trace.base) ** 2)])
    gain = energy[length:] - energy[:-length]
    begin = int(np.argmax(gain >= 0.999 * gain.max()))
    return slice(begin, begin + length)


def time_and_band(trace: Trace, *, corrected: bool) -> Chart:
    """Recorded, base and corrected in time, what each leaves, and all of it by third of an octave and line by line."""
    unit = UNITS.get(trace.quantity, "SI")
    part = window(trace)
    t = trace.time[part]
    predicted = {"base": trace.base} | ({"corrected": trace.corrected} if corrected else {})
    signal = [Series(name="recorded", x=t, y=trace.recorded[part], look="recorded")]
    left, by_band, by_line = [], [], []
    centres, size = bands(trace.recorded, trace.rate)
    by_band.append(Series(name="recorded", x=centres, y=size, look="recorded"))
    f, amplitude = density(trace.recorded, trace.rate)
    by_line.append(Series(name="recorded", x=f, y=amplitude, look="recorded"))
    for name, values in predicted.items():
        error = trace.recorded - values
        signal.append(Series(name=name, x=t, y=values[part], look=name))
        left.append(Series(name=f"left by {name}", x=t, y=error[part], look=name))
        by_band.append(Series(name=f"left by {name}", x=centres, y=bands(error, trace.rate)[1], look=name))
        by_line.append(Series(name=f"left by {name}", x=f, y=density(error, trace.rate)[1], look=name))
    floor = floor_by_band(trace)
    if floor is not None and trace.floor_density is not None:
        by_band.append(Series(name="noise floor", x=centres, y=floor, look="noise"))
        by_line.append(Series(name="noise floor", x=f, y=trace.floor_density(f), look="noise"))
    top = 2.0 * float(np.max(size, initial=1e-300))
    lowest = min(float(np.min(s.y[s.y > 0.0], initial=top)) for s in by_band)
    of_line = 2.0 * float(np.max(amplitude))
    which = "held out" if trace.held_out else "fitted (none was held out)"
    with_effect = f", {100.0 * trace.corrected_error:.3g} % corrected" if corrected else ""
    return Chart(
        stem=f"residual-{trace.experiment}",
        label=f"{trace.experiment}: {trace.quantity.replace('-', ' ')} at the {trace.location}",
        shows=f"Run {trace.run}, {which}, from the inputs alone: error {100.0 * trace.base_error:.3g} % with the base model"
        f"{with_effect}" + (f", noise floor {100.0 * trace.floor:.3g} %." if np.isfinite(trace.floor) else "."),
        reading=(
            "where the corrected error lies below the base error, the effect explains it; what still stands above the "
            "noise floor is explained by nothing here."
            if corrected
            else "an error without structure, at the noise floor in every band, is noise."
        ),
        columns=2,
        panels=(
            Panel(title="In time", x_label="time [s]", y_label=f"[{unit}]", series=tuple(signal), link="t"),
            Panel(title="By third of an octave", x_label="frequency [Hz]", y_label=f"RMS [{unit}]", link="f",
                  series=tuple(by_band), x_log=True, y_log=True, y_range=(max(1e-6 * top, 0.5 * lowest), top)),
            Panel(title="Recorded less predicted", x_label="time [s]", y_label=f"[{unit}]", series=tuple(left), link="t"),
            Panel(title="Line by line", x_label="frequency [Hz]", y_label=f"[{unit}/√Hz]", link="f",
                  series=tuple(by_line), x_log=True, y_log=True, y_range=(1e-6 * of_line, of_line)),
        ),
    )  # fmt: skip


def against_level(traces: Sequence[Trace], *, corrected: bool) -> Chart | Missing:
    """Relative error of every hit against how hard it was."""
    label = "Against level"
    hits = [t for t in traces if t.experiment == "hammer" and np.isfinite(t.base_error)]
    if not hits:
        return Missing(label, "hammer hits with a response channel")
    panels = []
    for channel in sorted({t.channel for t in hits}):
        own = sorted((t for t in hits if t.channel == channel), key=lambda t: t.level)
        series = []
        for which, mark, look in _MODELS[: 2 if corrected else 1]:
            for held in (False, True):
                shown = [t for t in own if t.held_out is held]
                if not shown:
                    continue
                y = np.array([100.0 * (t.base_error if which == "base" else t.corrected_error) for t in shown])
                x = np.array([t.level for t in shown])
                name = f"{which}, {'held out' if held else 'fitted'}"
                series.append(Series(name=name, x=x, y=y, look=look if held else "quiet", mark=mark))
        errors = np.concatenate([s.y for s in series])
        log = bool(errors.max() > _DECADE * errors.min() > 0.0)
        at = channel.replace("@", " at the ").replace("-", " ")
        panels.append(Panel(title=at, x_label="level: RMS torque of the hit [N m]", y_label="error [% of the signal]",
                            series=tuple(series), y_log=log, y_range=None if log else (0.0, 1.1 * errors.max())))  # fmt: skip
    return Chart(
        stem="residual-level",
        label=label,
        shows="The residual of every hit against its level, by channel.",
        reading="a linear model's error is the same share at every level; a share that falls with the level points to "
        "friction or backlash, one that rises to drag, a stiffness that hardens, or clipping; one that falls like 1/level "
        "is noise.",
        panels=tuple(panels),
        columns=min(2, len(panels)),
    )


def against_motion(balance: Balance | str) -> tuple[Chart | Missing, Chart | Missing]:
    """What the base model's balance of torques leaves, against speed and against position, by direction."""
    if isinstance(balance, str):
        return Missing("Against speed", balance), Missing("Against position", balance)
    generator = np.random.default_rng(0)
    index = {}
    for name, chosen in (("forward", balance.speed > 0.0), ("reverse", balance.speed < 0.0)):
        found = np.flatnonzero(chosen)
        index[name] = np.sort(generator.choice(found, _DOTS, replace=False)) if found.size > _DOTS else found

    def panel(x: Vector, title: str, label: str) -> Panel:
        series = tuple(
            Series(
                name=name,
                x=x[index[name]],
                y=balance.residual[index[name]],
                look=look,
                mark=mark,
            )
            for name, mark, look in _DIRECTIONS
        )
        return Panel(
            title=title, x_label=label, y_label=f"{balance.what} [{balance.unit}]", series=series, height=320
        )

    return (
        Chart(
            stem="residual-speed",
            label="Against speed",
            shows=balance.told,
            reading="a step at zero speed, from one level to another, is dry friction (a peak there: breakaway; a slope "
            "back beside the step: what the base model took for viscous damping); a slope in speed is viscous, a parabola "
            "is drag; a flat band about zero is noise.",
            panels=(panel(balance.speed, "Residual against speed", f"speed [{balance.speed_unit}]"),),
        ),
        Chart(
            stem="residual-position",
            label="Against position",
            shows=balance.told,
            reading="a wave in position is a transmission error (kinematic error) or cogging; a cosine or a slope that "
            "both directions share is gravity; a gap between forward and reverse that is the same everywhere is friction; "
            "one that closes at a place is an end stop or a tight spot.",
            panels=(panel(balance.position, "Residual against position", f"position [{balance.position_unit}]"),),
        ),
    )
