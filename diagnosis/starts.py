"""Start values from the data themselves: frequency responses fitted by the linear base, polarity put right on the way.

The nameplate's rough values are starts only, so none of them is trusted: each fit runs from several resonances and
the best wins. Motions too slow to show the resonance keep the nameplate's.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from jointscope.diagnosis import kernel
from jointscope.diagnosis.assembly import BASE_INDEX, BASE_NAMES
from jointscope.diagnosis.channels import ACCELERATIONS
from jointscope.identification.drive import identify_drive
from jointscope.models.parameters import STANDARD_GRAVITY, Joint, ParameterError

if TYPE_CHECKING:
    from jointscope.diagnosis.prepare import BaseSpec, Output, PreparedRun, Problem, Scales
    from jointscope.identification.drive import Drive
    from jointscope.recordings.campaign import Campaign, Nameplate

Vector = NDArray[np.float64]
Complex = NDArray[np.complex128]

_LOWEST, _HIGHEST = 2.0, 300.0  # Hz; where a joint's resonance is looked for
_LINES = 160  # per response
_CANDIDATES = 7


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


def finished(campaign: Campaign, runs: tuple[PreparedRun, ...]) -> Problem:
    """The problem with start values, polarity, drive law and typical sizes."""
    from jointscope.diagnosis.prepare import Problem

    rig = campaign.rig
    base = _base_spec(rig, runs)
    responses = _responses(runs)
    start, flips = _fit(rig, base, responses, base.start)
    base = replace(base, start=start)
    runs, findings = _righted(runs, flips)
    drive = _drive(campaign, rig, base)
    base, runs = _with_drive(base, runs, drive, rig)
    base = _bounded(base)
    problem = Problem(
        rig=rig,
        runs=runs,
        base=base,
        scales=_unit_scales(),
        torque_calibrated=_torque_calibrated(runs),
        findings=findings,
    )
    return replace(problem, scales=_scales(problem))


def channel_key(output: Output) -> tuple[object, ...]:
    """Outputs that share it are the same instrument at the same place."""
    return (output.quantity, output.location, output.direction, output.radius, output.rate, output.device)


# --- parameters -----------------------------------------------------------------------------------------------------


def _torque_calibrated(runs: tuple[PreparedRun, ...]) -> bool:
    return any(
        (run.load is not None and run.load.calibrated) or (run.motor is not None and run.motor.calibrated)
        for run in runs
    )


def _base_spec(rig: Nameplate, runs: tuple[PreparedRun, ...]) -> BaseSpec:
    """Which parameters these recordings can move, from the nameplate alone for now."""
    from jointscope.diagnosis.prepare import BaseSpec

    n = rig.reduction_ratio or 1.0
    moving = any(run.motor_moves for run in runs)
    driven = any(run.motor is not None for run in runs)
    swung = any(run.mode != "braked" for run in runs)
    springs = any(run.spring for run in runs)
    exact = rig.motor_inertia is not None and rig.reducer_inertia is not None
    load_known = any(run.load is not None and run.load.calibrated for run in runs)
    motor_known = any(run.motor is not None and run.motor.calibrated for run in runs)
    J_L = rig.inertia_reference or (
        1.3 * rig.arm_mass * (rig.arm_com_radius or 0.5) ** 2 if rig.arm_mass is not None else 1.0
    )
    if rig.motion == "translational":
        J_L = rig.inertia_reference or rig.arm_mass or 1.0
    J_M = ((rig.motor_inertia or 0.0) + (rig.reducer_inertia or 0.0)) * n * n or J_L
    K = rig.stiffness_reference or J_L * (2.0 * math.pi * 30.0) ** 2
    c = rig.damping_reference or 2.0 * 0.03 * math.sqrt(K * J_L)
    weight = 0.0
    gravity_free = False
    if rig.plane == "vertical":
        if rig.motion == "translational":
            weight = (rig.arm_mass or 0.0) * STANDARD_GRAVITY
        elif rig.arm_mass is not None and rig.arm_com_radius is not None:
            weight = rig.arm_mass * STANDARD_GRAVITY * rig.arm_com_radius
        else:
            gravity_free = any(run.motor is not None or run.command is not None for run in runs) and swung
    efficiency_free = rig.efficiency is None and driven and motor_known and (load_known or exact) and moving
    scale_free = driven and not motor_known and (load_known or (exact and moving))
    start = {
        "stiffness": K,
        "damping": c,
        "load_inertia": J_L,
        "motor_inertia": J_M,
        "motor_damping": rig.motor_damping if rig.motor_damping is not None else 0.0,
        "load_damping": rig.load_damping if rig.load_damping is not None else 0.0,
        "gravity_moment": weight,
        "efficiency": rig.efficiency or 1.0,
        "torque_scale": 1.0,
        "drive_gain": (J_M + J_L) * 60.0,
        "drive_integral": (J_M + J_L) * 60.0 * 6.0,
    }
    free = {
        "stiffness": springs,
        "damping": springs,
        "load_inertia": True,
        "motor_inertia": moving and not exact,
        "motor_damping": moving,
        "load_damping": swung,
        "gravity_moment": gravity_free,
        "efficiency": efficiency_free,
        "torque_scale": scale_free,
        "drive_gain": False,
        "drive_integral": False,
    }
    merged = {} if swung or not springs else {"damping": "damping_total"}
    if merged:
        start["damping"] += start["load_damping"]
        start["load_damping"] = 0.0
    nuisance = {"torque_scale", "drive_gain", "drive_integral"}
    values = np.array([start[name] for name in BASE_NAMES])
    return BaseSpec(
        names=BASE_NAMES,
        start=values,
        lower=np.zeros(values.size),
        upper=np.full(values.size, np.inf),
        scale=np.ones(values.size),
        free=np.array([free[name] for name in BASE_NAMES]),
        nuisance=np.array([name in nuisance for name in BASE_NAMES]),
        merged=merged,
    )


def _bounded(base: BaseSpec) -> BaseSpec:
    """Bounds and scales around the start values: dampings may vanish, inertias and stiffness stay positive."""
    b = dict(zip(BASE_NAMES, base.start, strict=True))
    critical = 2.0 * math.sqrt(b["stiffness"] * b["load_inertia"])
    scale = {
        "stiffness": b["stiffness"],
        "damping": max(b["damping"], 0.02 * critical),
        "load_inertia": b["load_inertia"],
        "motor_inertia": b["motor_inertia"],
        "motor_damping": max(b["motor_damping"], 0.02 * critical),
        "load_damping": max(b["load_damping"], 0.02 * critical),
        "gravity_moment": max(abs(b["gravity_moment"]), 2.0 * b["load_inertia"]),
        "efficiency": 1.0,
        "torque_scale": b["torque_scale"],
        "drive_gain": b["drive_gain"],
        "drive_integral": max(b["drive_integral"], b["drive_gain"]),
    }
    scales = np.array([scale[name] for name in BASE_NAMES])
    lower, upper = np.zeros(scales.size), np.full(scales.size, np.inf)
    for name in ("stiffness", "load_inertia", "motor_inertia", "torque_scale", "efficiency", "drive_gain"):
        i = BASE_INDEX[name]
        lower[i], upper[i] = 0.02 * base.start[i], 50.0 * base.start[i]
    upper[BASE_INDEX["efficiency"]] = 2.0
    for name in ("damping", "motor_damping", "load_damping", "drive_integral"):
        upper[BASE_INDEX[name]] = 1e3 * scale[name]
    i = BASE_INDEX["gravity_moment"]
    lower[i], upper[i] = -1e3 * scales[i], 1e3 * scales[i]
    return replace(base, scale=scales, lower=lower, upper=upper)


# --- responses ------------------------------------------------------------------------------------------------------


def _responses(runs: tuple[PreparedRun, ...]) -> tuple[Response, ...]:
    """One pooled H1 per kind of channel, input and boundary."""
    pools: dict[tuple[object, ...], list[tuple[Vector, Vector, float, PreparedRun, Output]]] = {}
    for run in runs:
        by_motor = run.motor is not None and (run.load is None or not np.any(run.load_half))
        drive = run.motor_half if by_motor else run.load_half
        if not np.any(drive) or run.mode.startswith("prescribed"):
            continue
        for output in run.outputs:
            if output.quantity in ("torque", "current", "voltage", "force") or output.direction == "radial":
                continue
            grid = np.clip(np.round((output.times - run.t0) * 2.0 * run.grid_rate).astype(int), 0, drive.size - 1)
            y = output.data / _to_joint(run, output)
            key = (*channel_key(output), by_motor, run.motor_moves, run.spring)
            pools.setdefault(key, []).append((drive[grid], y, output.rate, run, output))
    return tuple(r for pool in pools.values() for r in (_pooled(pool),) if r is not None)


def _to_joint(run: PreparedRun, output: Output) -> float:
    factor = run.ratio if output.location == "motor" else 1.0
    return factor * ((output.radius or 1.0) if output.quantity == "linear-acceleration" else 1.0)


def _pooled(pool: list[tuple[Vector, Vector, float, PreparedRun, Output]]) -> Response | None:
    """H1 over runs and overlapping Hann segments (hits: whole records)."""
    rate, run, output = pool[0][2], pool[0][3], pool[0][4]
    length = max(u.size for u, *_ in pool)
    impact = run.run.experiment == "hammer"
    if not impact:
        length = min(length, 2 ** int(np.log2(max(4.0 * rate, 256.0))))
    Suu, Suy, Syy, count = 0.0, 0.0, 0.0, 0
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
    keep &= np.asarray(Suu) > 1e-5 * np.max(np.asarray(Suu)[keep]) if keep.any() else keep
    if keep.sum() < 8:
        return None
    s = 2j * np.pi * f[keep]
    power = {"angle": 2, "position": 2, "angular-velocity": 1, "velocity": 1}.get(output.quantity, 0)
    H = np.asarray(Suy)[keep] / np.asarray(Suu)[keep] * s**power
    coherence = np.abs(np.asarray(Suy)[keep]) ** 2 / (np.asarray(Suu)[keep] * np.asarray(Syy)[keep] + 1e-300)
    weight = coherence if count > 2 else np.full(H.shape, 0.7)
    excited = np.sqrt(np.asarray(Suu)[keep] / np.max(np.asarray(Suu)[keep]))
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
        run.motor is not None and (run.load is None or not np.any(run.load_half)),
        run.motor_moves,
        run.spring,
        channel_key(output),
    )


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


def _fit(
    rig: Nameplate, base: BaseSpec, responses: tuple[Response, ...], start: Vector
) -> tuple[Vector, dict[tuple[object, ...], float]]:
    """Best start values over several resonances, and the sign of each kind of channel."""
    names = [
        name
        for name in ("stiffness", "damping", "load_inertia", "motor_inertia", "torque_scale", "efficiency")
        if base.free[BASE_INDEX[name]]
    ]
    if not responses or not names:
        return start, {}
    best: tuple[float, Vector] | None = None
    for trial in _trials(base, responses, start):
        x0 = np.array([math.log(max(trial[BASE_INDEX[name]], 1e-12)) for name in names])
        fit = least_squares(
            lambda x, trial=trial: _misfit(_named(trial, names, x), responses),  # type: ignore[misc]
            x0,
            loss="soft_l1",
            f_scale=0.3,
            max_nfev=60,
            bounds=(x0 - 9.0, x0 + 9.0),
        )
        if best is None or fit.cost < best[0]:
            best = (float(fit.cost), _filled(trial, names, fit.x))
    assert best is not None
    found = best[1]
    theta = dict(zip(BASE_NAMES, found, strict=True))
    return found, {r.key: _sign(r, model_response(theta, r)) for r in responses}


def _named(trial: Vector, names: list[str], x: Vector) -> dict[str, float]:
    return dict(zip(BASE_NAMES, _filled(trial, names, x), strict=True))


def _filled(trial: Vector, names: list[str], x: Vector) -> Vector:
    theta = trial.copy()
    for name, value in zip(names, x, strict=True):
        theta[BASE_INDEX[name]] = math.exp(value)
    return theta


def _sign(response: Response, model: Complex) -> float:
    """+1 or -1: which polarity of the channel the model's phase agrees with."""
    agreement = np.sum(
        response.weight * np.real(response.H * np.conj(model)) / (np.abs(response.H * model) + 1e-300)
    )
    return -1.0 if agreement < 0.0 else 1.0


