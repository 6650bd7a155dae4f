"""Start values from frequency responses: measured H1 against the linear base, from several resonances, signs free."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from jointscope.diagnosis.assembly import BASE_INDEX, BASE_NAMES
from jointscope.recordings.campaign import FORCES, gearing

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import BaseSpec, Output, PreparedRun

Vector = NDArray[np.float64]
Complex = NDArray[np.complex128]

_LOWEST, _HIGHEST = 2.0, 300.0  # Hz; where a joint's resonance is looked for
_LINES = 160  # per response
_CANDIDATES = 7
_CONTRADICTION = 0.4  # mean cosine of the phase error below minus which a channel counts as inverted
_ACTIVE = 0.15  # share of negative mobility above which a channel counts as inverted
WORKED = 0.15  # share of net work from which on a channel can't be inverted
_APART = 1.5  # frequency of the loudest mode over that of the one that moves farthest, from which on they are two
_ENOUGH = 8  # lines below, that say something
_SURE = 6.0  # averages a coherence must be made of before it counts in full


@dataclass(frozen=True, eq=False)
class Response:
    """A pooled frequency response, acceleration-like, of one kind of channel to one kind of input.

    Attributes:
        f: Lines [Hz], shape (n,).
        H: Output over input, both at the joint output, angles differentiated twice [rad/s^2 per N m], shape (n,).
        weight: Coherence-like, shape (n,).
        motor: Whether the motor side is measured, whether the motor drives, and whether the motor moves.
        key: Kind of channel.
    """

    f: Vector
    H: Complex
    weight: Vector
    at_motor: bool
    by_motor: bool
    motor_moves: bool
    spring: bool
    key: tuple[object, ...]
    phased: bool = True  # False where the clocks of input and output are not known to agree


def channel_key(run: PreparedRun, output: Output) -> tuple[object, ...]:
    """Outputs that share it are the same instrument at the same place, answering the same input."""
    place = (output.quantity, output.location, output.direction, output.radius, output.rate, output.device)
    return (*place, _by_motor(run), run.motor_moves, run.spring)


def _by_motor(run: PreparedRun) -> bool:
    return run.motor is not None and (run.load is None or not np.any(run.load_half))


def responses(runs: tuple[PreparedRun, ...], *, exact: bool = False) -> tuple[Response, ...]:
    """One pooled H1 per kind of channel, input and boundary; ``exact``: clocks of uncertain start are aligned already."""
    pools: dict[tuple[object, ...], list[tuple[Vector, Vector, float, PreparedRun, Output]]] = {}
    for run in runs:
        drive = run.motor_half if _by_motor(run) else run.load_half
        if not np.any(drive) or run.mode.startswith("prescribed"):
            continue
        half = run.t0 + np.arange(drive.size) / (2.0 * run.grid_rate)
        for output in run.outputs:
            if output.quantity in FORCES or output.direction == "radial":
                continue
            y = output.data / _to_joint(run, output)
            pools.setdefault(channel_key(run, output), []).append(
                (np.interp(output.times, half, drive), y, output.rate, run, output)
            )
    return tuple(r for pool in pools.values() for r in (_pooled(pool, exact),) if r is not None)


def _to_joint(run: PreparedRun, output: Output) -> float:
    factor = gearing(output.quantity, output.location, run.ratio)
    return factor * ((output.radius or 1.0) if output.quantity == "linear-acceleration" else 1.0)


def _pooled(pool: list[tuple[Vector, Vector, float, PreparedRun, Output]], exact: bool) -> Response | None:
    """H1 over runs and overlapping Hann segments (hits: whole records)."""
    rate, run, output = pool[0][2], pool[0][3], pool[0][4]
    length = max(u.size for u, *_ in pool)
    impact = run.run.experiment == "hammer"
    if not impact:
        length = min(length, 2 ** int(np.log2(max(4.0 * rate, 256.0))))
    n_lines = length // 2 + 1
    Suu, Syy, Suy, count = np.zeros(n_lines), np.zeros(n_lines), np.zeros(n_lines, dtype=np.complex128), 0
    for u, y, *_ in pool:
        step = max(length // 2, 1)
        for begin in range(0, max(u.size - length, 0) + 1, step):
            a, b = u[begin : begin + length], y[begin : begin + length]
            window = np.ones(a.size) if impact else np.hanning(a.size)
            A = np.fft.rfft((a - a.mean() * (not impact)) * window, length)
            B = np.fft.rfft((b - b.mean()) * window, length)
            Suu, Suy, Syy = Suu + np.abs(A) ** 2, Suy + B * np.conj(A), Syy + np.abs(B) ** 2
            count += 1
    f = np.fft.rfftfreq(length, 1.0 / rate)
    top = min(_HIGHEST, 0.4 * rate)
    keep = (f >= max(_LOWEST, 3.0 * rate / length)) & (f <= top)
    keep &= Suu > 1e-5 * np.max(Suu[keep]) if keep.any() else keep
    if keep.sum() < 8:
        return None
    s = 2j * np.pi * f[keep]
    power = {"angle": 2, "position": 2, "angular-velocity": 1, "velocity": 1}.get(output.quantity, 0)
    H = Suy[keep] / Suu[keep] * s**power
    coherence = np.abs(Suy[keep]) ** 2 / (Suu[keep] * Syy[keep] + 1e-300)
    bias = 1.0 / count  # coherence of noise alone
    weight = np.clip((coherence - bias) / (1.0 - bias), 0.0, 1.0) ** 2 if count > 2 else np.full(H.shape, 0.5)
    weight = weight * min(1.0, count / _SURE) if count > 2 else weight
    excited = np.sqrt(Suu[keep] / np.max(Suu[keep]))
    weight = weight * np.minimum(1.0, 10.0 * excited)
    lines = np.unique(np.round(np.linspace(0, H.size - 1, min(_LINES, H.size))).astype(int))
    if impact:  # the peak is narrow: keep its lines
        peak = int(np.argmax(np.abs(H)))
        lines = np.unique(np.concatenate([lines, np.arange(max(peak - 20, 0), min(peak + 20, H.size))]))
    return Response(
        f[keep][lines],
        H[lines],
        weight[lines],
        output.location == "motor",
        _by_motor(run),
        run.motor_moves,
        run.spring,
        channel_key(run, output),
        exact or all(_one_clock(run, output) for *_, run, output in pool),
    )


def _one_clock(run: PreparedRun, output: Output) -> bool:
    """Whether the input's and the output's clocks are known to agree."""
    source = run.motor if _by_motor(run) else run.load
    same = source is None or source.device == output.device
    return same or all(stream.start_uncertainty == 0.0 for stream in run.run.streams)


def model_response(theta: dict[str, float], response: Response) -> Complex:
    """The linear base's counterpart of a measured response, shape (n,)."""
    s = 2j * np.pi * response.f
    K, c = theta["stiffness"], theta["damping"]
    load = theta["load_inertia"] * s * s + theta["load_damping"] * s
    gain = theta["efficiency"] * theta["torque_scale"] if response.by_motor else 1.0
    if not response.spring:
        return np.asarray(gain * s * s / load)
    spring = K + c * s
    if not response.motor_moves:
        return np.asarray(gain * s * s / (load + spring))
    motor = theta["motor_inertia"] * s * s + theta["motor_damping"] * s
    determinant = (motor + spring) * (load + spring) - spring * spring
    if response.by_motor:
        top = load + spring if response.at_motor else spring
    else:
        top = spring if response.at_motor else motor + spring
    return np.asarray(gain * s * s * top / determinant)


