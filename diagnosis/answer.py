"""``diagnosis.json`` (format ``jointscope-diagnosis/1``) from a diagnosis, as plain data."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from jointscope.diagnosis.adjudicate import Judged, compare
from jointscope.diagnosis.between_runs import varying_json
from jointscope.diagnosis.calibration import as_known, calibrate, features, kind_of, learnt_map
from jointscope.diagnosis.constancy import changes_json
from jointscope.diagnosis.describe import DEPENDS, showing
from jointscope.diagnosis.errors import (
    ChannelError,
    Free,
    channel_errors,
    grouped,
    mean_error,
    mean_floor,
    without_drift,
)
from jointscope.diagnosis.gates import Comparison
from jointscope.diagnosis.held_out_detail import held_out_detail
from jointscope.diagnosis.in_contract import as_cubic, largest_first
from jointscope.diagnosis.intervals import Estimate, estimates
from jointscope.diagnosis.outside import resembled
from jointscope.diagnosis.power import unseen_json
from jointscope.diagnosis.refit import with_fresh_jacobian
from jointscope.diagnosis.remainder import remainder_json
from jointscope.diagnosis.twins import told_by_frequency

if TYPE_CHECKING:
    from jointscope.diagnosis.pipeline import Diagnosis
    from jointscope.diagnosis.prepare import Problem

FORMAT = "jointscope-diagnosis/1"
PUBLIC = {"load_inertia": "inertia"}  # base parameter -> key of the contract
REFERENCES = {
    "stiffness": "stiffness_reference", "load_inertia": "inertia_reference", "damping": "damping_reference",
    "motor_damping": "motor_damping", "load_damping": "load_damping",
}  # fmt: skip
ROTATIONAL = {
    "stiffness": "N m/rad", "damping": "N m s/rad", "load_inertia": "kg m^2", "motor_inertia": "kg m^2",
    "motor_damping": "N m s/rad", "load_damping": "N m s/rad", "gravity_moment": "N m", "efficiency": "1",
    "torque_scale": "1", "torque_offset": "N m", "torque_age": "s", "drive_gain": "N m s/rad", "drive_integral": "N m/rad",
}  # fmt: skip
TRANSLATIONAL = {
    "stiffness": "N/m", "damping": "N s/m", "load_inertia": "kg", "motor_inertia": "kg", "motor_damping": "N s/m",
    "load_damping": "N s/m", "gravity_moment": "N", "efficiency": "1", "torque_scale": "1", "drive_gain": "N s/m",
    "drive_integral": "N/m", "torque_offset": "N", "torque_age": "s",
}  # fmt: skip
FORETELLING = 6  # sets of the ranking, beside the base, whose held-out errors are stated
SHIFTED = 3.0  # sigma beyond which a rough value is said to have been off


def number(value: float) -> float | None:
    """A finite number, or null."""
    return float(value) if math.isfinite(value) else None


def as_parameter(estimate: Estimate, unit: str) -> dict[str, Any]:
    """``{value, unit, interval95}``."""
    return {
        "value": number(estimate.value),
        "unit": unit,
        "interval95": [number(estimate.low), number(estimate.high)],
    }


def units_of(problem: Problem) -> dict[str, str]:
    """Units of the base parameters; per unit of the input where no torque is calibrated."""
    table = ROTATIONAL if problem.rig.motion == "rotational" else TRANSLATIONAL
    if problem.torque_calibrated:
        return dict(table)
    return {name: unit if unit == "1" else f"{unit} per unit of input" for name, unit in table.items()}


def base_parameters(problem: Problem, judged: Judged, all_estimates: tuple[Estimate, ...]) -> dict[str, Any]:
    """``parameters``: the joint's own, nuisances left out, merged ones under the name of their sum."""
    units, base = units_of(problem), problem.base
    found = {}
    for position, index in enumerate(judged.fit.coordinates.free):
        name = base.names[index]
        if base.nuisance[index]:
            continue
        key = base.merged.get(name, PUBLIC.get(name, name))
        found[key] = as_parameter(all_estimates[position], units.get(name, "1"))
    return found


