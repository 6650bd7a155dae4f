from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from jointscope.experiments.recovery_truth import Bench, Pulse, draw_pulses, record
from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream

MakeCampaign = Callable[..., Campaign]


def hammer_run(
    name: str,
    force: np.ndarray,
    acceleration: np.ndarray,
    bench: Bench,
    *,
    unit: str = "N",
    low_cutoff: float = 0.0,
) -> Run:
    coupling = {"coupling": "ac", "low_cutoff": low_cutoff} if low_cutoff else {}
    channels = (
        Channel(column="force", quantity="force", unit=unit, location="arm", role="input", samples=force,
                radius=bench.hammer_radius, **coupling),
        Channel(column="acc", quantity="linear-acceleration", unit="m/s^2", location="arm", role="output",
                samples=acceleration, radius=bench.accelerometer_radius, **coupling),
    )  # fmt: skip
    stream = Stream(file="hit", sampling_rate=bench.rate, length=force.size, channels=channels)
    return Run(id=name, experiment="hammer", brake=True, streams=(stream,))


@pytest.fixture(scope="session")
def make_campaign() -> MakeCampaign:
    """Hits on the braked joint in closed form, with noise as a share of each hit's peak."""

    def make(
        seed: int = 0,
        *,
        hits: int = 12,
        acceleration: float = 0.01,
        force: float = 0.005,
        bench: Bench | None = None,
        pulses: list[Pulse] | None = None,
        change: Callable[[int, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]] | None = None,
        unit: str = "N",
        low_cutoff: float = 0.0,
        **rig: object,
    ) -> Campaign:
        rng = np.random.default_rng(seed)
        bench = bench or Bench()
        runs = []
        for number, pulse in enumerate(pulses or draw_pulses(rng, hits)):
            u, y = record(bench, pulse)
            if change is not None:
                u, y = change(number, u, y)
            u = u + force * np.abs(u).max() * rng.standard_normal(u.size)
            y = y + acceleration * np.abs(y).max() * rng.standard_normal(y.size)
            runs.append(hammer_run(f"hit-{number}", u, y, bench, unit=unit, low_cutoff=low_cutoff))
        nameplate = Nameplate(**{"topology": "two-inertia", "motion": "rotational", **rig})
        return Campaign(path=Path("made"), rig=nameplate, runs=tuple(runs))

    return make
