"""A finding: one thing that is wrong, or looks wrong, with one channel of one run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final


@dataclass(frozen=True)
class Finding:
    """What ``inspect`` says of a channel; nothing is ever corrected by it.

    Attributes:
        finding: Its name, one of ``NAMES``.
        run: The run's id.
        channel: The column, or an empty text where the run or a stream is meant.
        detail: One line with the figures.
        toml: The corrected line of ``campaign.toml`` to paste, or ``None``.
    """

    finding: str
    run: str
    channel: str
    detail: str
    toml: str | None = None

    def as_json(self) -> dict[str, str | None]:
        """The entry of ``quality`` in diagnosis and identification files."""
        return {
            "finding": self.finding, "run": self.run, "channel": self.channel, "detail": self.detail, "toml": self.toml
        }  # fmt: skip


NAMES: Final = {
    "double-hit": "the hammer touched twice in one run",
    "clipping": "the signal is cut off at a level",
    "overload": "the signal reaches the sensor's full scale",
    "inverted-polarity": "the sign contradicts the other channels",
    "offset": "a channel at rest doesn't read zero",
    "undersampled-pulse": "the hammer's pulse is too short for the sampling rate",
    "clock-skew": "two devices' clocks disagree",
    "dead-channel": "nothing was recorded on it",
    "suspicious-unit": "its unit or scale contradicts the file or the other channels",
    "truncated-decay": "the recording ends before the arm has come to rest",
    "low-coherence": "repeats of the same excitation don't give the same response",
    "sample-gaps": "samples are missing, or stuck at the one before",
    "held-samples": "each value is repeated: the true rate is lower than the declared one",
    "time-jitter": "time stamps are off a uniform grid",
    "mains-hum": "a steady line at the mains frequency",
    "quantisation": "the signal spans few steps of its resolution",
    "lagging-speed": "a speed lags the rate of the angle beside it",
    "unsettled-iepe": "an ac-coupled sensor was still settling when the recording began",
    "gravity-mismatch": "what a static sensor or the holding torque reads isn't what gravity makes of arm_angle",
}
