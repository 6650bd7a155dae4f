r"""A joint with several modes: equivalent J~, c~, K~ of each (paper, Equations 22-25), and which joints move in it.

Number of modes and parameters are those of the single joint's identification (``hammer``): by evidence and by the
likelihood over single hits. Joints that are damped unlike give complex modes; the b2 of each term, which stands for
them, stays only where the evidence asks for it. What a mode means is read off the arm's own
eigenproblem at the posture: the mode of (K, M) nearest in frequency, its shape and each reducer's share of the energy.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import RefusedError
from jointscope.identification.direct_parametric import ParametricFit
from jointscope.identification.hammer import HammerPlan, identify_hammer
from jointscope.identification.hit_spectra import Hit
from jointscope.identification.intervals import Estimate, logarithmic, uncertainty
from jointscope.identification.modal_model import ModalModel
from jointscope.identification.modes import ModeSelection
from jointscope.models.arm.linear import JointValues, linear_arm, natural_modes
from jointscope.models.arm.reference import Reference
from jointscope.models.joint import DirectForm
from jointscope.recordings.campaign import Nameplate

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class EquivalentMode:
    """One single-mode system of the sum (24).

    Attributes:
        frequency: sqrt(a2)/2 pi [Hz].
        damping_ratio: a1/(2 sqrt(a2)) [-].
        inertia: J~ = 1/b1 [kg m^2].
        damping: c~ = a1/b1 [N m s/rad].
        stiffness: K~ = a2/b1 [N m/rad], gravity's share included.
        term: The mode as the paper writes it (27).
    """

    frequency: Estimate
    damping_ratio: Estimate
    inertia: Estimate
    damping: Estimate
    stiffness: Estimate
    term: DirectForm


@dataclass(frozen=True, kw_only=True, eq=False)
class EquivalentModes:
    """The sum of modes that a set of hits holds.

    Attributes:
        modes: Lowest first.
        selection: How their number was found: stabilisation and evidence.
        fit: The likelihood's optimum; ``fit.model`` is the response with its residual terms.
        band: Fitted [Hz].
        complex_modes: Whether the evidence asked for b2.
    """

    modes: tuple[EquivalentMode, ...]
    selection: ModeSelection
    fit: ParametricFit
    band: tuple[float, float]
    complex_modes: bool


@dataclass(frozen=True, kw_only=True)
class ModePhysics:
    """What an equivalent mode is.

    Attributes:
        measured: Frequency found in the hits [Hz].
        computed: Of the nearest mode of the arm's own eigenproblem [Hz].
        angles: Of each link in that mode, the largest being one, by joint.
        share: Of each reducer in its elastic energy [-], by joint; sums to one.
        inertia: 1/phi^2 at the joint that is hit [kg m^2]: what J~ should be.
        summary: One sentence.
    """

    measured: float
    computed: float
    angles: Mapping[str, float]
    share: Mapping[str, float]
    inertia: float
    summary: str


def equivalent_modes(
    hits: Sequence[Hit], rig: Nameplate, band: tuple[float, float] = (4.0, 50.0), modes: int | None = None
) -> EquivalentModes:
    """Fit a sum of modes with residual terms to ``hits`` over ``band`` [Hz].

    Args:
        hits: One driving point, torque in and angular acceleration out (``hit_spectra.read_hit``).
        rig: Nameplate.
        band: To fit [Hz].
        modes: Their number; by evidence where ``None``.

    Raises:
        RefusedError: The band holds no mode, or the fit doesn't converge.
    """
    found = identify_hammer(hits, (), rig, None, HammerPlan(band=band, modes=modes, levels=False))
    if found.fit is None or found.selection is None:
        raise RefusedError(
            f"no mode is stable between {band[0]:g} and {band[1]:g} Hz; hit harder or widen the band"
        )
    return EquivalentModes(
        modes=_estimates(found.fit), selection=found.selection, fit=found.fit, band=band,
        complex_modes=found.fit.model.b2.size > 0,
    )  # fmt: skip


def explain_modes(
    found: EquivalentModes, reference: Reference, posture: Mapping[str, float], values: JointValues, hit: str
) -> tuple[ModePhysics, ...]:
    """Which joints move in each mode, all rotors braked.

    Args:
        found: Modes from the hits.
        reference: The arm.
        posture: Of its links during the hits [rad].
        values: Its reducers, as identified or from the table.
        hit: Joint whose link was hit.
    """
    modes = natural_modes(linear_arm(reference, posture, values, {}))
    at = reference.joints.index(hit)
    result = []
    for mode in found.modes:
        k = int(np.argmin(np.abs(np.log(modes.frequency / mode.frequency.value))))
        shape = modes.shape[:, k] / modes.shape[np.argmax(np.abs(modes.shape[:, k])), k]
        share = dict(zip(reference.joints, modes.strain[:, k].tolist(), strict=True))
        result.append(
            ModePhysics(
                measured=mode.frequency.value,
                computed=float(modes.frequency[k]),
                angles=dict(zip(reference.joints, shape.tolist(), strict=True)),
                share=share,
                inertia=float(1.0 / modes.shape[at, k] ** 2),
                summary=_sentence(mode.frequency.value, float(modes.frequency[k]), share, shape, reference.joints),
            )
        )
    return tuple(result)


def _estimates(fit: ParametricFit) -> tuple[EquivalentMode, ...]:
    model, spread = fit.model, uncertainty(fit)
    n, p = model.modes, model.vector().size
    result = []
    for k in np.argsort(model.a2):
        a1, a2, b1 = float(model.a1[k]), float(model.a2[k]), float(model.b1[0, k])

        def gradient(on_a1: float, on_a2: float, on_b1: float, k: int = int(k), a1: float = a1, a2: float = a2,
                     b1: float = b1) -> Real:  # fmt: skip
            row = np.zeros(p)
            row[k], row[n + k], row[2 * n + k] = on_a1 / a1, on_a2 / a2, on_b1 / b1
            return row

        b2 = float(model.b2[0, k]) if model.b2.size else 0.0
        result.append(
            EquivalentMode(
                frequency=logarithmic(math.sqrt(a2) / (2.0 * math.pi), gradient(0.0, 0.5, 0.0), "Hz", spread),
                damping_ratio=logarithmic(a1 / (2.0 * math.sqrt(a2)), gradient(1.0, -0.5, 0.0), "1", spread),
                inertia=logarithmic(1.0 / b1, gradient(0.0, 0.0, -1.0), "kg m^2", spread),
                damping=logarithmic(a1 / b1, gradient(1.0, 0.0, -1.0), "N m s/rad", spread),
                stiffness=logarithmic(a2 / b1, gradient(0.0, 1.0, -1.0), "N m/rad", spread),
                term=DirectForm(b1=b1, b2=b2, b3=0.0, a1=a1, a2=a2),
            )
        )
    return tuple(result)


def _sentence(
    measured: float, computed: float, share: Mapping[str, float], shape: Real, joints: Sequence[str]
) -> str:
    ranked = sorted(share, key=lambda name: -share[name])
    yields = [f"{name} {100.0 * share[name]:.0f} %" for name in ranked if share[name] > 0.05]
    movers = [k for k in np.argsort(-np.abs(shape)) if abs(shape[k]) > 0.2]
    senses = ""
    if len(movers) > 1:
        same = shape[movers[0]] * shape[movers[1]] > 0.0
        senses = (
            f"; {joints[movers[0]]} and {joints[movers[1]]} turn {'together' if same else 'against each other'}"
        )
    return f"{measured:.2f} Hz (model {computed:.2f} Hz): the energy is in {', '.join(yields)}{senses}"


def with_modes(model: ModalModel, keep: Sequence[int]) -> ModalModel:
    """The part of a sum of modes that ``keep`` names, without residual terms."""
    index = list(keep)
    none = np.zeros(0)
    return replace(
        model, a1=model.a1[index], a2=model.a2[index], b1=model.b1[:, index], mass_line=none, stiffness_line=none,
        b2=model.b2[:, index] if model.b2.size else model.b2,
    )  # fmt: skip
