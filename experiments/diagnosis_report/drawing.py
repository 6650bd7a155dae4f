"""The joint as a drawing, inline SVG, with the place that was found lit: by colour, by hatching and by a label."""

from __future__ import annotations

import html
import itertools
from collections.abc import Mapping

from jointscope.experiments.diagnosis_report.wording import SENSORS

Box = tuple[float, float, float, float]  # x, y, width, height

_ROTARY: dict[str, tuple[Box, str]] = {
    "neighbour": ((8, 118, 92, 52), "neighbour"),
    "motor": ((122, 100, 92, 70), "motor"),
    "transmission": ((244, 92, 104, 86), "reducer"),
    "load": ((378, 116, 220, 34), "arm"),
    "base": ((102, 206, 262, 26), "base"),
    "acquisition": ((222, 10, 148, 40), "logger"),
    "sensors": ((520, 78, 62, 26), "sensors"),
}
_CARRIAGE: dict[str, tuple[Box, str]] = {
    "load": ((280, 92, 180, 86), "carriage"),
    "base": ((102, 206, 470, 26), "base"),
    "acquisition": ((222, 10, 148, 40), "logger"),
    "sensors": ((390, 62, 62, 24), "sensors"),
}
_INERTIA: dict[str, tuple[Box, str]] = {
    "transmission": ((180, 92, 104, 86), "spring"),
    "load": ((314, 116, 240, 34), "arm"),
    "base": ((102, 206, 470, 26), "base"),
    "acquisition": ((222, 10, 148, 40), "logger"),
    "sensors": ((480, 78, 62, 26), "sensors"),
}

STYLE = """<style>.jd text{font:13px system-ui,sans-serif;fill:var(--ink);text-anchor:middle}
.jd .part{fill:var(--wash);stroke:var(--quiet-line);stroke-width:1.5}
.jd .wire{fill:none;stroke:var(--quiet-line);stroke-width:1.3}
.jd .dots{stroke-dasharray:4 3}.jd .lit{stroke:var(--lit);stroke-width:4;fill:url(#hatch)}.jd .maybe{stroke-dasharray:9 5}
.jd .value{font-weight:600;paint-order:stroke;stroke:var(--paper);stroke-width:4px}
.jd .label{font-weight:700;paint-order:stroke;stroke:var(--paper);stroke-width:4px}</style>
<defs><pattern id="hatch" width="9" height="9" patternUnits="userSpaceOnUse" patternTransform="rotate(45)">
<rect width="9" height="9" style="fill:var(--lit-wash);fill-opacity:.25"/>
<line x1="0" y1="0" x2="0" y2="9" style="stroke:var(--lit);stroke-width:3"/>
</pattern></defs>"""


def joint_drawing(
    lit: Mapping[str, str],
    *,
    topology: str,
    motion: str,
    spring: bool,
    sure: bool,
    values: Mapping[str, str] | None = None,
    silent: str = "",
) -> str:
    """The rig with the parts of ``lit`` marked.

    Args:
        lit: Location (or ``sensors``) -> what was found there, for the label.
        topology, motion: As in the campaign.
        spring: Single-dof rigs: whether a spring holds the inertia.
        sure: Marks are solid; otherwise dashed, for candidates.
        values: Location -> a figure to write under the part.
        silent: Written under the drawing where nothing is marked.
    """
    if topology == "two-inertia":
        parts = _ROTARY
    else:
        parts = _INERTIA if spring else _CARRIAGE
    shown = {place: text for place, text in lit.items() if place in parts}
    pieces = [STYLE, _wires(parts)]
    for place, (box, name) in parts.items():
        if place == "neighbour" and place not in shown:
            continue
        kind = "part" + ("" if place not in shown else " lit" if sure else " lit maybe")
        x, y, width, height = box
        label = "carriage" if motion == "translational" and place == "load" else name
        pieces.append(f'<rect class="{kind}" x="{x}" y="{y}" width="{width}" height="{height}" rx="5"/>')
        pieces.append(
            f'<text class="{"label" if place in shown else ""}" x="{x + width / 2}" y="{y + height / 2 + 5}">{label}</text>'
        )
    pieces += _flags(shown, parts, sure)
    if silent and not shown:
        pieces.append(f'<text class="label" x="310" y="260">{html.escape(silent)}</text>')
    pieces += [
        f'<text class="value" x="{parts[p][0][0] + parts[p][0][2] / 2}" y="{parts[p][0][1] + parts[p][0][3] + 18}">'
        f"{html.escape(text)}</text>"
        for p, text in (values or {}).items()
        if p in parts
    ]
    told = "; ".join(f"{parts[p][1]}: {t}" for p, t in shown.items()) or "no part is marked"
    return (
        f'<svg class="jd" viewBox="0 0 620 {268 + 19 * max(0, len(shown) - 1)}" role="img" width="620">'
        f"<title>The joint; {html.escape(told)}</title>{''.join(pieces)}</svg>"
    )