def _misfit(theta: dict[str, float], responses: tuple[Response, ...]) -> Vector:
    """Weighted log-ratio of measured to modelled response, magnitude and phase, the polarity free."""
    rows = []
    for response in responses:
        model = model_response(theta, response)
        ratio = np.log((_sign(response, model) * response.H + 1e-300) / (model + 1e-300))
        size = np.sqrt(response.weight.sum() + 1e-12)
        rows.append(response.weight * np.real(ratio) / size)
        rows.append(response.weight * np.imag(ratio) / size)
    return np.concatenate(rows)


def _trials(base: BaseSpec, responses: tuple[Response, ...], start: Vector) -> list[Vector]:
    """Starts: the nameplate's, and for every plausible resonance the stiffness and inertia that give it."""
    trials = [start]
    peaks = set()
    for response in responses:
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
        for response in responses:
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


def _righted(
    runs: tuple[PreparedRun, ...], flips: dict[tuple[object, ...], float]
) -> tuple[tuple[PreparedRun, ...], tuple[str, ...]]:
    """Channels that were found inverted, turned round."""
    findings: list[str] = []
    done: list[PreparedRun] = []
    for run in runs:
        outputs = []
        for output in run.outputs:
            if flips.get(channel_key(output), 1.0) < 0.0 and not output.observed:
                start = run.initial_angle * (run.ratio if output.location == "motor" else 1.0)
                angular = output.quantity in ("angle", "position")
                data = 2.0 * start - output.data if angular else -output.data
                offset = -(output.offset + 2.0 * start) if angular else 0.0
                outputs.append(replace(output, data=data, polarity=-1.0, offset=offset))
                line = f"{output.quantity} at the {output.location} (run {run.run.id}): polarity inverted"
                findings.append(line)
            else:
                outputs.append(output)
        done.append(replace(run, outputs=tuple(outputs)))
    return tuple(done), tuple(findings)


