"""The report of an identification, from its result alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from jointscope.experiments.page import Picture, Section, Table, page
from jointscope.identification.intervals import Estimate
from jointscope.identification.result import Identification

_ORDER = ("stiffness", "stiffness_total", "inertia", "damping", "damping_total")


def sentence(found: Identification) -> str:
    """The result in one sentence."""
    if not found.parameters and not found.modes:
        return f"Refused: {found.refused[0].reason}." if found.refused else "Nothing was identified."
    parts = [
        f"{name} {short(found.parameters[name])}" for name in _ORDER[:1] + _ORDER[2:4] if name in found.parameters
    ]
    if not parts:
        parts = [f"{len(found.modes)} modes, the first at {short(found.modes[0].frequency)}"]
    return "; ".join(parts) + "."


def short(estimate: Estimate) -> str:
    """Value with half its interval and unit, to the digits the interval leaves."""
    half = 0.5 * (estimate.high - estimate.low)
    digits = max(0, _digits(half))
    if abs(estimate.value) >= 1e6 or abs(estimate.value) < 1e-3:
        return f"{estimate.value:.4g} ± {half:.2g} {estimate.unit}"
    return f"{estimate.value:.{digits}f} ± {half:.{digits}f} {estimate.unit}"


def _digits(half: float) -> int:
    if half <= 0.0:
        return 4
    import math

    return min(8, 1 - math.floor(math.log10(half)))


def _interval(ends: tuple[float, float] | None) -> str:
    return "" if ends is None else f"[{ends[0]:.6g}, {ends[1]:.6g}]"


def _parameters(found: Identification) -> Section:
    names = [name for name in _ORDER if name in found.parameters]
    names += [name for name in found.parameters if name not in names]
    rows = tuple(
        (
            name.replace("_", " "),
            f"{found.parameters[name].value:.6g}",
            found.parameters[name].unit,
            _interval((found.parameters[name].low, found.parameters[name].high)),
            _interval(found.parameters[name].model),
            _interval(found.parameters[name].repeats),
        )
        for name in names
    )
    residual = (
        (found.lack_of_fit.verdict[0].upper() + found.lack_of_fit.verdict[1:] + ".",) if found.lack_of_fit else ()
    )
    return Section(
        heading="Parameters",
        text=(
            f"{found.method[0].upper()}{found.method[1:]}; {found.band[0]:.3g} to {found.band[1]:.3g} Hz.",
            *residual,
        ),
        table=Table(
            columns=("parameter", "value", "unit", "95 % interval", "from noise and scatter", "from repeats"),
            rows=rows,
        ),
        notes=(
            "The headline interval is the wider of the two beside it, from the noise and scatter model and from the spread "
            "between hits, unless they differ by no more than such a spread scatters by chance.",
            *found.notes,
        ),
    )


def _modes(found: Identification) -> Table:
    return Table(
        columns=("", "frequency [Hz]", "95 %", "damping ratio [%]", "95 %"),
        rows=tuple(
            (
                mode.kind,
                f"{mode.frequency.value:.5g}",
                _interval((mode.frequency.low, mode.frequency.high)),
                f"{100 * mode.damping_ratio.value:.4g}",
                _interval((100 * mode.damping_ratio.low, 100 * mode.damping_ratio.high)),
            )
            for mode in found.modes
        ),
    )


def _comparison(found: Identification) -> Table:
    return Table(
        columns=("method", "frequency [Hz]", "damping ratio [%]", "a2/b1", "1/b1", "a1/b1"),
        rows=tuple(
            (
                row.method,
                f"{row.frequency:.4f}",
                f"{100 * row.damping_ratio:.3f}",
                f"{row.stiffness:.6g}",
                f"{row.inertia:.5g}",
                f"{row.damping:.5g}",
            )
            for row in found.comparison
        ),
    )


def report(
    found: Identification, title: str, pictures: Sequence[Picture], quality: Sequence[Mapping[str, Any]] = ()
) -> str:
    """The page as HTML."""
    sections = [_parameters(found)] if found.parameters else []
    if found.modes:
        sections.append(Section(heading="Modes", table=_modes(found)))
    if pictures:
        sections.append(Section(heading="Pictures", pictures=tuple(pictures)))
    if found.comparison:
        sections.append(Section(heading="The main mode by other methods", table=_comparison(found)))
    if found.refused:
        refused = tuple((row.parameter, row.reason) for row in found.refused)
        sections.append(Section(heading="Refused", table=Table(columns=("parameter", "why"), rows=refused)))
    findings = [(str(q.get("finding")), str(q.get("run") or ""), str(q.get("detail") or "")) for q in quality]
    findings += [(row.finding, row.run, row.detail) for row in found.rejected]
    if findings:
        table = Table(columns=("finding", "run", "detail"), rows=tuple(dict.fromkeys(findings)))
        sections.append(Section(heading="Quality of the recordings", table=table))
    return page(f"Identification: {title}" if title else "Identification", sentence(found), sections)
