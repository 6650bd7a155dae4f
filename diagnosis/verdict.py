"""From evidence to an answer: none, effects, or unknown, each with its probability."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from jointscope.diagnosis.absence import of_its_own
from jointscope.diagnosis.adequacy import EXCESS, Adequacy, adequacy
from jointscope.diagnosis.adjudicate import Judged, Judgement, compare, differences, score, standing
from jointscope.diagnosis.constancy import CHANGES, Change
from jointscope.diagnosis.containment import contains, holds, left_open, unowned
from jointscope.diagnosis.gates import AS_FORETOLD, HELD, MATERIAL, Comparison
from jointscope.diagnosis.outside import lead_asked, resembled
from jointscope.diagnosis.remainder import FOLLOWS, Remainder
from jointscope.diagnosis.search import nested
from jointscope.diagnosis.twins import foreknown
from jointscope.diagnosis.unlike_noise import foreseen, grows_with_signal, left_in_proportion, still_grows

if TYPE_CHECKING:
    from jointscope.diagnosis.input_scatter import Pushes

TEMPERATURE = 3.0  # nats of score per nat of belief: laws of the right name but the wrong form cost as much
WRONG_FORM = 0.01  # or this share of the best score, between laws neither of which is nearer the data than ...
NEARER = 0.25  # of half the squared distance of their predictions, which is what the true one would lead by
SAME = 30.0  # nats of distance within which two predictions of a much stronger effect are the same
CONTAINING = 8.0  # nats by which a law that contains another must lead it ...
OF_CONTAINED = 5e-5  # ... or this share of what that one explains: no form is exact to less
OPEN = 0.6  # nats by which a law is believed in beside one that contains it and is left open: it is simpler
SPARING = (
    0.0,
    0.0,
    -2.5,
    -5.0,
)  # nats of belief by the number of effects: there are more sets than single effects
LEADS_FEWER = 1.1  # times the score of fewer, other effects: true pairs led by 1.13 and more, a stand-in by 1.06
NOT_STANDING = 12.0  # nats taken off a set that fails a gate
SURE = 0.75  # probability of the leading effect below which it is not named alone
SURE_OF_SETS = 0.85  # the same of a set of several: one of them may stand in for a look-alike
FORESEEN = 4.0  # times an error's innovation, above which it is no noise
TOO_MANY = 3  # effects that together have mostly stood in for one that the catalogue does not hold
BY_FORM = 0.001  # of a score: what a third effect adds, or still follows the input, is less than laws are off by
AS_GOOD = 1e-5  # of a score, by which laws differ for how they are stepped
BY_EXACT = (
    1e-4  # the same of a second effect: a law that has one form is right to a hundredth of its size at best, ...
)
BY_FIRST = 0.01  # ... another to a tenth: of 59 answers the right ones led by 0.02, stand-ins by 0.005
LACKING = 0.005  # of the signal's rms, left by the base, common to runs driven alike, that no candidate explains
GROWING = 0.1  # error over signal, where it grows with it, beyond which the model is not accepted
NOT_FOLLOWED = 0.25  # the same of any channel, beyond which what was named is no answer either ...
NEARLY_ALL = 0.9  # ... unless it explains this of the mismatch's energy
EXPLAINED = 0.6  # of the mismatch's energy, below which the best candidate is no answer (45 named: at least 0.73)
TOUCHED = 0.05  # of the mismatch's energy, by which a set changes what it acts on
MATERIAL_LEFT = 0.01  # of the signal's rms that must be left for that
LIKELY = 0.7  # that nothing is missing where a name was taken back
UNNAMED = 40.0  # nats of a force without a name above which "none" is no answer
UNHEARD = 0.0005  # of the signal's rms, which the best of records holds: an unnamed force that does less is none
MORE_LEFT = 0.5  # of what the named effects gained, still left following the input: then they are no answer
BESIDE_NAMED = (
    0.05  # of the rms that the named effects explain, below which what still follows the input is their forms'
)
AS_MUCH_AS_NAMED = 0.65  # of what the named effects gained, explained by the input alone: then they are no answer
NEAR = 3.0  # belief nats within which rivals are listed


@dataclass(frozen=True, eq=False)
class Ranked:
    """One set of effects, the best of its fitted laws."""

    names: tuple[str, ...]
    probability: float
    score: float
    judged: Judged
    comparison: Comparison | None


@dataclass(frozen=True, eq=False)
class Decision:
    """The answer.

    Attributes:
        chosen: The hypothesis whose model is handed on: the named set, or the base.
        probability: Of the verdict as a whole.
        candidates: Sets that the recordings can't tell apart; where they share an effect, that one is named.
        adequacy: The chosen model against the base and the noise floor.
    """

    verdict: Literal["none", "effects", "unknown"]
    chosen: Judged
    probability: float
    ranking: tuple[Ranked, ...]
    unknown_reason: Literal["outside-catalogue", "not-identifiable"] | None
    candidates: tuple[tuple[str, ...], ...]
    adequacy: Adequacy


def temperature(best: float) -> float:
    """Nats of score per nat of belief, where the best set scores ``best``."""
    return max(TEMPERATURE, WRONG_FORM * best)


def distance(judgement: Judgement, one: Judged, other: Judged) -> float:
    """Half the squared distance of two predictions of all runs, whitened [nats]: the lead of the one that is true."""
    freedom = max(sum(sum(w.sizes) for w in judgement.objective.whiteners), 1)
    overdispersion = max(1.0, min(one.chi2, other.chi2) / freedom)
    apart = differences(judgement, one, other)
    return 0.5 * float(sum(np.sum(np.square(d)) for d in apart)) / overdispersion


def _belief(judgement: Judgement, values: dict[tuple[str, ...], tuple[float, Judged]]) -> list[float]:
    """Nats of belief of every set against the leading one; how far a lead counts depends on who is compared."""
    top, leader = max(values.values(), key=lambda v: v[0])
    found = []
    for value, judged in values.values():
        lead = top - value
        if (holds(judged, leader) and left_open(judgement, leader, judged.names)) or unowned(
            judgement, leader, judged
        ):
            lead = min(lead, OPEN * TEMPERATURE)
        nested = not judged.names or not leader.names or contains(judged, leader)
        between = 0.0 if nested else distance(judgement, leader, judged)
        if nested or (lead > NEARER * between and between > SAME):
            heat = TEMPERATURE
        else:
            common = values.get(tuple(sorted(set(judged.names) & set(leader.names))))
            heat = temperature(
                top - max(common[0], 0.0) if common else top
            )  # a form that both share is off in both
        modes = foreknown(judged.fit.coordinates.unpack(judged.fit.x)[1]) if judged.names else 0.0
        found.append(-lead / heat + SPARING[min(len(judged.names), 3)] + modes)
    return found


def _beats(judgement: Judgement, judged: Judged) -> bool:
    """Whether physics outside the table is real and matters, and held-out runs do not object: it asks for no name."""
    if resembled(judged) is None:
        return False
    against = compare(judgement, judgement.base, judged)
    return (
        against.real
        and against.material > MATERIAL
        and not against.held_gain < max(HELD, AS_FORETOLD * against.foretold_held)
    )


def rank(judgement: Judgement) -> list[Ranked]:
    """Sets by tempered score, the base among them with score 0."""
    stands = {id(j) for j in standing(judgement)}
    fits: dict[tuple[str, ...], list[tuple[float, Judged]]] = {}
    for judged in judgement.judged:
        value = score(judgement, judged) if judged.names else math.log(0.5)
        if judged.names and id(judged) not in stands and not _beats(judgement, judged):
            value = min(value, 0.0) - NOT_STANDING
        fits.setdefault(judged.names, []).append((value, judged))
    best = {names: _of_fewest_numbers(scored) for names, scored in fits.items()}
    for names, (value, judged) in list(best.items()):
        inner = [v for v, other in list(best.values()) if other.names and contains(judged, other)]
        if inner:
            best[names] = (value - max(CONTAINING, OF_CONTAINED * max(inner)), judged)
    listed = [(value, judged) for value, judged in best.values() if resembled(judged) is None]
    for names, (value, judged) in list(best.items()):
        if resembled(judged) is not None:
            best[names] = (value - lead_asked(value, judged, listed), judged)
    for names, (value, judged) in list(best.items()):
        simpler = {
            other: v
            for other, (v, _) in best.items()
            if 0 < len(other) < len(names) and not set(other) < set(names)
        }
        parts = [pair for o, pair in best.items() if 0 < len(o) < len(names) and set(o) < set(names)]
        least = [(1.0 + _of_forms(part)) * v for v, part in parts]
        if 0.0 < value < max(least, default=0.0):
            best[names] = (-NOT_STANDING, judged)
        leading = [other for other, v in simpler.items() if value < LEADS_FEWER * v]
        if leading and not all(_beside_a_form(judgement, judged, best, other) for other in leading):
            best[names] = (min(value, 0.0) - NOT_STANDING, judged)
    belief = np.array(_belief(judgement, best))
    weights = np.exp(belief - belief.max())
    weights /= weights.sum()
    ranked = [
        Ranked(names, float(p), float(v), judged, compare(judgement, judgement.base, judged) if names else None)
        for (names, (v, judged)), p in zip(best.items(), weights, strict=True)
    ]
    return sorted(ranked, key=lambda r: (-r.probability, -r.score))


def _of_forms(judged: Judged) -> float:
    """Share of a set's score that another form of its laws may add [-]."""
    if len(judged.names) > 1:
        return BY_FORM
    return BY_EXACT if all(spec.exact for spec in judged.hypothesis.specs) else BY_FIRST


