"""The one recording that would best tell the leading candidates apart.

Every item of the menu that the joint's model can foretell is simulated under each of the leading candidates, and the one
that is expected to raise the probability of the right candidate most is recommended (``discrimination``). What can't be
simulated, and ties, go by a table: for pairs of effects the recordings that separate them, the sharpest first: what one
of the pair does and the other does not when a single thing is varied (level, preload, mass, posture, speed, device,
clock).
"""

from __future__ import annotations

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jointscope.diagnosis.adjudicate import Judgement
    from jointscope.diagnosis.discrimination import Item
    from jointscope.diagnosis.problem import Problem
    from jointscope.diagnosis.verdict import Decision

Names = tuple[str, ...]  # of one candidate set, each effect@location

CERTAIN = 0.95  # probability of a named set beyond which nothing more needs to be recorded
LISTED = 0.02  # probability below which a candidate is not worth a recording
QUIET = 0.9  # probability of "none" beyond which nothing more needs to be recorded
WORTHWHILE = 0.05  # expected gain in probability below which no simulated item is recommended over the table's
TIE = 0.03  # of expected gain, within which the table decides

MENU: dict[str, str] = {
    "levels": "hammer hits at the same point over a span of at least 10:1 in peak force, in random order, ten per level",
    "preload": "small hits with a known static torque on the arm, at three preloads of either sign",
    "mass": "the same hits and sweeps with a known mass fixed to the arm at a measured radius",
    "posture": "the same runs at three arm angles, a hold of 10 s at standstill in each",
    "brake": "the same hits with the motor brake open and the drive holding loosely, motor angle and torque logged",
    "sensor-moved": "the same hits with the accelerometer moved to half its radius, and turned by 180 degrees once",
    "sweep-levels": "torque sweeps from 2 to 80 Hz at a third of and at twice the present amplitude, with motor angle logged",
    "slow-ramp": "slow constant-speed moves in both directions at five speeds, from breakaway to full speed, with motor "
    "angle and torque logged",
    "torque-reversal": "a slow torque ramp up and down through zero against a held arm, with motor and arm angle logged",
    "multisine": "an odd random-phase multisine torque at three levels, at least 6 periods each, with motor angle logged",
    "logging-rate": "a sweep to at least 80 Hz with torque and acceleration logged by one device at 1 kHz or more",
    "time-shuffled": "the first run again at the end of the day, with levels in random order in between",
    "undriven": "a record of 30 s with the drive switched off and nothing struck",
    "constant-speeds": "constant-speed moves at three speeds over at least two output turns or the whole travel, with motor "
    "angle logged",
}

# Of a pair: the recordings that separate it, the sharpest first.
_PAIRS: tuple[tuple[Names, Names, Names], ...] = (
    (("backlash",), ("coulomb-friction", "stribeck-friction"), ("levels", "torque-reversal", "preload")),
    (("backlash",), ("stiffness-nonlinearity", "hysteresis"), ("preload", "torque-reversal", "levels")),
    (("stiffness-nonlinearity",), ("hysteresis",), ("torque-reversal", "preload")),
    (("coulomb-friction",), ("stribeck-friction",), ("slow-ramp",)),
    (("coulomb-friction", "stribeck-friction"), ("hysteresis",), ("torque-reversal", "slow-ramp")),
    (("coulomb-friction", "stribeck-friction"), ("quadratic-damping",), ("slow-ramp", "levels")),
    (("coulomb-friction", "stribeck-friction"), ("gravity",), ("posture", "slow-ramp")),
    (("coulomb-friction", "stribeck-friction"), ("load-dependent-friction",), ("mass", "slow-ramp")),
    (("load-dependent-friction",), ("torque-gain",), ("slow-ramp", "mass")),
    (
        ("structural-damping",),
        ("coulomb-friction", "hysteresis", "stribeck-friction", "quadratic-damping"),
        ("levels",),
    ),
    (("structural-damping",), ("*",), ("mass",)),
    (("delay", "clock-drift", "drive-lag", "torque-logging", "sensor-resonance"),) * 2 + (("logging-rate",),),
    (("sensor-gain", "torque-gain", "payload"),) * 2 + (("mass",),),
    (("gravity",), ("sensor-tilt", "torque-gain"), ("posture",)),
    (("sensor-tilt",), ("sensor-gain",), ("posture", "sensor-moved")),
    (
        ("link-flexibility", "base-compliance", "neighbour-flexibility"),
        ("sensor-resonance",),
        ("sensor-moved", "brake"),
    ),
    (("neighbour-flexibility",), ("link-flexibility", "base-compliance"), ("brake", "posture")),
    (("link-flexibility",), ("base-compliance",), ("sensor-moved", "mass")),
    (("external-vibration",), ("*",), ("undriven",)),
    (("transmission-error", "torque-ripple"),) * 2 + (("constant-speeds", "mass"),),
    (("stiffness-drift",), ("*",), ("time-shuffled", "levels")),
    (("sensor-saturation", "end-stop"), ("*",), ("levels", "sensor-moved")),
)


