"""What the six-axis experiments found: plain figures."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jointscope.identification.joint_stiffness import JointFit
from jointscope.identification.modal_physics import EquivalentModes, ModePhysics
from jointscope.models.arm.agreement import Agreement
from jointscope.prediction.scores import BandScore
from jointscope.recordings.campaign import Run

Real = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class HammerResult:
    """Hits on joint 2 with every rotor braked.

    Attributes:
        modes: The sum of modes.
        physics: Which joints move in each.
        frequency: [Hz], shape (n,).
        measured: Averaged FRF of the hits [rad/s^2 per N m], shape (n,).
        exact: FRF of the simulated arm, linear, without noise, shape (n,).
        summed: Sum of modes with residual terms, shape (n,).
        first: One hit's run.
    """

    modes: EquivalentModes
    physics: tuple[ModePhysics, ...]
    frequency: Real
    measured: NDArray[np.complex128]
    exact: NDArray[np.complex128]
    summed: NDArray[np.complex128]
    first: Run

    @property
    def between_peaks(self) -> float:
        """Largest \\|sum of modes\\|/\\|FRF\\| between the two peaks, against the noise-free FRF [dB]."""
        low, high = (mode.frequency.value for mode in self.modes.modes[:2])
        inside = (self.frequency > low) & (self.frequency < high)
        return float(np.max(np.abs(20.0 * np.log10(np.abs(self.summed[inside] / self.exact[inside])))))

    def peaks(self) -> tuple[float, float]:
        """Frequencies of the two highest peaks of the exact FRF below 50 Hz [Hz]."""
        level = np.abs(self.exact)
        tops = [
            k
            for k in range(1, level.size - 1)
            if level[k - 1] < level[k] > level[k + 1] and self.frequency[k] < 50.0
        ]
        best = sorted(sorted(tops, key=lambda k: -level[k])[:2])
        return float(self.frequency[best[0]]), float(self.frequency[best[1]])


@dataclass(frozen=True, kw_only=True, eq=False)
class TorqueResult:
    """Torque from currents in one run.

    Attributes:
        run: Its id.
        times: [s], shape (n,).
        true, vector, park, envelope: T_e [N m on the shaft], shape (n,) each.
        errors: RMS error over RMS of the true torque [-]: ``vector``, ``park``, ``envelope``.
        doubts: Places where the sign is ambiguous [s].
    """

    run: str
    times: Real
    true: Real
    vector: Real
    park: Real
    envelope: Real
    errors: Mapping[str, float]
    doubts: tuple[tuple[float, float], ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class PredictionResult:
    """Predicted against true acceleration of joint 2's link in one run.

    Attributes:
        run: Its id.
        experiment: Its kind.
        frequency: [Hz], shape (n,).
        measured, true: Spectra of the recorded and of the noise-free acceleration [m/s^2], shape (n,).
        predicted: Spectra by form: ``parallel``, ``alone``, ``multi-joint``.
        scores: In 5-80 Hz by form, over the bins that stand clear of the noise.
        clear: Share of the band's bins that do [-].
    """

    run: str
    experiment: str
    frequency: Real
    measured: NDArray[np.complex128]
    true: NDArray[np.complex128]
    predicted: Mapping[str, NDArray[np.complex128]]
    scores: Mapping[str, BandScore]
    clear: float


@dataclass(frozen=True, kw_only=True)
class InertiaCheck:
    """Load inertia about joint 2 [kg m^2]: Pinocchio's, and what the hits say of it.

    Attributes:
        locked: With the other joints locked.
        unlocked: With the joints beyond it free.
        identified: ``locked`` times the factor that the hits ask for when the model's inertias may be off.
        low, high: Its 95 % interval.
    """

    locked: float
    unlocked: float
    identified: float
    low: float
    high: float


@dataclass(frozen=True, kw_only=True, eq=False)
class SixAxisResult:
    """Everything."""

    hammer: HammerResult
    agreement: Agreement
    joints: JointFit
    true_joints: Mapping[str, tuple[float, float]]
    torque: tuple[TorqueResult, ...]
    prediction: tuple[PredictionResult, ...]
    speed: Mapping[str, float]
    windup: Mapping[str, Any]
    currents: Run
    seconds: float
    processor_seconds: float
    inertia: InertiaCheck
