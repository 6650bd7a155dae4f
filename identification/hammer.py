"""Hammer hits on the braked joint -> parameters: choose the band and the modes, fit, throw out outliers, say how sure."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from jointscope.errors import RefusedError
from jointscope.identification.comparison import ModeFigure, circle_fit, half_power, least_squares_h1
from jointscope.identification.direct_parametric import ParametricFit, fit_hits
from jointscope.identification.errors_in_variables import HitSpectrum
from jointscope.identification.frf import Frf, from_spectra
from jointscope.identification.hit_spectra import Hit, Rejected
from jointscope.identification.intervals import Estimate, Uncertainty, uncertainty
from jointscope.identification.joint_values import (
    Units,
    gradients,
    joint_estimates,
    main_mode,
    mode_estimates,
    sift,
    units,
)
from jointscope.identification.lack_of_fit import lack_of_fit
from jointscope.identification.linear_start import single_mode_start
from jointscope.identification.modal_model import ModalModel
from jointscope.identification.model_file import BaseModel, Term, joint_values
from jointscope.identification.modes import ModeSelection, select_modes
from jointscope.identification.refusals import check_coherence, check_record, check_resonance
from jointscope.identification.result import Identification, Level, Refused
from jointscope.recordings.campaign import Nameplate

Real = NDArray[np.float64]

LOWEST = 2.0  # Hz: below it G ~ s^2/K drowns in every sensor's noise
PAPER_TOP = 50.0  # Hz: the paper's band for one mode
FORCE_SHARE = 0.1  # of the force spectrum's largest line down to which it still drives the joint
ENDED = 1e-4  # share of its amplitude below which a decay has ended
OUTLIER = 6.0  # robust standard deviations


@dataclass(frozen=True, kw_only=True)
class HammerPlan:
    """What a user may fix beforehand.

    Attributes:
        band: To fit [Hz]; ``None`` lets the data choose.
        modes: Number of modes; ``None`` lets the evidence choose.
        levels: Whether to repeat the fit per level of hit.
    """

    band: tuple[float, float] | None = None
    modes: int | None = None
    levels: bool = True


def usable_band(hits: Sequence[HitSpectrum]) -> tuple[float, float]:
    """Where the force drives the joint: its mean spectrum above a tenth of its largest line [Hz]."""
    first = hits[0]
    drive = np.mean([np.interp(first.frequency, hit.frequency, np.abs(hit.input)) for hit in hits], axis=0)
    strong = drive >= FORCE_SHARE * drive.max()
    start = int(np.argmax(drive))
    weak = np.flatnonzero(~strong[start:])
    last = start + (int(weak[0]) - 1 if weak.size else strong.size - start - 1)
    shortest = min(hit.duration for hit in hits)
    return max(LOWEST, 3.0 / shortest), float(first.frequency[last])


def identify_hammer(
    usable: Sequence[Hit], rejected: Sequence[Rejected], rig: Nameplate, gravity: float | None, plan: HammerPlan
) -> Identification:
    """Identify from usable hits (at least one).

    Raises:
        RefusedError: No resonance in the band, no coherence, too short a record, or no convergence.
    """
    spectra, start, selection, band = _prepare([hit.spectrum for hit in usable], plan)
    fit, outliers = _fit_without_outliers([hit.in_band(band) for hit in spectra], start)
    of = uncertainty(fit)
    input_unit = usable[0].input_unit if all(hit.calibrated for hit in usable) else "input unit"
    unit = units(rig, input_unit)
    modes = mode_estimates(fit, of)
    check_resonance(modes, band)
    found, refused, notes = joint_estimates(fit, of, rig, unit, gravity)
    base = _base_model(fit, of, found, rig, input_unit)
    found, too_wide = sift(found, len(fit.hits))
    refused += [*too_wide, *_uncalibrated(input_unit)]
    out = {row.run for row in outliers}
    average = averaged_frf([hit for hit in spectra if hit.run not in out])
    check_coherence(average, modes, band)
    levels, probability = _levels(fit, rig, unit, gravity) if plan.levels else ((), None)
    disagreement = gradients(fit, of, main_mode(fit)).disagreement
    if disagreement > 0.05:
        notes.append(
            f"the outputs' own inertias differ by up to {100 * disagreement:.0f} %: check radii and sensitivities; "
            "the value is their weighted mean"
        )
    plural = "s" if fit.model.modes > 1 else ""
    return Identification(
        method="direct parametric form by errors-in-variables likelihood: "
        f"{len(fit.hits)} hit{'s' if len(fit.hits) > 1 else ''}, {fit.model.modes} mode{plural}",
        band=band,
        parameters=found,
        modes=modes,
        refused=tuple(refused),
        rejected=(*rejected, *outliers),
        notes=tuple(notes),
        levels=levels,
        level_probability=probability,
        comparison=_comparison(fit, average, band),
        lack_of_fit=lack_of_fit(fit),
        base=base,
        frf=average,
        selection=selection,
        fit=fit,
    )


def _prepare(
    spectra: list[HitSpectrum], plan: HammerPlan
) -> tuple[list[HitSpectrum], ModalModel, ModeSelection, tuple[float, float]]:
    """Band, modes and whether the records end in mid-decay, each from the data unless the plan says."""
    band = plan.band or usable_band(spectra)
    selection = _choose(spectra, band, plan.modes)
    start = selection.model or single_mode_start([hit.in_band(band) for hit in spectra])
    narrow = plan.band is None and start.modes == 1
    if narrow:
        top = max(PAPER_TOP, 1.25 * float(start.natural_frequency[0]) / (2.0 * math.pi))
        band = (band[0], min(band[1], top))
    marked = _mark_truncated(spectra, float(start.a1.min()))
    if narrow or marked[0].truncated:
        selection = _choose(marked, band, 1 if start.modes == 1 else plan.modes)
        start = selection.model or single_mode_start([hit.in_band(band) for hit in marked])
        marked = _mark_truncated(spectra, float(start.a1.min()))
    check_record(marked, start, band)
    return marked, start, selection, band


def _choose(spectra: Sequence[HitSpectrum], band: tuple[float, float], count: int | None) -> ModeSelection:
    lines = int(np.sum((spectra[0].frequency >= band[0]) & (spectra[0].frequency <= band[1])))
    if lines < 12:
        raise RefusedError(
            f"only {lines} spectral lines lie between {band[0]:.3g} and {band[1]:.3g} Hz: the record of "
            f"{spectra[0].duration:.3g} s is too short, or the band too narrow; record at least "
            f"{12.0 / (band[1] - band[0]):.2g} s"
        )
    highest = count + 3 if count is not None else min(16, 4 + lines // 150)
    return select_modes(spectra, band, highest=min(highest, lines // 4), count=count)


def _mark_truncated(spectra: Sequence[HitSpectrum], a1: float) -> list[HitSpectrum]:
    return [replace(hit, truncated=bool(np.exp(-0.5 * a1 * hit.duration) > ENDED)) for hit in spectra]


def averaged_frf(spectra: Sequence[HitSpectrum]) -> Frf:
    """FRF of the first output over its sensor, all hits that share the first one's lines."""
    first = spectra[0]
    same = [hit for hit in spectra if np.array_equal(hit.frequency, first.frequency)]
    return from_spectra(
        first.frequency,
        np.array([hit.input for hit in same]),
        np.array([hit.output[0] / hit.sensor[0] for hit in same]),
    )


