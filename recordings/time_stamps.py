"""From time stamps to the uniform grid that everything else works on: band-limited, with the jitter reported.

y(t_k) = sum_j u_j sinc((t_k - t_0)/h - j) w(...): the samples u on the grid are those whose band-limited interpolation
passes through what was recorded, found by banded least squares.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jointscope.errors import CampaignError

Real = NDArray[np.float64]
_REACH = 24  # grid steps to either side of the windowed sinc
MOST_LACKING = 100.0  # grid steps per row of the file: sparser than that is a broken stamp, not a gap
_NEGLIGIBLE = 1e-6  # of a step: below it the stamps are the grid


@dataclass(frozen=True, kw_only=True, eq=False)
class UniformGrid:
    """Samples on the grid.

    Attributes:
        samples: Per column, shape (length,); NaN where rows were missing.
        jitter: Largest distance of a stamp from its grid point [s].
    """

    samples: dict[str, Real]
    length: int
    jitter: float


def on_uniform_grid(
    stamps: Real, raw: dict[str, Real], rate: float, *, masked: bool, file: Path, column: str, key: str
) -> UniformGrid:
    """Put columns recorded at ``stamps`` [s], shape (n,), on a grid of ``rate`` [Hz] that begins at the first stamp.

    Stamps that are off the grid by no more than their own last printed digit are taken to lie on it.

    Raises:
        CampaignError: Stamps that don't increase, don't fit the rate, or leave gaps that ``gaps`` doesn't admit.
    """
    _check_stamps(stamps, rate, file, column, key)
    steps = (stamps - stamps[0]) * rate
    if not steps[-1] < MOST_LACKING * max(stamps.size, 64):
        raise CampaignError(
            file, column, f"{stamps.size} rows are spread over {stamps[-1] - stamps[0]:.6g} s", value=float(stamps[-1]),
            fix="mend the stamp that jumps, or give each part its own stream",
        )  # fmt: skip
    nearest = np.rint(steps)
    # grid points follow the count of samples, not the clock, until a row is missing: a rate off by ppm is no gap
    index = np.concatenate([[0], np.cumsum(np.maximum(1.0, np.rint(np.diff(steps))))])
    slipped = float(np.abs(index - steps).max())
    index = (index if slipped < 0.5 else nearest).astype(np.int64)
    length = int(index[-1]) + 1
    lacking = length - stamps.size
    if lacking and not masked:
        first = int(np.flatnonzero(np.diff(index) > 1)[0])
        raise CampaignError(
            file, column, f"{lacking} rows are missing, the first after {stamps[first]:.6g} s",
            fix="say gaps = 'mask' on the stream to leave them unscored",
        )  # fmt: skip
    jitter = float(np.abs(steps - index).max()) / rate
    if np.unique(index).size != index.size:
        raise CampaignError(
            file,
            column,
            f"jitter of {jitter:.3g} s puts two rows into one step of the rate",
            fix="check sampling_rate",
        )
    on_grid = jitter * rate <= _NEGLIGIBLE or _only_rounded(stamps, jitter)
    samples = {}
    for name, values in raw.items():
        placed = np.full(length, np.nan)
        placed[index] = values
        samples[name] = placed if on_grid else _solved(steps, values, index, length)
    return UniformGrid(samples=samples, length=length, jitter=jitter)


def _check_stamps(stamps: Real, rate: float, file: Path, column: str, key: str) -> None:
    bad = np.flatnonzero(~np.isfinite(stamps))
    if bad.size:
        raise CampaignError(file, column, f"time stamp {bad[0]} is not a number", value=float(stamps[bad[0]]))
    if not stamps.size:
        raise CampaignError(file, column, "no time stamps", fix="mend the file")
    back = np.flatnonzero(np.diff(stamps) <= 0.0)
    if back.size:
        raise CampaignError(
            file, column, f"time does not increase after row {back[0] + 1}", value=float(stamps[back[0] + 1]),
            fix="sort the rows, drop repeats",
        )  # fmt: skip
    if stamps.size < 2:
        return
    found = 1.0 / float(np.median(np.diff(stamps)))
    if (
        abs(found / rate - 1.0) > 0.2
    ):  # a coarse print (1.024 kHz in ms) is within that, a wrong rate or unit is not
        raise CampaignError(
            file, f"{key.rsplit('.', 1)[0]}.sampling_rate", f"{column} steps by {1.0 / found:.6g} s", value=rate,
            fix=f"{found:.6g} Hz if the stamps are seconds",
        )  # fmt: skip


def _only_rounded(stamps: Real, jitter: float) -> bool:
    """Whether the jitter is the stamps' own rounding: all are multiples of a decimal unit that is not finer."""
    for digits in range(7):
        unit = 10.0**-digits
        if unit < jitter:
            return False
        scaled = stamps / unit
        if jitter <= 1.02 * unit and np.allclose(scaled, np.rint(scaled), rtol=0.0, atol=1e-4):
            return True
    return False


def _solved(steps: Real, values: Real, index: NDArray[np.int64], length: int) -> Real:
    """Grid samples, shape (length,), by banded normal equations with a ridge that only the gaps feel."""
    from scipy.linalg import cho_solve_banded, cholesky_banded

    here = np.isfinite(values)
    offset = np.arange(-_REACH, _REACH + 1)
    points = index[here, None] + offset  # (m, taps)
    distance = steps[here, None] - points
    shape = np.clip(1.0 - (distance / (_REACH + 1.0)) ** 2, 0.0, None)
    kernel = np.sinc(distance) * np.i0(9.0 * np.sqrt(shape)) / np.i0(9.0)
    kernel[(points < 0) | (points >= length)] = 0.0
    mean = float(values[here].mean())  # the kernel passes constants only nearly; so none is put through it
    band = np.zeros((2 * _REACH + 1, length))  # lower form: band[d, j] = N[j + d, j]
    target = np.zeros(length)
    clipped = np.clip(points, 0, length - 1)
    np.add.at(target, clipped, kernel * (values[here] - mean)[:, None])
    for gap in range(2 * _REACH + 1):
        products = kernel[:, : kernel.shape[1] - gap] * kernel[:, gap:]
        np.add.at(band[gap], clipped[:, : kernel.shape[1] - gap], products)
    band[0] += 1e-9
    factor = cholesky_banded(band, lower=True)
    solution = cho_solve_banded((factor, True), target)
    applied = np.sum(kernel * solution[clipped], axis=1)  # one refinement takes the ridge's bias away
    residual = np.zeros(length)
    np.add.at(residual, clipped, kernel * (values[here] - mean - applied)[:, None])
    solution = solution + cho_solve_banded((factor, True), residual) + mean
    grid = np.full(length, np.nan)
    grid[index[here]] = solution[index[here]]
    return grid