# --- drive ----------------------------------------------------------------------------------------------------------


def _drive(campaign: Campaign, rig: Nameplate, base: BaseSpec) -> Drive | None:
    """The drive's speed law, where a command and a torque were recorded."""
    if not any(run.select("speed-command") for run in campaign.runs):
        return None
    joint = None
    if rig.motor_inertia is not None:
        b = dict(zip(BASE_NAMES, (float(v) for v in base.start), strict=True))
        try:
            joint = Joint(
                stiffness=b["stiffness"],
                damping=b["damping"],
                load_inertia=b["load_inertia"],
                motor_inertia=rig.motor_inertia,
                reducer_inertia=rig.reducer_inertia or 0.0,
                reduction_ratio=rig.reduction_ratio or 1.0,
                motor_damping=b["motor_damping"],
                load_damping=b["load_damping"],
                efficiency=b["efficiency"],
            )
        except ParameterError:
            joint = None
    try:
        return identify_drive(campaign, joint, gravity_moment=float(b["gravity_moment"]) if joint else 0.0)
    except (ValueError, np.linalg.LinAlgError):
        return None


def _with_drive(
    base: BaseSpec, runs: tuple[PreparedRun, ...], drive: Drive | None, rig: Nameplate
) -> tuple[BaseSpec, tuple[PreparedRun, ...]]:
    """The law's gains at the output in the start vector, its feed-forward and limit in the runs."""
    n = rig.reduction_ratio or 1.0
    start, free = base.start.copy(), base.free.copy()
    if drive is None:
        loops = any(run.mode == "closed-loop" for run in runs)
        for name in ("drive_gain", "drive_integral"):
            free[BASE_INDEX[name]] = loops
        total = start[BASE_INDEX["load_inertia"]] + start[BASE_INDEX["motor_inertia"]]
        start[BASE_INDEX["drive_gain"]] = 60.0 * total
        start[BASE_INDEX["drive_integral"]] = 360.0 * total
        return replace(base, start=start, free=free), runs
    start[BASE_INDEX["drive_gain"]] = drive.proportional * n * n
    start[BASE_INDEX["drive_integral"]] = drive.integral * n * n
    limit = None if drive.torque_limit is None else drive.torque_limit * n
    done = []
    for run in runs:
        if run.command is None:
            done.append(run)
            continue
        half = run.t0 + np.arange(2 * run.steps + 1) / (2.0 * run.grid_rate)
        rate, speed = run.command.signal(half, 1), run.command_half
        feed = (drive.acceleration_feedforward * rate + drive.velocity_feedforward * speed) * n * n
        done.append(replace(run, feedforward_half=feed, torque_limit=limit))
    return replace(base, start=start, free=free), tuple(done)