def _fit_without_outliers(
    spectra: Sequence[HitSpectrum], start: ModalModel
) -> tuple[ParametricFit, tuple[Rejected, ...]]:
    """Fit, drop hits whose gain, delay or noise stands far out of the others', and fit again."""
    fit = _with_complex_modes(fit_hits(spectra, start), start)
    if len(spectra) < 5:
        return fit, ()
    noise = np.log([float(np.mean(sigma[0])) / hit.level for hit, sigma in zip(fit.hits, fit.noise, strict=True)])
    reasons: dict[int, str] = {}
    for values, least, text in (
        (fit.found.gain, 0.03, "its gain is {:+.1%} off the other hits'"),
        (fit.found.timing, 2e-4, "its delay is {:+.2g} s off the other hits'"),
        (noise, 0.7, "what the fit leaves over of it is e^{:+.1f} of the other hits'"),
    ):
        off = values - np.median(values)
        limit = max(OUTLIER * 1.4826 * float(np.median(np.abs(off))), least)
        for index in np.flatnonzero(np.abs(off) > limit):
            if text.startswith("what") and off[index] < 0.0:
                continue
            reasons.setdefault(int(index), text.format(float(off[index])))
    if not reasons or len(reasons) > len(spectra) // 3:
        return fit, ()
    kept = [hit for index, hit in enumerate(spectra) if index not in reasons]
    rejected = tuple(
        Rejected(run=spectra[index].run, finding="outlier", detail=reason)
        for index, reason in sorted(reasons.items())
    )
    return fit_hits(kept, fit.model), rejected


def _with_complex_modes(fit: ParametricFit, start: ModalModel) -> ParametricFit:
    """The same modes with a b2 each, where there are several and the evidence (BIC) asks for it.

    Begun at ``start`` again: real modes that were forced on a complex pair may have drifted off.
    """
    if start.modes < 2:
        return fit
    try:
        free = fit_hits(fit.hits, replace(start, b2=np.zeros_like(start.b1)))
    except RefusedError:
        return fit
    numbers = sum(2 * hit.output.size for hit in fit.hits)
    return free if _misfit(free) + start.b1.size * math.log(numbers) < _misfit(fit) else fit


def _misfit(fit: ParametricFit) -> float:
    """-2 ln likelihood but for a constant."""
    return fit.cost + sum(4.0 * float(np.sum(np.log(sigma))) for sigma in fit.noise)