def parameter_shift(problem: Problem, judged: Judged, all_estimates: tuple[Estimate, ...]) -> dict[str, Any]:
    """Rough nameplate values that the recordings contradict by more than three sigma."""
    found = {}
    for position, index in enumerate(judged.fit.coordinates.free):
        name = problem.base.names[index]
        reference = getattr(problem.rig, REFERENCES.get(name, ""), None) if name in REFERENCES else None
        if reference is None or problem.base.nuisance[index] or name in problem.base.merged:
            continue
        estimate = all_estimates[position]
        if estimate.sigma > 0.0 and abs(estimate.value - reference) > SHIFTED * estimate.sigma:
            found[PUBLIC.get(name, name)] = {
                "nameplate": float(reference),
                "fitted": estimate.value,
                "sigma": estimate.sigma,
            }
    return found


def effects_json(
    judged: Judged, all_estimates: tuple[Estimate, ...], probability: dict[str, float]
) -> list[dict[str, Any]]:
    """``effects``: name, location, probability, parameters and a sentence, most certain first."""
    where = judged.fit.coordinates
    theta, effects = where.unpack(judged.fit.x)
    found: dict[tuple[str, str], dict[str, Any]] = {}
    parts = list(zip(where.effects, effects, where.effect_slices(), strict=True))
    for spec, effect, piece in largest_first(parts):
        name = f"{spec.name}@{spec.location}"
        parameters = {
            p.name: as_parameter(all_estimates[i], p.unit)
            for p, i in zip(spec.parameters, range(piece.start, piece.stop), strict=True)
        }
        cubic = as_cubic(effect, all_estimates[piece], float(theta[0]))
        if cubic is not None:
            parameters["cubic"] = as_parameter(*cubic)
        entry = found.setdefault(
            (spec.name, spec.location),
            {
                "effect": spec.name,
                "location": spec.location,
                "probability": probability.get(name, 0.0),
                "parameters": {},
                "law": spec.variant,
                "evidence": "",
            },
        )
        entry["parameters"] = {**parameters, **entry["parameters"]}
    return sorted(found.values(), key=lambda e: (-e["probability"], e["effect"], e["location"]))


def evidence_text(comparison: Comparison, base: float, augmented: float, runs: int) -> str:
    """A sentence or two that a lab engineer can check."""
    text = (
        f"Against the refitted base model the likelihood of the fitted runs rises by {comparison.gain:.0f} nats net of the "
        f"added parameters, and what is explained of some channel is {100 * comparison.material:.1f} % of its signal (rms)."
    )
    if runs and math.isfinite(base):
        text += (
            f" On {runs} held-out run{'s' if runs > 1 else ''}, predicted from inputs alone, the mean relative error goes "
            f"from {base:.4f} to {augmented:.4f}; {100 * comparison.share_of_runs:.0f} % of those that could show it improve."
        )
    return text


def ranking_json(diagnosis: Diagnosis, free: Free, held_out: dict[str, Any] | None) -> list[dict[str, Any]]:
    """``ranking``: every set with its probability, the leading ones with what they would foretell held-out runs to."""
    problem, judgement = diagnosis.problem, diagnosis.judgement
    stated = {
        id(judgement.base): (held_out or {}).get("base_error"),
        id(diagnosis.decision.chosen): (held_out or {}).get("augmented_error"),
    }
    found: list[dict[str, Any]] = []
    for r in [r for r in diagnosis.decision.ranking[:20] if resembled(r.judged) is None]:
        entry: dict[str, Any] = {
            "effects": list(r.names), "probability": round(r.probability, 6), "score": round(r.score, 3),
        }  # fmt: skip
        if id(r.judged) in stated:
            entry["held_out_error"] = stated[id(r.judged)]
        elif held_out is not None and len(found) < FORETELLING:
            theta, effects = r.judged.fit.coordinates.unpack(r.judged.fit.x)
            runs = diagnosis.split.held_out
            errors = channel_errors(problem, free, runs, theta, effects, judgement.noise)
            entry["held_out_error"] = number(mean_error(errors)) if errors else None
        found.append(entry)
    return found


