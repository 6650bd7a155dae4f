"""The report of an identification, from its result alone."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from jointscope.experiments.charts.chart import Chart
from jointscope.experiments.diagnosis_report.drawing import joint_drawing
from jointscope.experiments.diagnosis_report.hits import hit_of, hits_chart, hits_unit
from jointscope.experiments.diagnosis_report.wording import trade_unit
from jointscope.experiments.page import FirstScreen, Section, Table, page, pretty
from jointscope.identification.intervals import Estimate
from jointscope.identification.result import Identification
from jointscope.recordings.campaign import Campaign

_PLACES = {
    "double-hit": "load", "clipping": "sensors", "overload": "sensors", "inverted-polarity": "sensors",
    "offset": "sensors", "undersampled-pulse": "acquisition", "clock-skew": "acquisition", "dead-channel": "sensors",
    "suspicious-unit": "sensors", "truncated-decay": "acquisition", "low-coherence": "sensors",
}  # fmt: skip
"""Where on the drawing a finding is lit."""
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
            *_in_the_trade(found),
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


def _first(found: Identification, campaign: Campaign, findings: Sequence[tuple[str, str, str]]) -> FirstScreen:
    """What was found, where recordings are at fault, what to do now."""
    lit: dict[str, str] = {}
    for finding, _, _ in findings:
        place = _PLACES.get(finding)
        if place is not None:
            said = finding.replace("-", " ")
            lit[place] = lit[place] + ", " + said if said not in lit.get(place, said) else said
    values = {}
    if "stiffness" in found.parameters:
        values["transmission"] = "K " + _brief(found.parameters["stiffness"])
    if "inertia" in found.parameters:
        values["load"] = "J " + _brief(found.parameters["inertia"])
    drawing = joint_drawing(
        lit,
        topology="two-inertia" if campaign.rig.topology == "arm" else campaign.rig.topology,
        motion=campaign.rig.motion,
        spring="stiffness" in found.parameters or campaign.rig.topology != "single-dof",
        sure=True,
        values=values,
    )
    facts = [
        (f"{mode.kind}", f"{short(mode.frequency)}, damping ratio {100.0 * mode.damping_ratio.value:.3g} %")
        for mode in found.modes[:3]
    ]
    stiffness = found.parameters.get("stiffness")
    other = trade_unit(stiffness.unit) if stiffness is not None else None
    if stiffness is not None and other is not None:
        facts.insert(0, ("stiffness in the trade's unit", f"{stiffness.value * other[1]:.4g} {other[0]}"))
    if found.lack_of_fit is not None:
        share = found.lack_of_fit.share
        facts.append(
            ("left by the fit", f"{100.0 * share:.2g} % of the response" if share > 0.0 else "noise alone")
        )
    return FirstScreen(
        verdict=sentence(found), facts=tuple(facts), next_step=_next(found, bool(lit)), markup=(drawing,)
    )


def _brief(estimate: Estimate) -> str:
    return f"{estimate.value:.4g} {pretty(estimate.unit)}"


def _next(found: Identification, faulty: bool) -> str:
    if faulty:
        return (
            "Look at the findings on the recordings below first: a fault there is a fault in every figure above."
        )
    if not found.parameters:
        return "Record what the table of refusals says is lacking; docs/recording-guide.md says how."
    if found.level_probability is not None and found.level_probability < 0.01:
        return (
            "The joint depends on the level of excitation: run jointscope diagnose on this campaign to find why."
        )
    if found.lack_of_fit is not None and found.lack_of_fit.probability < 0.01:
        return (
            "The fit leaves more than noise: run jointscope diagnose on this campaign to find what it leaves out."
        )
    return "Use model.json: jointscope predict model.json CAMPAIGN says what other inputs will do."


def _in_the_trade(found: Identification) -> tuple[str, ...]:
    rows = []
    for name, e in found.parameters.items():
        other = trade_unit(e.unit)
        if other is not None:
            rows.append(
                f"{name.replace('_', ' ')}: {e.value * other[1]:.5g} {other[0]} "
                f"(95 %: {e.low * other[1]:.5g} to {e.high * other[1]:.5g})."
            )
    return tuple(rows)


def report(
    found: Identification,
    campaign: Campaign,
    charts: Sequence[Chart],
    quality: Sequence[Mapping[str, Any]],
    provenance: Section,
) -> str:
    """The page as HTML."""
    findings = [(str(q.get("finding")), str(q.get("run") or ""), str(q.get("detail") or "")) for q in quality]
    findings += [(row.finding, row.run, row.detail) for row in found.rejected]
    findings = list(dict.fromkeys(findings))
    hits = tuple(hit for run in campaign.runs if (hit := hit_of(run)) is not None)
    sections = [Section(heading="Hits and their force", charts=(hits_chart(hits, hits_unit(campaign.runs)),))]
    if charts:
        sections.append(Section(heading="What was fitted", charts=tuple(charts)))
    if found.parameters:
        sections.append(_parameters(found))
    if found.modes:
        sections.append(Section(heading="Modes", table=_modes(found)))
    if found.comparison:
        sections.append(Section(heading="The main mode by other methods", table=_comparison(found)))
    if found.refused:
        refused = tuple((row.parameter, row.reason) for row in found.refused)
        sections.append(Section(heading="Refused", table=Table(columns=("parameter", "why"), rows=refused)))
    table = Table(columns=("finding", "run", "detail"), rows=tuple(findings)) if findings else None
    notes = () if findings else ("Nothing was found wrong with the recordings.",)
    sections.append(Section(heading="Quality of the recordings", table=table, notes=notes))
    sections.append(provenance)
    title = f"Identification: {campaign.title or campaign.path.resolve().name}"
    return page(title, _first(found, campaign, findings), sections)
