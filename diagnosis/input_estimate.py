"""The torque that a noisy log most likely stands for: local Wiener filtering, so that what drives the model is no noise.

A log u + eta that drives a resonance makes the prediction ring where the recording does not, and a fit damps the ringing
with parameters that are not there: on motions whose log carried 0.2 N m of white noise, K of 54.8 kN m/rad came out at
17 and c of 11 at 91 N m s/rad. Replacing the input by its conditional mean E[u | u + eta] takes that bias away (regression
calibration, Carroll et al. 2006, chapter 4). W = max(0, 1 - (2 S_eta/S)^4) in windows of a quarter second, S the local
power, S_eta that of the log's own white part. The Wiener gain 1 - S_eta/S would take something off wherever there is noise,
the same off a quiet sweep and a loud one, and that is what Coulomb friction does: it was found on a null, at 256 nats.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import uniform_filter
from scipy.signal import ShortTimeFFT
from scipy.signal.windows import hann

from jointscope.diagnosis.input_noise import WINDOW

Vector = NDArray[np.float64]

OVERLAP = 4  # windows over any sample
SMOOTHED = 5  # cells of frequency and of time over which the local power is averaged
OVER = 2.0  # times the noise's power, below which a cell is taken for noise: the local power is itself uncertain
STEEP = (
    4  # what rises above is left as it is, or a friction is found that makes up for the torque that was taken off
)
NO_NOISE = 1e-5  # of the log's peak, below which it is left alone


def estimated_input(samples: Vector, rate: float, noise: float) -> Vector:
    """E[u | samples] of logs of smooth torque with white noise, shape of ``samples``.

    Args:
        samples: As logged [any unit], shape (n,), or (m, n) for several logs of one torque.
        rate: Of the log [Hz].
        noise: Standard deviation of the noise [as ``samples``], see :func:`input_noise.log_noise`.
    """
    length = OVERLAP * max(2, round(WINDOW * rate / OVERLAP))
    count = samples.shape[-1]
    if count < 2 * length or not noise > NO_NOISE * float(np.max(np.abs(samples))):
        return samples
    step = length // OVERLAP
    first, last = 2.0 * samples[..., :1], 2.0 * samples[..., -1:]  # odd reflection: no step at the ends
    padded = np.concatenate(
        [first - samples[..., length:0:-1], samples, last - samples[..., -2 : -length - 2 : -1]], axis=-1
    )
    window = hann(length, sym=False)
    transform = ShortTimeFFT(window, step, rate, scale_to=None, phase_shift=None)
    z = transform.stft(padded)
    power = uniform_filter(np.square(np.abs(z)), (1,) * (samples.ndim - 1) + (SMOOTHED, SMOOTHED), mode="nearest")
    white = noise**2 * float(np.sum(np.square(window)))
    kept = z * np.maximum(1.0 - (OVER * white / np.maximum(power, 1e-300)) ** STEEP, 0.0)
    x = transform.istft(kept, k1=padded.shape[-1])
    return np.asarray(x[..., length : length + count], dtype=np.float64)
