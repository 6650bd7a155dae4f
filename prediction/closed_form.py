r"""The paper's own prediction: the torque's spectrum times the joint's transfer function.

q_l'' = eta n T_e G_a(s) (11), with G_a (7); with several modes the joints in parallel, each with the motor's
parameters (section 2.2.2). No gravity, no motion history: what a spectrum can say. ``base_model`` says more.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from jointscope.identification.model_file import BaseModel
from jointscope.models.joint import load_acceleration_per_torque
from jointscope.models.parameters import Joint
from jointscope.prediction.spectra import Spectrum

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]


def acceleration_per_torque(model: BaseModel, frequency: Real) -> Complex:
    """eta n G_a: arm angular acceleration per torque on the motor shaft [rad/s^2 per N m], shape of ``frequency`` [Hz]."""
    return np.asarray(sum(sign * _one(joint, frequency) for joint, sign in joints(model)), dtype=np.complex128)


def joints(model: BaseModel) -> list[tuple[Joint, float]]:
    """The two-inertia joints in parallel with their signs; one where the model has one mode."""
    if not model.terms:
        return [(model.as_joint(), 1.0)]
    first = model.terms[0]
    base = replace(
        model,
        parameters=(),
        covariance=np.zeros((0, 0)),
        joint={
            "load_inertia": abs(first.inertia),
            "stiffness": abs(first.stiffness),
            "damping": abs(first.damping),
            **model.joint,
        },
    ).as_joint()
    return [
        (
            replace(
                base, load_inertia=abs(term.inertia), stiffness=abs(term.stiffness), damping=abs(term.damping)
            ),
            math.copysign(1.0, term.inertia),
        )
        for term in model.terms
    ]


def predicted_spectrum(model: BaseModel, torque: Spectrum, radius: float = 1.0) -> Spectrum:
    """Arm acceleration's spectrum by (11).

    Args:
        model: Base model.
        torque: Of T_e [N m, motor shaft].
        radius: 1 for angular acceleration [rad/s^2], else where it is measured, for m/s^2 [m].
    """
    return Spectrum(torque.frequency, radius * acceleration_per_torque(model, torque.frequency) * torque.amplitude)


def _one(joint: Joint, frequency: Real) -> Complex:
    s = 2j * np.pi * np.asarray(frequency, dtype=float)
    with np.errstate(divide="ignore", invalid="ignore"):  # s = 0 without damping is 0/0
        G_a = load_acceleration_per_torque(joint, s)
    G_a = np.where(s == 0.0, 0.0, G_a)
    return np.asarray(joint.efficiency * joint.reduction_ratio * G_a, dtype=np.complex128)