def _of_fewest_numbers(scored: Sequence[tuple[float, Judged]]) -> tuple[float, Judged]:
    """The best of the laws of one set of names; of those that are as good as it the one with the fewest numbers."""
    top = max(value for value, _ in scored)
    near = [pair for pair in scored if pair[0] >= top - AS_GOOD * abs(top)]
    return near[0] if len(near) == 1 else min(near, key=lambda pair: (pair[1].fit.coordinates.n, -pair[0]))


def _beside_a_form(
    judgement: Judgement, pair: Judged, best: dict[tuple[str, ...], tuple[float, Judged]], other: tuple[str, ...]
) -> bool:
    """Whether ``other`` is a form of one of the pair's members, friction with a hump or without, and none of them is the rest.

    What a form that is a little wrong leaves is what other forms at its place explain; the rest of the pair does not.
    """
    if len(other) != 1 or len(pair.names) != 2:
        return False
    parts = [name for name in pair.names if nested(name, other)]
    return len(parts) == 1 and (parts[0],) in best and of_its_own(judgement, best[(parts[0],)][1], pair)


def adequacy_of(judgement: Judgement, candidate: Judged) -> Adequacy:
    """The candidate against the base and the floor, over fitted and held-out runs."""
    runs = (*judgement.objective.prepared, *judgement.held.prepared)
    base, model = ((*j.predictions, *j.predictions_held) for j in (judgement.base, candidate))
    pushed = [_pushed(judgement, j) for j in (judgement.base, candidate)]
    return adequacy(runs, judgement.noise, base, model, *pushed)