def held_out_json(
    problem: Problem, free: Free, diagnosis: Diagnosis
) -> tuple[dict[str, Any] | None, tuple[ChannelError, ...]]:
    """``held_out``, or ``None`` where no run was kept back."""
    held = diagnosis.split.held_out
    if not held:
        return None, ()
    judgement, chosen = diagnosis.judgement, diagnosis.decision.chosen
    noise = judgement.noise
    base_theta, none = judgement.base.fit.coordinates.unpack(judgement.base.fit.x)
    theta, effects = chosen.fit.coordinates.unpack(chosen.fit.x)
    base = channel_errors(problem, free, held, base_theta, none, noise)
    augmented = channel_errors(problem, free, held, theta, effects, noise) if effects else base
    return {
        "runs": sorted(problem.runs[i].run.id for i in held),
        "base_error": number(mean_error(base)),
        "augmented_error": number(mean_error(augmented)),
        "noise_floor": number(mean_floor(augmented)),
        "by_experiment": {"base": grouped(base), "augmented": grouped(augmented)},
        **_apart_from_drift(problem, base, augmented),
        **(
            {}
            if problem.rig.topology == "arm"
            else held_out_detail(problem, held, (base_theta, none), (theta, effects))
        ),
    }, augmented


def _apart_from_drift(
    problem: Problem, base: Sequence[ChannelError], augmented: Sequence[ChannelError]
) -> dict[str, Any]:
    """``without_drift`` of ``held_out``, where some channels drift off open loop and others do not."""
    own, ours = without_drift(problem, base), without_drift(problem, augmented)
    if not own or len(own) == len(base):
        return {}
    figures = {"base": mean_error(own), "augmented": mean_error(ours), "noise_floor": mean_floor(ours)}
    return {"without_drift": {name: number(value) for name, value in figures.items()}}


def marginal(diagnosis: Diagnosis) -> dict[str, float]:
    """Probability of each effect: the sum over the sets that hold it."""
    total: dict[str, float] = {}
    for ranked in diagnosis.decision.ranking:
        for name in ranked.names:
            total[name] = total.get(name, 0.0) + ranked.probability
    return total


def diagnosis_json(diagnosis: Diagnosis, free: Free) -> dict[str, Any]:
    """The whole answer."""
    weighed = probability_json(diagnosis)
    diagnosis = replace(diagnosis, decision=as_known(diagnosis.decision, weighed["verdict_probability"]))
    problem, decision, judgement = diagnosis.problem, diagnosis.decision, diagnosis.judgement
    chosen = decision.chosen
    fit = with_fresh_jacobian(judgement.objective, chosen.fit)
    found = estimates(judgement.objective, fit)
    held_out, _ = held_out_json(problem, free, diagnosis)
    comparison = next((r.comparison for r in decision.ranking if r.names == chosen.names), None)
    known = {
        name: max(marginal(diagnosis).get(name, 0.0), weighed["verdict_probability"]) for name in chosen.names
    }
    effects = effects_json(chosen, found, known) if decision.verdict == "effects" else []
    if comparison is not None:
        base_error = held_out["base_error"] if held_out else math.nan
        augmented = held_out["augmented_error"] if held_out else math.nan
        runs = len(diagnosis.split.held_out)
        text = evidence_text(
            comparison,
            math.nan if base_error is None else base_error,
            math.nan if augmented is None else augmented,
            runs,
        )
        if held_out is None:
            text = "A candidate only, since nothing could be held out. " + text
        for effect in effects:
            effect["evidence"] = text + told_by_frequency(effect["law"])
    answer: dict[str, Any] = {
        "format": FORMAT,
        "verdict": decision.verdict,
        "effects": effects,
        "ranking": ranking_json(diagnosis, free, held_out),
        "where": where_json(diagnosis),
        "held_out": held_out,
        "black_box": black_box_json(diagnosis, free),
        "adequacy": {
            "explained": number(decision.adequacy.explained),
            "base_left": decision.adequacy.base_left,
            "model_left": decision.adequacy.model_left,
        },
        "parameters": base_parameters(problem, chosen, found),
        **weighed,
        "unknown_reason": decision.unknown_reason,
        "parameter_shift": parameter_shift(problem, chosen, found),
        **next_json(diagnosis),
        "remainder": remainder_json(diagnosis.remainder),
        "changes": changes_json(diagnosis.changes),
        "between_runs": varying_json(diagnosis.differing),
        "not_seen": unseen_json(diagnosis.not_seen),
        "noise": {
            "hit_gain": judgement.noise.gain,
            "hit_timing_s": judgement.noise.timing,
            "base_converged": diagnosis.stage.fit.converged,
            "base_gradient_ratio": number(diagnosis.stage.fit.gradient_ratio),
        },
        "findings": list(problem.findings),
    }
    stranger = resembled(decision.ranking[0].judged)
    if decision.verdict == "unknown" and stranger is not None:
        answer["resembles"] = {"law": stranger.law, "location": stranger.location}
    if decision.candidates:
        answer["candidates"] = [list(names) for names in decision.candidates]
    if held_out is None:
        answer["held_out_reason"] = diagnosis.split.reason
    return answer