def fitted(base: BaseSpec, measured: tuple[Response, ...], starts: tuple[Vector, ...]) -> Vector | None:
    """Best parameter vector over the resonances that the responses suggest; ``None`` without responses.

    Args:
        base: Which parameters are free.
        measured: From :func:`responses`.
        starts: Vectors whose other parameters are kept; the first gives the trials by resonance.
    """
    names = [
        name
        for name in ("stiffness", "damping", "load_inertia", "motor_inertia", "torque_scale", "efficiency")
        if base.free[BASE_INDEX[name]]
    ]
    if not measured or not names:
        return None
    best: tuple[float, Vector] | None = None
    for trial in (*starts[1:], *_trials(base, measured, starts[0])):
        x0 = np.array([math.log(max(trial[BASE_INDEX[name]], 1e-12)) for name in names])
        fit = least_squares(
            lambda x, trial=trial: _misfit(_named(trial, names, x), measured),
            x0,
            loss="soft_l1",
            f_scale=0.3,
            max_nfev=60,
            bounds=(x0 - 9.0, x0 + 9.0),
        )
        if best is None or fit.cost < best[0]:
            best = (float(fit.cost), _filled(trial, names, fit.x))
    return None if best is None else best[1]


def first_modes(measured: tuple[Response, ...]) -> tuple[Response, ...]:
    """The responses below a further mode that accelerates most, where what moves most lies lower; none where there is no such.

    A bending arm's sensor may read little of the joint's own resonance beside its second mode.
    """
    found = []
    for response in measured:
        size = response.weight * np.abs(response.H)
        loudest = float(response.f[int(np.argmax(size))])
        farthest = float(response.f[int(np.argmax(size / response.f**2))])
        kept = response.f < loudest / _APART
        if farthest < loudest / _APART and int(np.sum(kept)) >= _ENOUGH:
            found.append(replace(response, f=response.f[kept], H=response.H[kept], weight=response.weight[kept]))
    return tuple(found)


