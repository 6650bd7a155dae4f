"""How far every joint moves in a run, from the linear model driven by the run's own input: the sizes of effects."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jointscope.diagnosis.arm import kernel
from jointscope.diagnosis.arm.linear import Figures, small_system
from jointscope.diagnosis.arm.problem import ArmProblem, ArmRun

Vector = NDArray[np.float64]

LOWEST = 1.0  # Hz, below which what is slow is no dynamic wind-up


def joint_motion(run: ArmRun, theta: Vector, problem: ArmProblem) -> tuple[Vector, Vector, Vector]:
    """Peak rotor speed [rad/s], dynamic wind-up [rad] and reducer torque [N m] of every joint, shape (n,) each."""
    from jointscope.diagnosis.arm.predict import assembled

    n = len(problem.facts.joints)
    P = assembled(run, theta, (), problem).P
    links = np.flatnonzero(problem.mask(run))
    speed, wind_up, torque = np.zeros(n), np.zeros(n), np.zeros(n)
    drive = run.load if run.load is not None else run.motor
    if drive is None or not len(links):
        return speed, wind_up, torque
    turning = [int(j) for j in links if run.kinds[j] != kernel.BRAKED]
    columns = (
        kernel.STIFFNESS, kernel.DAMPING, kernel.ROTOR_INERTIA, kernel.ROTOR_DAMPING, kernel.DRIVE_STIFFNESS,
        kernel.DRIVE_DAMPING,
    )  # fmt: skip
    M, C, K, force = small_system(run, Figures(*(P[:, column] for column in columns)), problem.mask(run))
    m, size = len(links), len(force)
    rate = 1024.0
    u = (run.load_half if run.load is not None else run.motor_half)[:: max(1, round(2.0 * run.grid_rate / rate))]
    rate = 2.0 * run.grid_rate / max(1, round(2.0 * run.grid_rate / rate))
    U = np.fft.rfft(u - u[0])
    hz = np.fft.rfftfreq(len(u), 1.0 / rate)
    inside = (hz > LOWEST) & (hz < 150.0)
    s = 2j * np.pi * hz[inside]
    Z = s[:, None, None] ** 2 * M + s[:, None, None] * C + K
    x = np.linalg.solve(Z, np.broadcast_to(force, (len(s), size))[..., None])[..., 0] * U[inside][:, None]

    def peak(column: NDArray[np.complex128]) -> float:
        spectrum = np.zeros(len(hz), dtype=np.complex128)
        spectrum[inside] = column
        return float(np.max(np.abs(np.fft.irfft(spectrum, len(u)))))

    for i, j in enumerate(links):
        if int(j) in turning:
            r = m + turning.index(int(j))
            wind_up[j] = peak(x[:, r] - x[:, i])
            speed[j] = peak(s * x[:, r])
        else:
            wind_up[j] = peak(x[:, i])
        torque[j] = P[j, kernel.STIFFNESS] * wind_up[j]
    if run.plant.moving >= 0:
        speed[run.plant.moving] = max(speed[run.plant.moving], float(np.max(np.abs(run.path_rate))))
    return speed, wind_up, torque