# --- sizes ----------------------------------------------------------------------------------------------------------


def _unit_scales() -> Scales:
    from jointscope.diagnosis.prepare import Scales

    return Scales(1.0, 1.0, 1.0, 1.0, 1.0, 1.0, 0.0, 0.0, 0.0, 30.0, 0.0, 0.0, 1.0)


def _scales(problem: Problem) -> Scales:
    """Typical sizes over all runs, from the base model at its start values."""
    from jointscope.diagnosis.predict import build, integrate
    from jointscope.diagnosis.prepare import Scales

    base = problem.base.start
    peak = dict.fromkeys(
        ("torque", "wind_up", "rate", "speed", "motor_speed", "travel", "motor", "load", "acc", "time"), 1e-12
    )
    low, high = math.inf, -math.inf
    for run in problem.runs:
        states = integrate(build(run, base, (), problem))
        if not np.all(np.isfinite(states)):
            continue
        spring = states[:, kernel.X_TS]
        delta = states[:, kernel.X_QS] - states[:, kernel.X_Q]
        q = states[:, kernel.X_Q]
        found = {
            "torque": np.ptp(spring) / 2.0 if run.spring else np.max(np.abs(run.load_half + run.motor_half)),
            "wind_up": np.ptp(delta) / 2.0,
            "rate": np.max(np.abs(states[:, kernel.X_VS] - states[:, kernel.X_V])),
            "speed": np.max(np.abs(states[:, kernel.X_V])),
            "motor_speed": np.max(np.abs(states[:, kernel.X_VS])),
            "travel": np.ptp(q),
            "motor": np.max(np.abs(run.motor_half)) if run.motor is not None else 0.0,
            "load": np.max(np.abs(run.load_half)),
            "acc": max((np.max(np.abs(o.data)) for o in run.outputs if o.quantity in ACCELERATIONS), default=0.0),
            "time": run.steps / run.grid_rate,
        }
        peak = {name: max(peak[name], float(value)) for name, value in found.items()}
        low, high = min(low, float(q.min())), max(high, float(q.max()))
    frequency = math.sqrt(base[BASE_INDEX["stiffness"]] / base[BASE_INDEX["load_inertia"]]) / (2.0 * math.pi)
    return Scales(
        torque=peak["torque"],
        wind_up=peak["wind_up"],
        wind_up_rate=peak["rate"],
        speed=peak["speed"],
        motor_speed=peak["motor_speed"],
        travel=peak["travel"],
        motor_torque=peak["motor"] if peak["motor"] > 1e-12 else 0.0,
        load_torque=peak["load"] if peak["load"] > 1e-12 else 0.0,
        acceleration=peak["acc"] if peak["acc"] > 1e-12 else 0.0,
        frequency=frequency,
        angle_low=low if math.isfinite(low) else 0.0,
        angle_high=high if math.isfinite(high) else 0.0,
        duration=peak["time"],
    )
