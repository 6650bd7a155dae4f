"""No effect is named whose model foretells held-out runs worse than the base: the last word on a decision."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from jointscope.diagnosis.adjudicate import compare, score
from jointscope.diagnosis.effects.periodic import MOTOR_ORDER, turn_of
from jointscope.diagnosis.errors import (
    ChannelError,
    Free,
    channel_errors,
    grouped,
    mean_error,
    mean_floor,
    without_drift,
)
from jointscope.diagnosis.gates import AS_FORETOLD, REAL, Comparison
from jointscope.diagnosis.held_out_detail import shown_between_devices, wind_up_error
from jointscope.diagnosis.intervals import like_nothing
from jointscope.diagnosis.outside import resembled
from jointscope.diagnosis.verdict import LACKING, TOO_MANY, adequacy_of, nothing_named

if TYPE_CHECKING:
    from jointscope.diagnosis.adjudicate import Judged
    from jointscope.diagnosis.effects import ActiveEffect
    from jointscope.diagnosis.pipeline import Diagnosis
    from jointscope.diagnosis.problem import Output, Problem
    from jointscope.diagnosis.verdict import Decision

WORSE = 0.01  # of the base's held-out error
DRIFTING = 0.05  # the same where only angles that drift off are worse, or the runs confirm the effect step by step
CLEARLY = 0.9  # of the base's error over what can be foretold, which a named effect must undercut where all in all it is worse
NEARER = 0.6  # the same of what is left beyond the noise
UNREACHED = (
    0.005  # of the signal, by which runs that can't show an effect may be foretold worse: they refute nothing
)
LOST = 1.0  # error over signal beyond which a prediction tells nothing, and further off no less
NEARLY_AS_MUCH = (
    0.95  # of the chosen set's score, with which another fit of the same effects may be handed on instead ...
)
TRIED = 4  # ... and how many such are
UNWOUND = 0.3  # of the wind-up, by which a model of the joint that is one is off at most ...
TWICE = 2.0  # ... or so many times the base's error of it
LOST_PHASE = 1.0  # rad of a line's own, by which the motor may be elsewhere than foretold
NEARLY_WHOLE, HARDLY_NEARER, FAR_OFF = (
    0.9,  # of a mismatch that named effects explain, below which they are asked what they do for held-out runs ...
    0.7,  # ... of what the base leaves there beyond the noise, above which that is little ...
    0.05,  # ... where as much of the signal is left
)
SOMEWHERE = (
    0.001  # of the base's error in one channel of one experiment, by which a named effect must lower it there
)
FAINT = (
    3.0 / 1.96
)  # times its 95 % interval, within which an effect is not far from nothing: three standard errors
SECOND = 0.5  # of the leading set's score, that a set which foretells them better must have to be named instead
SECOND_CHOICE = 0.75  # of its probability that such an answer is given


def clearly_better(told: Sequence[ChannelError], base: Sequence[ChannelError]) -> bool:
    """Whether the errors are clearly smaller than the base's, as they are or over what noise leaves of them anyway."""
    return mean_error(told) < CLEARLY * mean_error(base) or _beyond_noise(told) < NEARER * _beyond_noise(base)


def confirmed(against: Comparison) -> bool:
    """Whether the held-out runs, tied to what was recorded, show the effect by themselves."""
    return against.held_gain > max(REAL, AS_FORETOLD * against.foretold_held)


def borne(whole: float, told: Sequence[ChannelError], base: Sequence[ChannelError], sure: bool) -> bool:
    """Whether a named effect stays although all in all it foretells worse.

    Args:
        whole: Its mean error over the base's, angles that drift off open loop too [-].
        told: Its errors without those.
        base: The base's, likewise.
        sure: Whether held-out runs confirm it.
    """
    no_worse = not told or mean_error(told) <= mean_error(base)  # nothing was recorded but what drifts off
    little = (sure or no_worse) and whole < 1.0 + DRIFTING
    return little or (sure and no_worse) or clearly_better(told, base)


def explains_little(explained: float, told: Sequence[ChannelError], base: Sequence[ChannelError]) -> bool:
    """Whether what was named is no answer: far from all of the fit, and little of the held-out runs, which stay far off.

    Args:
        explained: Share of the mismatch's energy in the fitted runs; ``nan`` where none is known.
        told: The errors of the named effects' model, without angles that drift off open loop.
        base: The base's, likewise.
    """
    left = _beyond_noise(told)
    return explained < NEARLY_WHOLE and left > FAR_OFF and left > HARDLY_NEARER * _beyond_noise(base)


def may_follow(told: Sequence[ChannelError], base: Sequence[ChannelError]) -> bool:
    """Whether an effect may be named in place of a likelier one that foretold worse: by errors that are no worse."""
    return not told or mean_error(told) <= (1.0 + WORSE) * mean_error(base)


