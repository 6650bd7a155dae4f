r"""Small motion of the prepared arm in the frequency domain: which joints the recordings see, and where a fit starts.

Z(s) x = (s^2 M + s C + K) x = f,   x = (links, rotors that turn)
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import optimize

from jointscope.diagnosis.arm import kernel
from jointscope.diagnosis.arm.problem import ArmRun

Vector = NDArray[np.float64]
Complex = NDArray[np.complex128]

BAND = (4.0, 180.0)  # Hz
LINES = 130
ASKED = 2e-3  # of the input's greatest energy, above which a line counts
SMOOTHED = 0.6  # Hz over which a single record's spectra are averaged
FACTORS = (0.4, 0.6, 0.8, 1.0, 1.3, 1.8, 2.6)  # of the stated stiffness, tried as starts
RIGID = 1e10  # N m/rad that stands for no compliance


@dataclass(frozen=True, eq=False)
class Figures:
    """K, c, J_M, b_m, k_p, k_v per joint, shape (n,) each."""

    stiffness: Vector
    damping: Vector
    rotor_inertia: Vector
    rotor_damping: Vector
    drive_stiffness: Vector
    drive_damping: Vector


def frequencies() -> Vector:
    """The lines that are compared [Hz], shape (LINES,)."""
    return np.geomspace(*BAND, LINES)


def small_system(run: ArmRun, figures: Figures, mask: NDArray[np.bool_]) -> tuple[Vector, Vector, Vector, Vector]:
    """M, C, K of small motion about the posture and the run's unit force: the links of ``mask``, then their rotors."""
    links = np.flatnonzero(mask)
    turning = [int(j) for j in links if run.kinds[j] != kernel.BRAKED]
    m, size = len(links), len(links) + len(turning)
    M, C, K = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, size))
    square = np.ix_(links, links)
    middle = run.plant.mass.shape[0] // 2
    M[:m, :m], K[:m, :m] = run.plant.mass[middle][square], run.plant.slope[middle][square]
    for i, link in enumerate(links):
        places = [i] + ([m + turning.index(int(link))] if int(link) in turning else [])
        sign = np.array([[1.0, -1.0], [-1.0, 1.0]])[: len(places), : len(places)]
        K[np.ix_(places, places)] += figures.stiffness[link] * sign
        C[np.ix_(places, places)] += figures.damping[link] * sign
    for r, joint in enumerate(turning):
        M[m + r, m + r] = figures.rotor_inertia[joint]
        C[m + r, m + r] += figures.rotor_damping[joint]
        if run.kinds[joint] == kernel.HELD:
            C[m + r, m + r] += figures.drive_damping[joint]
            K[m + r, m + r] += figures.drive_stiffness[joint]
    force = np.zeros(size)
    if run.load is not None:
        force[:m] = run.plant.hit[links]
    elif run.driven in turning:
        force[m + turning.index(run.driven)] = 1.0
    return M, C, K, force


def response(run: ArmRun, figures: Figures, mask: NDArray[np.bool_], hz: Vector) -> Complex:
    """Accelerometers per unit of the run's input (hammer force, else motor torque), shape (len(hz), o)."""
    links = np.flatnonzero(mask)
    m, middle = len(links), run.plant.mass.shape[0] // 2
    M, C, K, force = small_system(run, figures, mask)
    size = len(force)
    s = 2j * np.pi * hz
    Z = s[:, None, None] ** 2 * M + s[:, None, None] * C + K
    x = np.linalg.solve(Z, np.broadcast_to(force, (len(s), size))[..., None])[..., 0][:, :m]
    rows = s[:, None, None] ** 2 * run.plant.motion[middle][:, links] + run.plant.tilt[middle][:, links]
    return np.asarray(np.einsum("soi,si->so", rows, x))


def spots(runs: Sequence[ArmRun]) -> list[list[ArmRun]]:
    """Runs of small motion that share posture, hold and input; their responses are one."""
    found: dict[tuple[object, ...], list[ArmRun]] = {}
    for run in runs:
        if run.plant.moving >= 0:
            continue
        key = (
            run.load is not None,
            run.driven,
            tuple(run.kinds),
            tuple(run.locked),
            tuple(np.round(run.plant.hit, 6)),
            tuple(np.round(run.plant.mass[0].ravel(), 6)),
            tuple((o.location, o.rate, len(o.data)) for o in run.outputs),
        )
        found.setdefault(key, []).append(run)
    return list(found.values())


