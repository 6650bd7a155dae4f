r"""The motor's electromagnetic torque T_e from whatever the run recorded of it as an input.

Torque itself, torque-producing current (T_e = K_t i_q), phase currents, or an armature voltage (whose model values are
per volt). Of three phase currents i_k = -i_q sin(p theta - 2 pi k/3) the vector -j (2/3) sum_k i_k exp(j 2 pi k/3)
is i_q exp(j p theta): its length is \|i_q\|, and its sign follows because p theta goes on steadily while a change of
sign of i_q turns the vector by half a turn. One phase alone leaves the paper's envelope \|h[i_a]\| (Equation 28).

Outputs are never read: the encoder that ``recordings.motor_torque`` may use is an output.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numba
import numpy as np
from numpy.typing import NDArray
from scipy import signal as dsp

from jointscope.errors import RefusedError
from jointscope.identification.model_file import BaseModel
from jointscope.prediction.torque_log import Samples, TorqueLog, undistorted
from jointscope.recordings.bandlimited import Bandlimited, bandlimited
from jointscope.recordings.campaign import Quantity, Run, Signal

Real = NDArray[np.float64]
Complex = NDArray[np.complex128]

SOURCES: tuple[Quantity, ...] = ("torque", "current", "phase-current", "voltage")


@dataclass(frozen=True, kw_only=True, eq=False)
class TorqueInput:
    """T_e as a function of time [N m, motor shaft] (or the model's input unit).

    Attributes:
        value: Of time [s].
        source: Quantity it was read from.
        rate: Of the recording [Hz].
        note: What a reader of the prediction must know of it; empty where nothing.
    """

    value: Bandlimited
    source: Quantity
    rate: float
    note: str = ""


def torque_input(
    model: BaseModel, run: Run, motor_angle: float, log: TorqueLog | None = None
) -> TorqueInput | None:
    """T_e of ``run``, or ``None`` where it declares no motor input.

    Args:
        model: Base model; its nameplate holds torque constant and pole pairs.
        run: The run; input channels only are read.
        motor_angle: n q_s at the start [rad], from which the currents' sign is found.
        log: What the torque's logger does, where that is known.

    Raises:
        RefusedError: A nameplate value that the recording needs is absent, or a declared input was not recorded.
    """
    for quantity in SOURCES:
        declared = run.select(quantity, location="motor", role="input", recorded=False)
        signals = run.select(quantity, location="motor", role="input")
        if declared and not signals:
            raise RefusedError(
                f"run {run.id!r}: the input {declared[0].channel.column!r} is declared but not in "
                f"{declared[0].stream.file}; prediction needs its samples"
            )
        if signals:
            return _read(model, run, quantity, signals, motor_angle, log or TorqueLog())
    return None


def _read(
    model: BaseModel, run: Run, quantity: Quantity, signals: tuple[Signal, ...], motor_angle: float, log: TorqueLog
) -> TorqueInput:
    first = signals[0]
    note = ""
    if quantity == "torque":
        values = first.samples
        if first.channel.side == "output":
            values = values / model.joint.get("reduction_ratio", 1.0)
    elif quantity == "current":
        values = first.samples * _peak(first) * _torque_constant(model, run, first)
    elif quantity == "voltage":
        values = first.samples
    else:
        values, note = _from_phases(model, run, signals, motor_angle)
        values = values * _peak(first) * _torque_constant(model, run, first)
    read = undistorted(Samples(values, first.sampling_rate, first.stream.start), log)
    return TorqueInput(
        value=bandlimited(read.values, read.rate, read.start), source=quantity, rate=read.rate, note=note
    )


def _peak(signal: Signal) -> float:
    return math.sqrt(2.0) if signal.channel.per == "rms" else 1.0


def _torque_constant(model: BaseModel, run: Run, signal: Signal) -> float:
    if model.rig.torque_constant is not None:
        return model.rig.torque_constant
    if model.input_unit not in ("N m", "N"):
        return 1.0  # every value of the model is meant per ampere then
    raise RefusedError(
        f"run {run.id!r}: {signal.channel.column!r} is a current and rig.torque_constant is absent; "
        "give it in campaign.toml [N m/A]"
    )


def _from_phases(model: BaseModel, run: Run, signals: tuple[Signal, ...], motor_angle: float) -> tuple[Real, str]:
    phases = [signal.samples for signal in signals if signal.device == signals[0].device]
    if len(phases) == 1:
        envelope = np.abs(dsp.hilbert(phases[0]))
        return envelope, "one phase current gives |T_e| only (Hilbert envelope): the torque's sign is lost"
    u, v = phases[0], phases[1]
    w = phases[2] if len(phases) > 2 else -u - v
    vector = -1j * 2.0 / 3.0 * (u + v * np.exp(2j * np.pi / 3) + w * np.exp(4j * np.pi / 3))
    if model.rig.pole_pairs is None:
        raise RefusedError(
            f"run {run.id!r}: phase currents need rig.pole_pairs in campaign.toml to find the torque's sign"
        )
    return quadrature_current(vector, model.rig.pole_pairs * motor_angle), ""


def quadrature_current(vector: Complex, electrical_angle: float) -> Real:
    """Signed i_q [A] from its rotating vector i_q exp(j p theta), shape (n,).

    The square of the vector has no sign to lose; its angle 2 p theta is followed forwards by a second-order tracker
    that coasts where the current is small.

    Args:
        vector: Shape (n,).
        electrical_angle: p theta at the first sample [rad].
    """
    level = float(np.sqrt(np.mean(np.abs(vector) ** 2)))
    angle = _followed(np.ascontiguousarray(vector, dtype=np.complex128), electrical_angle, 0.05 * level + 1e-300)
    return np.asarray((vector * np.exp(-1j * angle)).real, dtype=np.float64)


@numba.njit(cache=True)
def _followed(vector, angle, small):  # type: ignore[no-untyped-def]  # noqa: ANN001, ANN202
    out = np.empty(vector.size)
    speed = 0.0
    for i in range(vector.size):
        if i > 0:
            angle += speed
        square = vector[i] * vector[i] * np.exp(-2j * angle)
        trust = abs(square) / (abs(square) + small * small)
        error = 0.5 * np.arctan2(square.imag, square.real) * trust
        angle += 0.4 * error
        speed += 0.08 * error
        out[i] = angle
    return out