def passive_polarities(measured: tuple[Response, ...]) -> dict[tuple[object, ...], float]:
    """-1 for each kind of channel beside a hammer or shaker whose mobility would give out energy, else +1.

    Where the force acts, Re(velocity per force) >= 0 for whatever passive machine stands behind it: no model is needed.
    A motor's torque is excluded: under a drive's feedback, weight and friction correlate with it. So are the further modes
    of an arm that bends: beyond a hinge, what is hit within it answers the other way round.
    """
    found: dict[tuple[object, ...], float] = {}
    for response in map(_as_a_whole, measured):
        if response.at_motor or response.by_motor or not response.phased:
            continue
        mobility = response.weight * response.H / (2j * np.pi * response.f)
        share = float(np.sum(np.real(mobility)) / (np.sum(np.abs(mobility)) + 1e-300))
        found[response.key] = found.get(response.key, 0.0) + share
    return {key: -1.0 if share < -_ACTIVE else 1.0 for key, share in found.items()}


def _as_a_whole(response: Response) -> Response:
    """The response below a further mode that is louder, where there is one: there an arm moves as a whole."""
    return next(iter(first_modes((response,))), response)


def work_done(runs: tuple[PreparedRun, ...], key: tuple[object, ...]) -> float:
    """Share of a drive's work that it does on the body of this kind of channel, net over gross; 0 where none tells.

    Friction may hold a body for most of a run, so that its phase is a spring's and not an inertia's; but what the drive
    puts in from rest to rest is dissipated, so along the channel's own direction it is positive.
    """
    net = gross = 0.0
    for run in runs:
        for output in run.outputs:
            if channel_key(run, output) != key or output.quantity not in ("angle", "position"):
                continue
            if _by_motor(run) and run.spring and output.location != "motor":
                continue  # what moves there is not what is driven
            drive = run.motor_half if _by_motor(run) else run.load_half
            half = run.t0 + np.arange(drive.size) / (2.0 * run.grid_rate)
            force = np.interp(output.times, half, drive)
            done = force[:-1] * np.diff(np.where(output.mask, output.data, 0.0) / _to_joint(run, output))
            done = done[output.mask[:-1] & output.mask[1:]]
            net, gross = net + float(np.sum(done)), gross + float(np.sum(np.abs(done)))
    return net / gross if gross > 0.0 else 0.0


