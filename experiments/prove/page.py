"""The proof as a Markdown page, from its saved summary only."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Final

from jointscope.experiments.prove.pictures import LEVELS

BANDS: Final = ("easy", "medium", "hard")


def percent(share: Mapping[str, Any]) -> str:
    """A share as per cent with its interval and counts."""
    if not share["cases"]:
        return "no case"
    return (
        f"{100 * share['share']:.1f} % [{100 * share['low']:.1f}, {100 * share['high']:.1f}]"
        f" ({share['hits']} of {share['cases']})"
    )


def number(value: float | None, unit: str) -> str:
    """A plain number with its unit."""
    if value is None:
        return "no case"
    if unit == "%":
        return f"{100 * value:.1f} %"
    return f"{value:.3g}" + ("" if unit == "1" else f" {unit}")


def shown(row: Mapping[str, Any]) -> str:
    """A measure's value with its interval and its number of cases."""
    if isinstance(row["value"], dict):
        return percent(row["value"])
    if row["value"] is None:
        return "no case"
    unit, factor = row["unit"], 100.0 if row["unit"] == "%" else 1.0
    span = ""
    if row.get("interval"):
        span = " [" + ", ".join(f"{factor * end:.3g}" for end in row["interval"]) + "]"
    return f"{number(row['value'], unit)}{span} ({row['cases']} cases)"


ENGINES = {
    "mujoco": "MuJoCo, laws of the generator's own, several of them other than the diagnosis's under the same name",
    "outside": "a second engine: equations, laws, noise and file plan that share nothing with MuJoCo's or the diagnosis's",
}


def page(summary: Mapping[str, Any], pictures: str = "") -> str:
    """The whole page; ``pictures`` is the folder of the pictures as seen from it, ending in a slash."""
    parts = [
        _head(summary), _table(summary), _gap(summary), _compared(summary), _leak(summary), _experiments(summary),
        _pictures(pictures), _failures(summary), _bounds(summary),
    ]  # fmt: skip
    return "\n\n".join(part for part in parts if part) + "\n"


def _head(summary: Mapping[str, Any]) -> str:
    opened = summary["openings"]
    kinds = ", ".join(f"{count} {kind}" for kind, count in summary["kinds"].items())
    bands = ", ".join(f"{count} {band}" for band, count in summary["bands"].items())
    draw = summary["draw"]
    warning = (
        "" if draw == "test" else f"\n**These are {draw} cases, which the diagnosis was developed or calibrated on:"
        " the figures show how the page works, not how good the diagnosis is.**\n"
    )  # fmt: skip
    engine = ENGINES[summary.get("engine", "mujoco")]
    return f"""# The proof: effects concealed, diagnosed blind, then the seal opened
{warning}
Physics that the plain model of the joint lacks was concealed in simulated recordings
({engine}), each campaign was diagnosed by `jointscope diagnose`
alone, in a process of its own, and only then the sealed truth was opened and the answers scored.

- {summary["cases"]} cases ({kinds}); bands of the effects: {bands}. {draw.capitalize()} draw, seed {summary["seed"]}.
- Sealed before anything was diagnosed: SHA-256 `{summary["seal"]}`.
- Opened {opened["times"]} time(s), on {opened["answers"]} set(s) of answers, this one included.
- Diagnosed by version {summary["version"]}, scored at commit `{summary["commit"]}`.

Shares have 95 % Wilson intervals, other numbers 95 % bootstrap intervals over the cases. Crashes and time-outs count as
wrong. Bands are of z_d, how far the truth stays from its nearest look-alike when both are fitted, in standard deviations:
easy 30-100, medium 10-30, hard 4-10; above, a case is trivial, below, it can't be told."""


def _table(summary: Mapping[str, Any]) -> str:
    lines = ["## What was reached", "", "| measure | value | at least | aim | reached |", "|---|---|---|---|---|"]
    for row in summary["table"]:
        sign = "" if row["upward"] else "<= "
        least = "-" if row["least"] is None else sign + number(row["least"], row["unit"])
        aim = "-" if row["aim"] is None else sign + number(row["aim"], row["unit"])
        reached = {True: "yes", False: "**no**", None: "-"}[row["reached"]]
        lines.append(f"| {row['name']} | {shown(row)} | {least} | {aim} | {reached} |")
    lines += ["", "Gain is (E_base - E_tool)/(E_base - E_best) of the held-out errors. Towards the truth without noise, E_best"
              " is the error of the very motion that was simulated, which no fit to noisy inputs reaches; towards the true"
              " structure, it is what the diagnosis itself reaches with the true effects."]  # fmt: skip
    return "\n".join(lines)


def _gap(summary: Mapping[str, Any]) -> str:
    gap = summary["law_gap"]
    lines = ["## Textbook laws against laws that depart from them", "",
             "The same names, other equations in the generator than in the candidates. The gap measures the inverse crime.", "",
             "| bands | matched law | mismatched law | gap [points] |", "|---|---|---|---|"]  # fmt: skip
    for band, row in gap.items():
        span = "no case" if row["gap"] is None else f"{row['gap']:.0f} [{row['low']:.0f}, {row['high']:.0f}]"
        lines.append(f"| {band} | {percent(row['matched'])} | {percent(row['mismatched'])} | {span} |")
    return "\n".join(lines)