def better_somewhere(told: Sequence[ChannelError], base: Sequence[ChannelError]) -> bool:
    """Whether any channel of any experiment is foretold better than by the base, a hit's own gain and time taken off or not.

    So it is, for all that these runs can say, where the base is beyond telling.
    """

    def blocks(errors: Sequence[ChannelError], apart: bool) -> dict[tuple[str, str], float]:
        own = [replace(e, error=e.apart) if apart and math.isfinite(e.apart) else e for e in errors]
        return {
            (experiment, channel): error
            for experiment, channels in grouped(own).items()
            for channel, error in channels.items()
        }

    compared = [
        (blocks(told, apart)[key], error) for apart in (False, True) for key, error in blocks(base, apart).items()
    ]
    return any(error > LOST or own < (1.0 - SOMEWHERE) * error for own, error in compared)


def noise_alone(errors: Sequence[ChannelError]) -> bool:
    """Whether what is foretold is wrong by no more than the channels' noise: then nothing that makes it worse is borne."""
    known = [e for e in errors if math.isfinite(e.floor)]
    return bool(known) and mean_error(known) <= mean_floor(known)


def _beyond_noise(errors: Sequence[ChannelError]) -> float:
    """Mean of what the errors are beyond their floors [-]; the errors themselves where no floor is known."""
    floors = [e.floor if math.isfinite(e.floor) else 0.0 for e in errors]
    return float(
        np.mean([math.sqrt(max(e.error**2 - f**2, 0.0)) for e, f in zip(errors, floors, strict=True)] or [0.0])
    )


def out_of_phase(problem: Problem, free: Free, held: Sequence[int], judged: Judged) -> bool:
    """Whether a line of this model is foretold at another phase than it has: from inputs alone the motor is elsewhere.

    Told by its recorded angle, in a held-out run in which it turns: what is off by so much of the line's period refutes nothing.
    """
    theta, effects = judged.fit.coordinates.unpack(judged.fit.x)
    for i in held:
        run = problem.runs[i]
        orders = [_per_motor_turn(effect, run.ratio) for effect in effects if turn_of(effect)]
        recorded, foretold = _angle_of_motor(run.outputs), _angle_of_motor(run.declared)
        if not orders or recorded is None or foretold is None:
            continue
        output, declared = run.outputs[recorded], run.declared[foretold]
        told = np.interp(output.times, declared.times, free(run, theta, effects, problem)[foretold])
        turned, off = (x - x[0] for x in (output.data[output.mask], (output.data - told)[output.mask]))
        if np.ptp(turned) > math.tau / max(orders) and max(orders) * np.sqrt(np.mean(off**2)) > LOST_PHASE:
            return True
    return False


def between_devices(problem: Problem, held: Sequence[int], base: Judged, judged: Judged) -> bool:
    """Whether encoders of two devices show the named effects in the held-out runs' wind-up, which neither angle does."""
    models = [j.fit.coordinates.unpack(j.fit.x) for j in (base, judged)]
    return shown_between_devices(problem, held, models[0], models[1])


def unwound(own: float, of_base: float) -> bool:
    """Whether a model has lost the wind-up between two encoders, errors over signal, that the base foretells."""
    return own > UNWOUND and own > TWICE * of_base


def _angle_of_motor(outputs: Sequence[Output]) -> int | None:
    """Where among outputs the motor's angle stands; what is foretold is every declared channel, at its stream's own rate."""
    return next((k for k, o in enumerate(outputs) if (o.quantity, o.location) == ("angle", "motor")), None)


def _per_motor_turn(line: ActiveEffect, ratio: float) -> float:
    order = line.values[[p.name for p in line.spec.parameters].index("order")]
    return order if turn_of(line) == MOTOR_ORDER.unit else order / ratio


def _same_names(diagnosis: Diagnosis) -> list[Judged]:
    """Other fits of the same effects that explain nearly as much, best first: open loop each drifts off by itself."""
    judgement, chosen = diagnosis.judgement, diagnosis.decision.chosen
    alike = [j for j in judgement.judged if j.names == chosen.names and j is not chosen]
    if not alike:
        return []
    least = NEARLY_AS_MUCH * score(judgement, chosen)
    scores = [(score(judgement, j), j) for j in alike]
    return [j for value, j in sorted(scores, key=lambda pair: -pair[0]) if value > least][:TRIED]


