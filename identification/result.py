"""What an identification says: parameters and modes with intervals, what was refused and why, and the evidence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.identification.comparison import ModeFigure
from jointscope.identification.direct_parametric import ParametricFit
from jointscope.identification.frf import Frf
from jointscope.identification.hit_spectra import Rejected
from jointscope.identification.intervals import Estimate
from jointscope.identification.lack_of_fit import LackOfFit
from jointscope.identification.model_file import BaseModel
from jointscope.identification.modes import ModeSelection


@dataclass(frozen=True, kw_only=True)
class Mode:
    """One mode.

    Attributes:
        frequency: Natural frequency sqrt(a2)/2 pi [Hz].
        damping_ratio: a1/(2 sqrt(a2)) [-].
        b1: Modal constant per output [output's SI unit per input unit].
        kind: ``resonance``, or ``antiresonance`` of the motor's own response.
    """

    frequency: Estimate
    damping_ratio: Estimate
    b1: tuple[float, ...] = ()
    kind: str = "resonance"


@dataclass(frozen=True, kw_only=True)
class Refused:
    """A quantity that the recordings can't carry."""

    parameter: str
    reason: str


@dataclass(frozen=True, kw_only=True)
class Level:
    """The parameters from one level's hits alone.

    Attributes:
        low: Weakest hit's peak input [N m].
        high: Strongest hit's.
        hits: Number of hits.
        frequency: Natural frequency [Hz].
        damping_ratio: [-].
        parameters: As in ``Identification``.
    """

    low: float
    high: float
    hits: int
    frequency: Estimate
    damping_ratio: Estimate
    parameters: Mapping[str, Estimate]


@dataclass(frozen=True, kw_only=True, eq=False)
class MatrixFit:
    """Measured and fitted responses of several outputs to one input (motor bench), for pictures.

    Attributes:
        frequency: [Hz], shape (n,).
        names: Of the outputs.
        measured: Output per input, shape (n_outputs, n).
        deviation: Standard deviation of ``measured`` from period to period, shape (n_outputs, n); zero where unknown.
        fitted: Shape (n_outputs, n).
        log_error: RMS of ln|fitted/measured| over all lines [-].
    """

    frequency: NDArray[np.float64]
    names: tuple[str, ...]
    measured: NDArray[np.complexfloating[Any, Any]]
    deviation: NDArray[np.float64]
    fitted: NDArray[np.complexfloating[Any, Any]]
    log_error: float
    quantities: tuple[str, ...] = field(default=())


@dataclass(frozen=True, kw_only=True, eq=False)
class Identification:
    """An identification's result.

    Attributes:
        method: How it was reached, one line.
        band: Fitted [Hz].
        parameters: Under the names of ``formats/diagnosis.md``; the headline interval is the wider of model and repeats.
        modes: By rising frequency.
        refused: What can't be had.
        rejected: Runs left out.
        notes: Statements a reader must know of (a sign that was turned, a nameplate value taken off).
        levels: The same parameters per level of hit; empty with one level.
        level_probability: Of such differences between levels by chance; ``None`` with one level.
        comparison: The same mode by other methods.
        lack_of_fit: What the model does not explain.
        base: What ``predict`` needs; ``None`` where the values don't suffice.
        frf: Averaged FRF of the first output, for pictures.
        selection: Stabilisation data.
        fit: The likelihood's optimum, for pictures.
    """

    method: str
    band: tuple[float, float]
    parameters: Mapping[str, Estimate]
    modes: tuple[Mode, ...]
    refused: tuple[Refused, ...]
    rejected: tuple[Rejected, ...] = ()
    notes: tuple[str, ...] = ()
    levels: tuple[Level, ...] = ()
    level_probability: float | None = None
    comparison: tuple[ModeFigure, ...] = ()
    lack_of_fit: LackOfFit | None = None
    base: BaseModel | None = None
    frf: Frf | None = None
    selection: ModeSelection | None = None
    fit: ParametricFit | None = None
    response: MatrixFit | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "parameters", MappingProxyType(dict(self.parameters)))