def polarities(theta: Vector, measured: tuple[Response, ...]) -> dict[tuple[object, ...], float]:
    """-1 for each kind of channel whose phase plainly contradicts the base's, else +1."""
    named = dict(zip(BASE_NAMES, (float(v) for v in theta), strict=True))
    found: dict[tuple[object, ...], float] = {}
    for response in map(_as_a_whole, measured):
        if not response.phased:
            continue
        agreement = _agreement(response, model_response(named, response))
        if abs(agreement) > abs(found.get(response.key, 0.0)):
            found[response.key] = agreement
    return {key: -1.0 if agreement < -_CONTRADICTION else 1.0 for key, agreement in found.items()}


def _named(trial: Vector, names: list[str], x: Vector) -> dict[str, float]:
    return dict(zip(BASE_NAMES, _filled(trial, names, x), strict=True))


def _filled(trial: Vector, names: list[str], x: Vector) -> Vector:
    theta = trial.copy()
    for name, value in zip(names, x, strict=True):
        theta[BASE_INDEX[name]] = math.exp(value)
    return theta


def _agreement(response: Response, model: Complex) -> float:
    """Mean cosine between measured and modelled phase, in [-1, 1]."""
    cosine = np.real(response.H * np.conj(model)) / (np.abs(response.H * model) + 1e-300)
    return float(np.sum(response.weight * cosine) / (np.sum(response.weight) + 1e-300))


def _sign(response: Response, model: Complex) -> float:
    """+1 or -1: which polarity of the channel the model's phase agrees with."""
    return -1.0 if _agreement(response, model) < 0.0 else 1.0


def _misfit(theta: dict[str, float], measured: tuple[Response, ...]) -> Vector:
    """Weighted log-ratio of measured to modelled response, magnitude and phase, the polarity free."""
    rows = []
    for response in measured:
        model = model_response(theta, response)
        ratio = np.log((_sign(response, model) * response.H + 1e-300) / (model + 1e-300))
        size = np.sqrt(response.weight.sum() + 1e-12)
        rows.append(response.weight * np.real(ratio) / size)
        if response.phased:
            rows.append(response.weight * np.imag(ratio) / size)
    return np.concatenate(rows)


def _trials(base: BaseSpec, measured: tuple[Response, ...], start: Vector) -> list[Vector]:
    """Starts: the nameplate's, and for every plausible resonance the stiffness and inertia that give it."""
    trials = [start]
    peaks = set()
    for response in measured:
        if not response.spring:
            high = np.argsort(response.weight * response.f)[-10:]
            inertia = 1.0 / max(float(np.median(np.abs(response.H[high]))), 1e-12)
            trial = start.copy()
            trial[BASE_INDEX["load_inertia"]] = inertia
            trials.append(trial)
            continue
        magnitude = np.abs(response.H) * (response.weight > 0.2)
        order = np.argsort(magnitude)[::-1]
        for index in order[:3]:
            peaks.add(round(float(response.f[index]) * 2.0) / 2.0)
    span = np.geomspace(8.0, 120.0, _CANDIDATES) if peaks else np.array([])
    for frequency in [*sorted(peaks), *span]:
        w = 2.0 * math.pi * frequency
        for response in measured:
            if response.spring and not response.motor_moves:
                high = response.f > 1.3 * frequency
                level = float(np.median(np.abs(response.H[high]))) if high.sum() > 4 else 1.0 / start[2]
                inertia = 1.0 / max(level, 1e-12)
                break
        else:
            inertia = float(start[BASE_INDEX["load_inertia"]])
        trial = start.copy()
        trial[BASE_INDEX["load_inertia"]] = inertia
        trial[BASE_INDEX["stiffness"]] = inertia * w * w
        trial[BASE_INDEX["damping"]] = 2.0 * 0.03 * inertia * w
        if base.free[BASE_INDEX["motor_inertia"]]:
            trial[BASE_INDEX["motor_inertia"]] = inertia
        trials.append(trial)
    return trials[:14]