def _pushed(judgement: Judgement, judged: Judged) -> list[Pushes | None]:
    """What the noise of every run's input does to a hypothesis."""
    theta, effects = judged.fit.coordinates.unpack(judged.fit.x)
    return [
        *judgement.objective.pushes(theta, effects, judged.predictions),
        *judgement.held.pushes(theta, effects, judged.predictions_held),
    ]


def _acts_elsewhere(judgement: Judgement, top: Ranked, fit: Adequacy) -> bool:
    """Whether a set touches nothing of what runs driven alike have in common, and explains more where it does act.

    A ripple in motions is not held against hits, in which something else is left.
    """
    told = [b for b in fit.blocks if b.excess > EXCESS]
    touched = any(abs(b.base_common - b.model_common) > TOUCHED * b.base_common for b in told)
    return not touched and compare(judgement, judgement.base, top.judged).material > fit.model_left


def decide(judgement: Judgement) -> Decision:
    """The verdict on the evidence."""
    ranking = tuple(rank(judgement))
    top = ranking[0]
    fit = adequacy_of(judgement, top.judged)
    if not top.names:
        lack = max(
            fit.base_left / LACKING,
            grows_with_signal(judgement, fit) / GROWING,
            foreseen(judgement, fit) / FORESEEN,
        )
        if lack > 1.0:
            return Decision("unknown", judgement.base, beyond(lack), ranking, "outside-catalogue", (), fit)
        sure = top.probability * beyond(1.0 / max(lack, 1e-9))
        return Decision("none", judgement.base, sure, ranking, None, (), fit)
    if resembled(top.judged) is not None:
        return Decision("unknown", judgement.base, top.probability, ranking, "outside-catalogue", (), fit)
    if fit.explained < EXPLAINED and fit.model_left > MATERIAL_LEFT and not _acts_elsewhere(judgement, top, fit):
        sure = beyond(EXPLAINED / max(fit.explained, 0.05))
        return Decision("unknown", top.judged, sure, ranking, "outside-catalogue", (), fit)
    if len(top.names) >= TOO_MANY:
        return Decision("unknown", top.judged, beyond(1.5), ranking, "outside-catalogue", (), fit)
    growing = still_grows(judgement, fit, NEARLY_ALL)
    if growing > NOT_FOLLOWED and not fit.at_least > NEARLY_ALL:
        return Decision(
            "unknown", top.judged, beyond(growing / NOT_FOLLOWED), ranking, "outside-catalogue", (), fit
        )
    beyond_noise = left_in_proportion(judgement, fit, EXPLAINED)
    if beyond_noise > 1.0:
        return Decision("unknown", top.judged, beyond(beyond_noise), ranking, "outside-catalogue", (), fit)
    near = [r for r in ranking if r.names and r.probability > top.probability * math.exp(-NEAR)]
    others = [
        r for r in near if r is not top and not holds(r.judged, top.judged)
    ]  # between those the simpler is named
    if top.probability < (SURE if len(top.names) == 1 else SURE_OF_SETS) and others:
        shared = _shared(ranking, near)
        if shared is not None:
            sure = sum(r.probability for r in ranking if set(shared.names) <= set(r.names))
            alike = tuple(r.names for r in near)
            return Decision(
                "effects", shared.judged, sure, ranking, None, alike, adequacy_of(judgement, shared.judged)
            )
        together = sum(r.probability for r in near)
        alike = tuple(r.names for r in near)
        return Decision("unknown", top.judged, together, ranking, "not-identifiable", alike, fit)
    return Decision("effects", top.judged, top.probability, ranking, None, (), fit)