def probability_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """``verdict_probability``, calibrated where the campaign lies in the calibrated range, and ``calibration``."""
    decision, found = diagnosis.decision, features(diagnosis)
    kind = kind_of(decision.verdict, decision.unknown_reason)
    known = calibrate(found, kind, decision.probability, learnt_map())
    return {
        "verdict_probability": round(known.probability, 4),
        "calibration": {
            "in_domain": known.in_domain,
            "reason": known.reason,
            "stated_probability": round(decision.probability, 4),
            "features": found,
        },
    }


def next_json(diagnosis: Diagnosis) -> dict[str, Any]:
    """``next_experiment`` and what every simulated item of the menu is expected to bring."""
    found = diagnosis.suggestion
    if found is None:
        return {"next_experiment": None, "next_experiment_detail": None}
    return {
        "next_experiment": found.text,
        "next_experiment_detail": {
            "item": found.key,
            "pair": None if found.pair is None else [list(names) for names in found.pair],
            "menu": [
                {
                    "item": item.key,
                    "expected_gain": round(item.expected_gain, 3),
                    "distance": round(item.distance, 2),
                }
                for item in found.menu
            ],
        },
    }


def where_json(diagnosis: Diagnosis) -> dict[str, Any] | None:
    """``where``: place, band, runs and what it depends on; ``None`` where nothing was found."""
    decision = diagnosis.decision
    if decision.verdict == "none":
        return None
    shown = showing(diagnosis.judgement, decision.chosen)
    specs = decision.chosen.hypothesis.specs
    names = [spec.name for spec in specs]
    locations = list(dict.fromkeys(spec.location for spec in specs))
    location: str | None
    if decision.verdict == "effects":
        location = locations[0]
    else:
        candidates = {name.split("@")[1] for names in decision.candidates for name in names}
        stranger = resembled(decision.ranking[0].judged)
        found = diagnosis.places.location if stranger is None else stranger.location
        location = candidates.pop() if len(candidates) == 1 else found
    depends = list(dict.fromkeys(d for name in names for d in DEPENDS.get(name, ())))
    if decision.unknown_reason == "outside-catalogue":
        depends = [spec.variant for spec in specs if spec.name == "latent-law"]
    return {
        "location": location,
        "locations": locations if decision.verdict == "effects" else [],
        "frequency_hz": None if shown.frequency_hz is None else list(shown.frequency_hz),
        "runs": list(shown.runs),
        "depends_on": depends,
        "by_unnamed_force": diagnosis.places.probabilities,
    }


def black_box_json(diagnosis: Diagnosis, free: Free) -> dict[str, Any] | None:
    """A force without a name of nine nodes, fitted to the same runs: what flexibility alone buys, and its shape."""
    box = diagnosis.black_box
    if box is None:
        return None
    table = diagnosis.places.tables[0]
    theta, effects = box.fit.coordinates.unpack(box.fit.x)
    against = compare(diagnosis.judgement, diagnosis.judgement.base, box)
    errors = channel_errors(
        diagnosis.problem, free, diagnosis.split.held_out, theta, effects, diagnosis.judgement.noise
    )
    return {
        "location": table.location,
        "depends_on": table.variable,
        "nodes": table.nodes.tolist(),
        "torque": list(effects[0].values),
        "gain_nats": number(against.gain),
        "held_out_gain_nats": number(against.held_gain),
        "held_out_error": number(mean_error(errors)) if errors else None,
    }


def finite_or_none(value: Any) -> Any:  # noqa: ANN401 - JSON is any
    """Numpy scalars to plain numbers, non-finite ones to null, throughout."""
    if isinstance(value, dict):
        return {str(k): finite_or_none(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite_or_none(v) for v in value]
    if isinstance(value, (np.floating, float)):
        return number(float(value))
    if isinstance(value, np.integer):
        return int(value)
    return value
