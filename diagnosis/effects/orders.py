"""Where a law periodic in position should start: lines against the turn in what a model leaves, by a matched filter.

A small sin(order theta) acts as a torque in the joint (the ripple at the motor, the kinematic error as K e + c e' in the
transmission), so an output shows h * sin(order theta + phase). Along a motion the line's frequency order theta' sweeps
over the resonance, where h turns its phase: summed without h, what precedes the resonance cancels what follows. With the
residual r, its spectrum S and z = h^T S^-1 r (one filter), the decrease of r' S^-1 r by an order is

    |sum_t z e^(-i order theta)|^2 / (1/2 sum_t |H(order theta')|^2 / S(order theta')),

where the two ends' angles were recorded together, their difference shows the kinematic error itself, -e below the
resonance; and the sum over t is one Fourier transform over theta, fine enough for any number of turns.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter1d

from jointscope.diagnosis.assembly import BASE_INDEX, OBSERVER_ZETA, observer_corner
from jointscope.diagnosis.channels import ACCELERATIONS
from jointscope.diagnosis.effects.lines import Residuals, strongest
from jointscope.diagnosis.wind_up import WIND_UP

if TYPE_CHECKING:
    from jointscope.diagnosis.problem import Output, PreparedRun, Problem

Vector = NDArray[np.float64]
Complex = NDArray[np.complex128]
Line = tuple[float, float]  # order [1] and phase [rad]

# highest order per output turn (forty pins, and their second harmonic; a motor of many poles), per motor turn
TOPS = {True: 100.0, False: 14.0}
GEARED = 4.0  # motor turns per output turn, from which on a motor is one that a gear slows
PITCH = 2e-3  # m, the shortest of a slide's motor or screw
CELLS = 12  # per shortest period, into which samples are put by angle
FINER = 4  # points of the order's axis per 1/turns
SMOOTHED_HZ = 2.0  # width over which the residual's spectrum is averaged
SLOWEST = 0.02  # of the greatest speed, below which a turn shows no line
COARSE = 160  # orders at which the denominator is worked out
TURNS = {True: 0.1, False: 1.5}  # that a run must make, of the output and of the motor
TRAVEL = 0.02  # m, that a slide's run must make
PERIODS = 3.0  # of a line that a run must hold
FRINGE = 2.5  # of 1/turns, beside the strongest line, within which its fringes are given too


def order_lines(
    problem: Problem, residuals: Residuals, count: int, *, per_output: bool, source: Literal["ripple", "error"]
) -> tuple[Line, ...]:
    """(order, phase) of the strongest lines per motor (or output) turn, over all runs that travel.

    Args:
        problem: The campaign as prepared; its base's start gives the joint's response.
        residuals: What a model leaves, per run and output.
        count: How many at most.
        per_output: Orders per turn of the output, else of the motor.
        source: A torque at the motor, or an angle in the transmission.
    """
    top, least = _reach(problem, per_output)
    turns = [_turn(run, per_output) for run in problem.runs]
    longest = max((float(np.ptp(t)) for t in turns if t is not None), default=0.0)
    if longest < least:
        return ()
    grid = np.arange(PERIODS / longest, top, 1.0 / (FINER * longest))
    if grid.size < 3:
        return ()
    gain, together = np.zeros(grid.size), np.zeros(grid.size, dtype=complex)
    for run, turn, rows in zip(problem.runs, turns, residuals, strict=True):
        if turn is None or float(np.ptp(turn)) < least:
            continue
        for output, r in zip(run.outputs, rows, strict=True):
            if not (output.quantity in (*ACCELERATIONS, WIND_UP) or not run.spring) or not np.any(r):
                continue
            at = np.interp(output.times, run.time, turn)
            seen, energy = _matched(problem, run, output, r, at, grid, source)
            gain += np.where(energy > 0.0, np.abs(seen) ** 2 / np.maximum(energy, 1e-300), 0.0)
            together += seen
    found = strongest(grid, gain, count)
    places = [int(np.argmin(np.abs(grid - order))) for order in found]
    if places:
        places[1:1] = _fringes(gain, places[0], round(FRINGE * FINER))
    return tuple((float(grid[place]), float(np.angle(1j * together[place]))) for place in places)


def _fringes(gain: Vector, place: int, reach: int) -> list[int]:
    """The two highest other maxima within ``reach`` points: a resonance passed twice gives fringes of like height."""
    low, high = max(place - reach, 1), min(place + reach + 1, gain.size - 1)
    middle = gain[low:high]
    tops = low + np.flatnonzero((middle >= gain[low - 1 : high - 1]) & (middle > gain[low + 1 : high + 1]))
    return sorted((int(k) for k in tops if k != place), key=lambda k: -float(gain[k]))[:2]


def _reach(problem: Problem, per_output: bool) -> tuple[float, float]:
    """The highest order that is looked for, and the turns that a run must make; a slide's turn is 2 pi m."""
    ratio = 1.0 if per_output else problem.rig.reduction_ratio or 1.0
    if problem.rig.motion == "translational":
        return 2.0 * np.pi / (PITCH * ratio), TRAVEL * ratio / (2.0 * np.pi)
    whole = per_output or ratio < GEARED
    return TOPS[whole], TURNS[whole]