def measured(runs: Sequence[ArmRun], hz: Vector) -> tuple[Complex, NDArray[np.bool_]]:
    """H1 of runs of one spot at ``hz``, shape (len(hz), o), and which lines their input asked for.

    Averaged over runs and over ``SMOOTHED``.
    """
    first = runs[0]
    sensors = [i for i, p in enumerate(first.probes) if p >= 0]
    cross = np.zeros((len(hz), len(sensors)), dtype=np.complex128)
    auto = np.zeros(len(hz))
    for run in runs:
        drive = run.load or run.motor
        assert drive is not None
        for column, i in enumerate(sensors):
            output = run.outputs[i]
            u = drive.signal(output.times)
            window = np.ones(len(u)) if run.load is not None else np.hanning(len(u))
            U = np.fft.rfft((u - np.mean(u) * (run.load is None)) * window)
            Y = np.fft.rfft((output.data - np.mean(output.data)) * window)
            width = output.rate / len(u)
            reach = max(1, round(0.5 * SMOOTHED / width))
            ones = np.ones(2 * reach + 1)
            place = np.clip(np.round(hz / width).astype(int), 0, len(U) - 1)
            cross[:, column] += np.convolve(Y * np.conj(U), ones, mode="same")[place]
            if column == 0:
                auto += np.convolve(np.abs(U) ** 2, ones, mode="same")[place]
    return cross / np.maximum(auto, 1e-300)[:, None], np.asarray(auto > ASKED * auto.max())


def changes(run: ArmRun, figures: Figures, before: NDArray[np.bool_], after: NDArray[np.bool_]) -> float:
    """Relative change of the response between two sets of elastic joints [-]."""
    hz = frequencies()
    if run.load is None and run.driven >= 0 and not (before[run.driven] and after[run.driven]):
        return 1.0
    a, b = response(run, figures, before, hz), response(run, figures, after, hz)
    size = float(np.max(np.sqrt(np.mean(np.abs(a) ** 2, axis=0)))) or 1.0
    return float(np.max(np.sqrt(np.mean(np.abs(a - b) ** 2, axis=0)))) / size


def fitted_start(
    runs: Sequence[ArmRun],
    figures: Figures,
    masks: dict[int, NDArray[np.bool_]],
    sought: NDArray[np.int_],
) -> tuple[Vector, Vector]:
    """K and c of the joints ``sought`` from the logarithms of the responses' magnitudes, robustly; shape (n,) each.

    Magnitudes in logarithms have a wide basin: resonances that are off by a third still pull the right way.
    """
    groups = spots(runs)
    hz = frequencies()
    if not groups or not len(sought):
        return figures.stiffness, figures.damping
    found = [measured(g, hz) for g in groups]
    data = [np.log(np.maximum(np.abs(h[asked]), 1e-12)) for h, asked in found]
    lines = [hz[asked] for _, asked in found]

    def moved(x: Vector) -> Figures:
        K, c = figures.stiffness.copy(), figures.damping.copy()
        K[sought] *= np.exp(x[: len(sought)])
        c[sought] *= np.exp(x[len(sought) :])
        return Figures(
            K, c, figures.rotor_inertia, figures.rotor_damping, figures.drive_stiffness, figures.drive_damping
        )

    def residual(x: Vector) -> Vector:
        at = moved(x)
        parts = [
            np.log(np.maximum(np.abs(response(g[0], at, masks[g[0].index], f)), 1e-12)) - d
            for g, d, f in zip(groups, data, lines, strict=True)
        ]
        weak = 0.05 * x  # what the responses do not show stays where it was stated
        return np.concatenate([*(p.ravel() for p in parts), weak])

    starts = [np.concatenate([np.full(len(sought), np.log(f)), np.zeros(len(sought))]) for f in FACTORS]
    starts.sort(key=lambda x: float(np.sum(np.log1p(np.square(residual(x) / 0.3)))))
    best = min(
        (
            optimize.least_squares(residual, x, loss="soft_l1", f_scale=0.2, max_nfev=30, x_scale=1.0)
            for x in starts[:3]
        ),
        key=lambda fit: float(fit.cost),
    )
    at = moved(np.clip(best.x, -3.0, 3.0))
    return at.stiffness, at.damping