def _compared(summary: Mapping[str, Any]) -> str:
    if not summary.get("baselines"):
        return ""
    ways = {"**diagnose**": summary["short"], **{k: v for k, v in summary["baselines"].items() if k != "chance"}}
    lines = ["## Beside simpler ways, on the same cases", "", "| way | " + " | ".join(summary["short"]) + " |",
             "|---" * (len(summary["short"]) + 1) + "|"]  # fmt: skip
    lines += [
        f"| {way} | " + " | ".join(_brief(found[name]) for name in summary["short"]) + " |"
        for way, found in ways.items()
    ]
    guess = number(summary["baselines"]["chance"]["named"], "%")
    return "\n".join([*lines, "", f"Chance: guessing among all names and places names {guess} of single effects. The simpler"
                      " ways work on one regression of the equation of motion (`experiments/prove/baselines.py`)."])  # fmt: skip


def _brief(share: Mapping[str, Any]) -> str:
    if not share["cases"]:
        return "-"
    return f"{100 * share['share']:.0f} % [{100 * share['low']:.0f}, {100 * share['high']:.0f}]"


def _leak(summary: Mapping[str, Any]) -> str:
    lines = [
        f"- {what}: balanced accuracy {found['score']:.2f}; on shuffled labels {found['chance'][0]:.2f}, 95 % of shuffles"
        f" below {found['chance'][1]:.2f} (p = {found['p_value']:.2f}):"
        f" {'at chance' if found['at_chance'] else '**above chance**'}"
        for what, found in (summary.get("leak") or {}).items()
    ]
    if not lines:
        return ""
    return "\n".join(["## Does the paperwork tell?", "", "Classifiers that see everything of a campaign but its samples:", "",
                      *lines])  # fmt: skip


def _experiments(summary: Mapping[str, Any]) -> str:
    sets = summary["by_experiments"]
    names = list(next(iter(sets.values()), {}))
    lines = ["## By experiments", "", "H hammer, S torque sweep, M speed-controlled motion.", "",
             "| measure | " + " | ".join(sets) + " |", "|---" * (len(sets) + 1) + "|"]  # fmt: skip
    lines += [f"| {name} | " + " | ".join(_brief(found[name]) + f" ({found[name]['cases']})" for found in sets.values())
              + " |" for name in names]  # fmt: skip
    return "\n".join(lines)


def _pictures(folder: str) -> str:
    lines = ["## Pictures", "", f"![Stated probability against the share right]({folder}reliability.png)"
             f" ![Shares right against z_d]({folder}power.png)", "",
             "Rows are the truth, columns the answer, shaded by the share of the row; framed where the answer is right.",
             ""]  # fmt: skip
    return "\n".join(lines + [f"![Confusion by {level}]({folder}confusion-{level}.png)" for level in LEVELS[::-1]])


def _failures(summary: Mapping[str, Any]) -> str:
    found = summary["failures"]
    if not found:
        return "## Wrong answers\n\nThere are none."
    lines = ["## Wrong answers, by class", "",
             "Each class with its surest wrong answer as the example: the one that would have misled most.", "",
             "| class | cases | bands |", "|---|---|---|"]  # fmt: skip
    lines += [f"| {kind['class']} | {kind['cases']} | {_counts(kind['bands'])} |" for kind in found]
    for kind in found:
        lines += ["", f"### {kind['class'].capitalize()} ({kind['cases']})", "", kind["meaning"], "",
                  *_example(kind["example"])]  # fmt: skip
    return "\n".join(lines)


def _counts(bands: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {band}" for band, count in bands.items())


def _example(case: Mapping[str, Any]) -> list[str]:
    truth = "; ".join(_concealed(effect) for effect in case["truth"]) or "nothing"
    distance = "" if case["z_d"] is None else f", z = {case['z']:.0f}, z_d = {case['z_d']:.1f}"
    said = ", ".join(case["said"]) or case["verdict"] + (f" ({case['reason']})" if case["reason"] else "")
    stated = "" if case["probability"] is None else f", probability {case['probability']:.2f}"
    ranking = "; ".join(_ranked(entry) for entry in case["ranking"]) or "none"
    lines = [
        f"- Case `{case['case']}`, experiments {case['experiments']}, {case['band']}{distance}.",
        f"- Concealed: {truth}.",
        f"- Said: {said}{stated}. Ranking: {ranking}.",
    ]
    if case["candidates"]:
        lines.append("- Offered as a set: " + "; ".join(" + ".join(names) for names in case["candidates"]) + ".")
    if case["held_out"] and case["held_out"]["base_error"] is not None:
        held = case["held_out"]
        floor = "" if held["noise_floor"] is None else f", noise floor {held['noise_floor']:.4f}"
        answer = f"with the answer {held['augmented_error']:.4f}"
        lines.append(f"- Held-out error: base {held['base_error']:.4f}, {answer}{floor}.")
    lines.append(f"- Why: {case['why']}")
    told = [f"{text} (shows {effect})" for effect, text in case["tells"].items()]
    if case["next_experiment"]:
        told.insert(0, f"the answer itself asks for {case['next_experiment']}")
    if told:
        lines.append("- What would have told: " + "; ".join(told) + ".")
    return lines


def _concealed(effect: Mapping[str, Any]) -> str:
    value = "" if effect["value"] is None else f", {effect['main']} {effect['value']:.3g}"
    return f"{effect['effect']} (law {effect['law']}{value})"


def _ranked(entry: Mapping[str, Any]) -> str:
    name = " + ".join(entry["effects"]) or "nothing"
    return name if entry["probability"] is None else f"{name} {entry['probability']:.2f}"


def _bounds(summary: Mapping[str, Any]) -> str:
    missed: Sequence[str] = [row["name"] for row in summary["table"] if row["reached"] is False]
    if not missed:
        return ""
    return "\n".join(["## What falls short", "", *(f"- {name}" for name in missed)])