def handed_on(diagnosis: Diagnosis, free: Free) -> Diagnosis:
    """The same with a model that foretells the held-out runs from their inputs no worse than the base does.

    A named effect that does not is not shown to improve anything: another fit of it that does is handed on, or the next
    set that does is named, or none is. An unnamed force that does not is left out. Open loop an angle drifts off
    whatever the model, and a hit has a gain of its own: an effect that is worse over all channels stays where it is no
    worse over those that the model alone tells and little worse as a whole, or where it is clearly better over them. So
    it does where those runs confirm it step by step, from the recorded path, and it is little worse as a whole: what
    grows over a whole run then is an error of something else (a torque log's zero, a drive's law), for or against which
    the effect works by chance. Where those runs confirm it and only angles that drift off are foretold worse, it stays
    however far they do; and where they never come to the place that shows it (a stop), while they are foretold about as
    well. Where the base foretells them to within their noise none of this excuses an effect that does not.

    What is better in no channel of any experiment is shown by none: the likelihood had it from the colour of a noise.
    The wind-up between two encoders does not drift: what loses it, where the base foretells it, is no answer.
    Nor is one effect that is all in all no better and not far from nothing.

    What explains far from all of the fitted runs and little of the held-out ones is no answer either (``explains_little``).
    """
    decision, held = diagnosis.decision, diagnosis.split.held_out
    base = diagnosis.judgement.base
    if decision.verdict == "none" or decision.chosen is base or not held:
        return diagnosis

    problem = diagnosis.problem

    def errors_of(judged: Judged) -> tuple[ChannelError, ...]:
        theta, effects = judged.fit.coordinates.unpack(judged.fit.x)
        return channel_errors(problem, free, held, theta, effects, diagnosis.judgement.noise)

    def error(judged: Judged) -> tuple[float, list[ChannelError]]:
        errors = errors_of(judged)
        told = without_drift(problem, errors)
        own = [e.apart if math.isfinite(e.apart) else e.error for e in told]
        return mean_error(errors), [replace(e, error=min(x, LOST)) for e, x in zip(told, own, strict=True)]

    def twist(judged: Judged) -> float:
        return wind_up_error(problem, held, judged.fit.coordinates.unpack(judged.fit.x))

    of_base, twist_of_base = error(base), twist(base)
    enough = noise_alone(errors_of(base))

    def worse(judged: Judged) -> bool:
        whole, told = error(judged)
        if unwound(twist(judged), twist_of_base):
            return True
        if decision.verdict == "effects" and not enough:
            against = compare(diagnosis.judgement, base, judged)
            unreached = against.unreached and whole < of_base[0] + UNREACHED
            sure = confirmed(against)
            if unreached or borne(whole / max(of_base[0], 1e-300), told, of_base[1], sure):
                return False
            if sure and out_of_phase(problem, free, held, judged):
                return False
        return whole > (1.0 + WORSE) * of_base[0]

    def unlisted() -> Decision:
        return replace(
            decision, verdict="unknown", chosen=base, unknown_reason="outside-catalogue", candidates=(),
            adequacy=adequacy_of(diagnosis.judgement, base),
        )  # fmt: skip

    def shown(judged: Judged) -> bool:
        against = compare(diagnosis.judgement, base, judged)
        if against.unreached or (confirmed(against) and out_of_phase(problem, free, held, judged)):
            return True
        if any(
            spec.profiled for spec in judged.hypothesis.specs
        ):  # what every run has for itself no input foretells
            return True
        if confirmed(against) and not error(judged)[1]:  # nothing was recorded but what drifts off
            return True
        faint = len(judged.names) == 1 and like_nothing(diagnosis.judgement.objective, judged.fit, FAINT)
        if faint and error(judged)[0] >= of_base[0]:
            return False
        if confirmed(against) and between_devices(problem, held, base, judged):
            return True  # both ends carry the drive's error alike, their difference does not
        return better_somewhere(errors_of(judged), errors_of(base))

    def bare() -> Decision:
        fit = adequacy_of(diagnosis.judgement, base)
        if fit.base_left > LACKING:
            return unlisted()
        return replace(nothing_named(decision, base), adequacy=fit)

    if not worse(decision.chosen):
        named, told = decision.verdict == "effects", error(decision.chosen)[1]
        if named and not shown(decision.chosen):
            return replace(diagnosis, decision=bare())
        little = named and explains_little(decision.adequacy.explained, told, of_base[1])
        return replace(diagnosis, decision=unlisted()) if little else diagnosis
    if decision.verdict == "unknown":
        return replace(diagnosis, decision=replace(decision, chosen=base))
    for judged in _same_names(diagnosis):
        if not worse(judged):
            fit = adequacy_of(diagnosis.judgement, judged)
            return replace(diagnosis, decision=replace(decision, chosen=judged, adequacy=fit))
    top = decision.ranking[0]
    listed = [r for r in decision.ranking[1:5] if r.names and resembled(r.judged) is None]
    of_three = any(
        r.score > top.score and r.probability == 0.0 and len(r.names) >= TOO_MANY for r in decision.ranking
    )
    others = (
        [] if of_three else [r for r in listed if r.score > SECOND * top.score]
    )  # of three, no other two instead
    # what the same runs, read step by step, refute beside the leading set is not nearer for drifting less
    others = [r for r in others if not confirmed(compare(diagnosis.judgement, r.judged, top.judged))]
    kept = [r for r in others if not worse(r.judged) and may_follow(error(r.judged)[1], of_base[1])]
    if kept:
        total = sum(r.probability for r in kept)  # 0 where all are beyond reach of the one that does not stand
        sure = SECOND_CHOICE * (kept[0].probability / total if total > 0.0 else 1.0 / len(kept))
        fit = adequacy_of(diagnosis.judgement, kept[0].judged)
        changed = replace(decision, chosen=kept[0].judged, probability=sure, candidates=(), adequacy=fit)
    else:
        changed = unlisted()
    return replace(diagnosis, decision=changed)
