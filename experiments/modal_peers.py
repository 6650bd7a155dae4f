"""pyFRF and sdypy-EMA (extra ``bench``) on the same hits: H1, poles by least-squares complex frequency, modal constant."""

from __future__ import annotations

import contextlib
import io
import warnings
from importlib.util import find_spec

import numpy as np
from numpy.typing import NDArray

from jointscope.identification.comparison import ModeFigure

Real = NDArray[np.float64]

BAND = (10.0, 100.0)  # Hz; the order and band at which it does best on these hits among those tried
ORDER = 20


def available() -> bool:
    """Whether both packages are installed."""
    return find_spec("pyFRF") is not None and find_spec("sdypy") is not None


def pyfrf_ema(torque: Real, acceleration: Real, rate: float, near: float) -> ModeFigure | None:
    """The mode nearest to ``near`` [Hz] from records of shape (n_hits, n); ``None`` where no stable pole was found.

    For a real mode the residue of the receptance is A = b1/(2 j w_d), hence b1 = -2 w_d Im A.
    """
    with (
        warnings.catch_warnings(),
        contextlib.redirect_stderr(io.StringIO()),
        contextlib.redirect_stdout(io.StringIO()),
    ):
        warnings.simplefilter("ignore")
        from pyFRF import FRF
        from sdypy import EMA

        frf = FRF(int(rate), exc=torque, resp=acceleration, exc_type="f", resp_type="a", window="none")
        h1 = np.squeeze(frf.get_FRF(frf_estimator="H1", frf_form="accelerance"))
        model = EMA.Model(
            frf=h1[1:], freq=frf.get_f_axis()[1:], lower=BAND[0], upper=BAND[1], pol_order_high=ORDER,
            frf_form="accelerance",
        )  # fmt: skip
        model.get_poles(method="lscf", show_progress=False)
        try:
            model.select_closest_poles([near])
        except (IndexError, ValueError):
            return None
        _, constants = model.get_constants(upper_r=False, lower_r=False)
        pole = model.all_poles[model.pole_ind[0][0]][model.pole_ind[0][1]]
    return ModeFigure(
        method="pyFRF + sdypy-EMA",
        frequency=float(abs(pole) / (2.0 * np.pi)),
        damping_ratio=float(-pole.real / abs(pole)),
        b1=float(-2.0 * abs(pole.imag) * constants[0, 0].imag),
    )