def nothing_named(decision: Decision, base: Judged) -> Decision:
    """``none`` in place of a name that something beside the evidence speaks against."""
    return replace(decision, verdict="none", chosen=base, probability=LIKELY, unknown_reason=None, candidates=())


def with_remainder(decision: Decision, left: Sequence[Remainder]) -> Decision:
    """The answer in view of what still follows the input: there it is not all of it, and with nothing named, unknown."""
    standing_out = [r for r in left if r.stands]
    if decision.verdict == "effects":
        explained = next(r.comparison for r in decision.ranking if r.judged is decision.chosen)
        standing_out = [
            r for r in standing_out if explained is None or r.material > BESIDE_NAMED * explained.material
        ]
    if not standing_out or decision.verdict == "unknown" or decision.candidates:
        return decision
    most = max(r.gain for r in standing_out)
    if decision.verdict == "none":
        return replace(
            decision, verdict="unknown", probability=beyond(most / FOLLOWS), unknown_reason="outside-catalogue"
        )
    named = next(r.score for r in decision.ranking if r.judged is decision.chosen)
    if most < MORE_LEFT * named:
        return decision
    return replace(
        decision,
        verdict="unknown",
        probability=beyond(most / (MORE_LEFT * named)),
        unknown_reason="outside-catalogue",
    )