def _turn(run: PreparedRun, per_output: bool) -> Vector | None:
    """Turns of motor or output at the grid's nodes, or ``None`` where nothing says them."""
    if run.mode == "prescribed-load":
        path = run.observed_half[::2]
    elif run.observed is not None and not run.observed.rate_signal:
        path = run.observed_half[::2]
    elif run.command is not None:
        path = np.cumsum(run.command_half[::2]) / run.grid_rate + run.initial_angle
    else:
        return None
    return np.asarray(path * (1.0 if per_output else run.ratio) / (2.0 * np.pi))


def _response(
    problem: Problem, omega: Vector, source: str, quantity: str, observed: tuple[float, float] | None = None
) -> Complex:
    """What a channel of ``quantity`` shows per torque at the motor or angle in the transmission, at ``omega`` [rad/s].

    Args:
        problem: Its base's start gives the joint's response: the arm's acceleration, or q_s - q.
        omega: Frequencies [rad/s], shape (n,).
        source: ``"ripple"`` or ``"error"``.
        quantity: Of the channel.
        observed: Corner [rad/s] and damping ratio [-] of the observer by which a rigid axis follows its record.
    """
    b = {name: float(problem.base.start[i]) for name, i in BASE_INDEX.items()}
    spring = b["stiffness"] + 1j * omega * b["damping"]
    if b["stiffness"] <= 0.0 or b["motor_inertia"] <= 0.0:
        return _of_one_body(omega, quantity, observed)
    shares = 1.0 / b["motor_inertia"] + 1.0 / b["load_inertia"]
    if quantity == WIND_UP:
        pushed = np.full(omega.size, 1.0 / b["motor_inertia"]) if source == "ripple" else -spring * shares
        return np.asarray(pushed / (spring * shares - omega**2))
    through = spring / (spring * shares - omega**2)
    drive = 1.0 / b["motor_inertia"] if source == "ripple" else -(omega**2)
    return np.asarray(through * drive / b["load_inertia"])


def _of_one_body(omega: Vector, quantity: str, observed: tuple[float, float] | None) -> Complex:
    """Per torque over its inertia what one body shows: it follows, its path less what an observer takes away."""
    times = {"angle": 0, "position": 0, "angular-velocity": 1, "velocity": 1}.get(quantity)
    if times is None:
        return np.ones(omega.size, dtype=complex)
    s = 1j * np.maximum(omega, omega[1] if omega.size > 1 else 1.0)
    below = s * s if observed is None else s * s + 2.0 * observed[1] * observed[0] * s + observed[0] ** 2
    return np.asarray(s**times / below)


def _matched(
    problem: Problem, run: PreparedRun, output: Output, r: Vector, turn: Vector, grid: Vector, source: str
) -> tuple[Complex, Vector]:
    """sum_t z e^(-i 2 pi order turn) and its expected energy per unit amplitude, at the orders of ``grid``."""
    x = np.where(output.mask, r, 0.0)
    n = x.size
    spectrum = np.fft.rfft(x)
    f = np.fft.rfftfreq(n, 1.0 / output.rate)
    omega = np.asarray(2.0 * np.pi * f, dtype=np.float64)
    free = run.spring or run.observed is None
    follows = None if free else (2.0 * np.pi * observer_corner(run), OBSERVER_ZETA)
    h = _response(problem, omega, source, output.quantity, follows)
    power = np.square(np.abs(spectrum)) / n
    s = uniform_filter1d(power, max(3, round(SMOOTHED_HZ * n / output.rate)), mode="nearest") + 1e-3 * power.mean()
    z = np.fft.irfft(np.conj(h) * spectrum / np.maximum(s, 1e-300), n)
    cell = 1.0 / (CELLS * grid[-1])
    index = np.floor((turn - turn.min()) / cell).astype(int)
    size = int(2 ** np.ceil(np.log2(max(index.max() + 1, 1.0 / (cell * (grid[1] - grid[0]))))))
    binned = np.bincount(index, weights=np.where(output.mask, z, 0.0), minlength=size)
    lines = np.fft.rfft(binned)
    orders = np.arange(lines.size) / (size * cell)
    seen = np.interp(grid, orders, lines.real) + 1j * np.interp(grid, orders, lines.imag)
    seen = seen * np.exp(-2j * np.pi * grid * (turn.min() + 0.5 * cell))
    speed = np.asarray(np.abs(np.gradient(turn)) * output.rate, dtype=np.float64)
    moving = output.mask & (speed > SLOWEST * speed.max())
    density = np.square(np.abs(h)) / np.maximum(s, 1e-300)
    coarse = np.linspace(grid[0], grid[-1], COARSE)
    energy = np.array([0.5 * float(np.sum(np.interp(o * speed[moving], f, density, right=0.0))) for o in coarse])
    return seen, np.interp(grid, coarse, energy)