def separators(first: str, second: str) -> Names:
    """Keys of ``MENU`` that separate two ``effect@location`` names, the sharpest first."""
    (one, here), (other, there) = (name.partition("@")[::2] for name in (first, second))
    if one == other:  # one effect at two places: what moves only one side
        return () if here == there else ("brake", "torque-reversal", "multisine")
    for left, right, menu in _PAIRS:
        if (one in left and (other in right or "*" in right)) or (
            other in left and (one in right or "*" in right)
        ):
            return menu
    return ("multisine",)


def next_experiment(verdict: str, ranking: Sequence[tuple[Names, float]]) -> str | None:
    """The recording to make next, or ``None`` where none is needed.

    Every pair of likely candidates votes for what separates it, with the product of their probabilities, and with half
    of it for each place further down its list; ties go by the order of the menu.

    Args:
        verdict: "none", "effects" or "unknown".
        ranking: Candidate sets with their probabilities; the base is the empty set.
    """
    likely = [(names, p) for names, p in ranking if p >= LISTED]
    if verdict == "none" or not likely or (verdict == "effects" and max(p for _, p in likely) >= CERTAIN):
        return None
    votes = dict.fromkeys(MENU, 0.0)
    best_pair: dict[str, tuple[float, str]] = {}
    for i, (names, p) in enumerate(likely):
        for others, q in likely[i + 1 :]:
            for one, other in _differences(names, others):
                for place, item in enumerate(separators(one, other)):
                    weight = p * q * 0.5**place
                    votes[item] += weight
                    best_pair[item] = max(best_pair.get(item, (0.0, "")), (weight, _told(one, other)))
    chosen = max(MENU, key=lambda item: votes[item])  # the first of equals
    if votes[chosen] <= 0.0:
        return MENU["multisine"] if verdict == "unknown" else None
    return f"{MENU[chosen]}: it tells {best_pair[chosen][1]}"


def _differences(names: Names, others: Names) -> list[tuple[str, str]]:
    """Pairs of which one set holds the first and the other the second; ``""`` for nothing at all."""
    only, rest = sorted(set(names) - set(others)), sorted(set(others) - set(names))
    return [(a, b) for a in only or [""] for b in rest or [""]]


def _told(one: str, other: str) -> str:
    if one and other:
        return " from ".join(sorted((one, other)))
    return f"whether {one or other} is there at all"


# --- the computed answer ---------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Suggestion:
    """What to record next.

    Attributes:
        text: For the reader, one sentence.
        key: Of ``MENU``; ``None`` where the table spoke alone.
        menu: What was simulated, best first.
        pair: The candidates that it tells apart.
    """

    text: str
    key: str | None
    menu: tuple[Item, ...]
    pair: tuple[Names, Names] | None


def needed(verdict: str, probability: float, ranking: Sequence[tuple[Names, float]]) -> bool:
    """Whether another recording is worth a computation: not where the answer is as good as certain."""
    if verdict == "none":
        return probability < QUIET
    return not (verdict == "effects" and max((p for _, p in ranking), default=0.0) >= CERTAIN)


def suggest(
    problem: Problem, judgement: Judgement, decision: Decision, pool: ThreadPoolExecutor
) -> Suggestion | None:
    """The recording to make next by expected gain, or ``None`` where none is needed."""
    from jointscope.diagnosis.discrimination import menu_of

    ranking = [(r.names, r.probability) for r in decision.ranking]
    if not needed(decision.verdict, decision.probability, ranking):
        return None
    items = menu_of(problem, judgement, decision, pool)
    chosen = choose(items)
    if chosen is None:
        text = next_experiment(decision.verdict, ranking)
        return None if text is None and not items else Suggestion(text or MENU["multisine"], None, items, None)
    text = (
        f"{MENU[chosen.key]}: it tells {_sets(chosen.pair)}, and is expected to raise the probability of the right one by "
        f"{chosen.expected_gain:.2f}"
    )
    return Suggestion(text, chosen.key, items, chosen.pair)


def choose(items: Sequence[Item]) -> Item | None:
    """The best item; of near-equals the one that the table puts first for its pair, then the one with most distance."""
    if not items or items[0].expected_gain < WORTHWHILE:
        return None
    near = [item for item in items if item.expected_gain > items[0].expected_gain - TIE]

    def standing(item: Item) -> tuple[int, float]:
        table = [m for one, other in _differences(*item.pair) if one and other for m in separators(one, other)]
        return (table.index(item.key) if item.key in table else len(MENU), -item.distance)

    return min(near, key=standing)


def _sets(pair: tuple[Names, Names]) -> str:
    return " from ".join(" + ".join(names) or "the model without further physics" for names in pair)