def _wires(parts: Mapping[str, tuple[Box, str]]) -> str:
    """Shafts, the mount's ground and the dotted cables to the logger."""
    base = parts["base"][0]
    bottom = base[1] + base[3]
    lines = [f'<path class="wire" d="M{base[0] - 14} {bottom}H{base[0] + base[2] + 14}"/>']
    lines += [
        f'<path class="wire" d="M{x} {bottom}l-9 9"/>'
        for x in range(int(base[0]), int(base[0] + base[2]) + 14, 14)
    ]
    chain = [p for p in ("neighbour", "motor", "transmission", "load") if p in parts and p != "neighbour"]
    for left, right in itertools.pairwise(chain):
        a, b = parts[left][0], parts[right][0]
        y = 135.0
        lines.append(f'<path class="wire" style="stroke-width:5" d="M{a[0] + a[2]} {y}H{b[0]}"/>')
    held = "motor" if "motor" in parts else chain[0]
    for place in dict.fromkeys((held, "transmission" if "transmission" in parts else held)):
        box = parts[place][0]
        x = box[0] + box[2] / 2
        lines.append(f'<path class="wire" d="M{x} {box[1] + box[3]}V{base[1]}"/>')
    logger, sensor = parts["acquisition"][0], parts["sensors"][0]
    lines.append(
        f'<path class="wire dots" d="M{sensor[0] + sensor[2] / 2} {sensor[1]}V30H{logger[0] + logger[2]}"/>'
    )
    lines.append(f'<path class="wire" d="M{sensor[0] + sensor[2] / 2} {sensor[1] + sensor[3]}V116"/>')
    if "motor" in parts:
        box = parts["motor"][0]
        lines.append(f'<path class="wire dots" d="M{box[0] + box[2] / 2} {box[1]}V30H{logger[0]}"/>')
    return "".join(lines)


def _flags(shown: Mapping[str, str], parts: Mapping[str, tuple[Box, str]], sure: bool) -> list[str]:
    """One line of text under the drawing per marked part, and an arrow where the part is not the base."""
    flags = []
    for row, (place, text) in enumerate(shown.items()):
        box = parts[place][0]
        x = box[0] + box[2] / 2
        y = box[1] - 6 if place not in ("acquisition",) else box[1] + box[3] + 16
        flags.append(f'<path d="M{x} {y}l-7 -13h14z" style="fill:var(--lit)"/>' if place != "acquisition" else "")
        lead = "here" if sure else "perhaps here"
        flags.append(
            f'<text class="label" x="310" y="{260 + 19 * row}">{lead}, {parts[place][1]}: {html.escape(text)}</text>'
        )
    return flags


def marks(names: tuple[str, ...], called: Mapping[str, str]) -> dict[str, str]:
    """Which parts to light for ``effect@location`` names; an accelerometer's fault lights the sensors."""
    found: dict[str, list[str]] = {}
    for name in names:
        effect, _, location = name.partition("@")
        place = "sensors" if effect in SENSORS else location
        found.setdefault(place, []).append(called.get(effect, effect))
    return {place: "; ".join(dict.fromkeys(texts)) for place, texts in found.items()}