def _owed(found: Sequence[Remainder]) -> float:
    """Nats by the noise that the best answer leaves, by which what is named is scored too."""
    return sum((r.gain + r.held_gain) * r.dispersion for r in found if r.stands)


def with_followed_input(decision: Decision, left: Sequence[Remainder], at_base: Sequence[Remainder]) -> Decision:
    """The answer where the input itself, at a few lags, explains about as much as the named effects: a pickup does that.

    Or where a quarter of a channel still follows it.

    Args:
        left: What the named effects leave and follows the input: nothing, where they are right and all there is.
        at_base: The same of the base; what the named effects took of it is what they are held against.
    """
    if decision.verdict != "effects" or decision.candidates or not any(r.stands for r in left):
        return decision  # what rivals share is all that is named, and each of them follows the input beside it
    share = max(r.material for r in left if r.stands) / NOT_FOLLOWED
    followed = _owed(at_base) - _owed(left)  # what is left owes to something else
    named = next((r.score for r in decision.ranking if r.judged is decision.chosen), math.inf)
    ratio = followed / (AS_MUCH_AS_NAMED * named) if _owed(left) >= BY_FORM * named else 0.0
    ratio = max(ratio, share)
    if ratio < 1.0:
        return decision
    return replace(decision, verdict="unknown", probability=beyond(ratio), unknown_reason="outside-catalogue")


def with_changes(decision: Decision, found: Sequence[Change]) -> Decision:
    """The answer in view of effects that don't keep their size within a run: what was named only resembles what is there."""
    standing_out = [c for c in found if c.stands]
    if not standing_out or decision.verdict != "effects":
        return decision
    most = max(abs(c.relative) for c in standing_out)
    return replace(
        decision, verdict="unknown", probability=beyond(most / CHANGES), unknown_reason="outside-catalogue"
    )


def with_force_left(decision: Decision, lack: float) -> Decision:
    """The answer in view of a force that the base leaves along a recorded path, ``lack`` times what it may: then not ``none``."""
    if decision.verdict != "none" or lack <= 1.0:
        return decision
    return replace(decision, verdict="unknown", probability=beyond(lack), unknown_reason="outside-catalogue")


def _shared(ranking: Sequence[Ranked], near: Sequence[Ranked]) -> Ranked | None:
    """What all sets that can't be told apart have in common, where it stands by itself: that much is known."""
    common = set(near[0].names).intersection(*(r.names for r in near[1:]))
    found = next((r for r in ranking if r.names and set(r.names) == common), None)
    return found if found is not None and found.score > 0.0 else None


def with_unknown_force(judgement: Judgement, decision: Decision, table: Judged) -> Decision:
    """The answer in view of a force without a name.

    Where that force carries over it is the model that is handed on; where nothing was found and it stands beyond doubt
    and matters, something is there that no candidate explains.
    """
    against = compare(judgement, decision.chosen, table)
    if math.isnan(against.held_gain) or not (against.stands or against.evident):
        return decision
    if decision.verdict == "none":
        if against.gain < UNNAMED or against.material < UNHEARD:
            return decision
        sure = beyond(against.gain / UNNAMED)
        return replace(
            decision, verdict="unknown", chosen=table, probability=sure, unknown_reason="outside-catalogue"
        )
    return replace(decision, chosen=table)


def beyond(ratio: float) -> float:
    """Belief from how far a figure lies beyond its limit: 1/2 at it, 0.9 at three times."""
    return ratio**2 / (1.0 + ratio**2)