def _levels(
    fit: ParametricFit, rig: Nameplate, unit: Units, gravity: float | None
) -> tuple[tuple[Level, ...], float | None]:
    """The same fit within groups of like level, and the probability of the differences by chance."""
    strength = np.array([hit.level for hit in fit.hits])
    if strength.size < 6 or strength.max() < 1.5 * strength.min() or fit.model.modes > 1:
        return (), None
    groups = np.array_split(np.argsort(strength, kind="stable"), 3 if strength.size >= 9 else 2)
    rows, seen = [], []
    for group in groups:
        part = fit_hits([fit.hits[index] for index in group], fit.model, coloured=False)
        of = uncertainty(part)
        mode = mode_estimates(part, of)[0]
        values, _, _ = joint_estimates(part, of, rig, unit, gravity)
        own = gradients(part, of, 0)
        spread = [float(np.sqrt(g @ of.model @ g)) for g in (0.5 * own.a2, own.a1 - 0.5 * own.a2)]
        seen.append([math.log(mode.frequency.value), math.log(mode.damping_ratio.value), *spread])
        rows.append(
            Level(
                low=float(strength[group].min()),
                high=float(strength[group].max()),
                hits=int(group.size),
                frequency=mode.frequency,
                damping_ratio=mode.damping_ratio,
                parameters=values,
            )
        )
    table = np.array(seen)
    chances = []
    for column in (0, 1):
        weight = 1.0 / np.maximum(table[:, 2 + column], 1e-12) ** 2
        mean = np.sum(weight * table[:, column]) / weight.sum()
        chances.append(float(stats.chi2.sf(np.sum(weight * (table[:, column] - mean) ** 2), len(rows) - 1)))
    return tuple(rows), min(1.0, 2.0 * min(chances))


def _comparison(fit: ParametricFit, frf: Frf, band: tuple[float, float]) -> tuple[ModeFigure, ...]:
    model = fit.model
    mode = main_mode(fit)
    near = float(model.natural_frequency[mode] / (2.0 * math.pi))
    ratio = float(model.damping_ratio[mode])
    keep = (frf.frequency >= band[0]) & (frf.frequency <= band[1])
    found = [
        ModeFigure(method="likelihood (this)", frequency=near, damping_ratio=ratio, b1=float(model.b1[0, mode])),
        half_power(frf.frequency[keep], frf.h1[keep], near),
        circle_fit(frf.frequency[keep], frf.h1[keep], near, ratio),
        least_squares_h1(frf, band, near, ratio) if model.modes == 1 else None,
    ]
    return tuple(row for row in found if row is not None)


def _uncalibrated(input_unit: str) -> list[Refused]:
    if input_unit != "input unit":
        return []
    why = 'the scale of the force or of an acceleration is unknown (unit = "1" without scale): values are per input unit'
    return [Refused(parameter=f"absolute {name}", reason=why) for name in ("inertia", "stiffness", "damping")]


def _base_model(
    fit: ParametricFit, of: Uncertainty, found: Mapping[str, Estimate], rig: Nameplate, input_unit: str
) -> BaseModel:
    """K, c and J_L of the main mode with their covariance, and every mode's own system where there are several."""
    mode = main_mode(fit)
    own = gradients(fit, of, mode)
    stiffness = found.get("stiffness") or found["stiffness_total"]
    damping = found.get("damping") or found["damping_total"]
    rows = np.array([own.a2 - own.b1, own.a1 - own.b1, -own.b1])
    covariance = of.model
    if of.repeats is not None and rows[0] @ of.repeats @ rows[0] > rows[0] @ of.model @ rows[0]:
        covariance = of.repeats
    scale = np.array([stiffness.value, found["damping_total"].value, found["inertia"].value])
    spread = rows @ covariance @ rows.T * np.outer(scale, scale)
    names: tuple[str, ...] = ("stiffness", "damping", "load_inertia")
    if rig.load_damping is not None:  # c + b_l is sharp, its parts are not
        part = (0.5 * rig.load_damping) ** 2
        full = np.zeros((4, 4))
        full[:3, :3] = spread
        full[1, 1] += part
        full[3, 3], full[1, 3], full[3, 1] = part, -part, -part
        names, spread = (*names, "load_damping"), full
    model = fit.model
    terms = tuple(
        Term(inertia=1.0 / b1, damping=float(model.a1[m]) / b1, stiffness=float(model.a2[m]) / b1)
        for m in range(model.modes)
        if (b1 := float(model.b1[0, m]))
    )
    return BaseModel(
        rig=rig,
        joint=joint_values(
            rig, stiffness=stiffness.value, damping=damping.value, load_inertia=found["inertia"].value
        ),
        parameters=names,
        covariance=spread,
        terms=terms if len(terms) > 1 else (),
        input_unit=input_unit if input_unit != "input unit" else "1",
    )
