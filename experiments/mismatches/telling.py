"""Record a mismatch's campaign, diagnose it from the campaign alone, and predict held-out runs before and after."""

from __future__ import annotations

import csv
import json
import os
import subprocess
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from jointscope.atomic import write_text
from jointscope.errors import JointscopeError
from jointscope.experiments.mismatches.causes import Mismatch, plan_of
from jointscope.prediction.scores import BandScore, band_score
from jointscope.prediction.spectra import Spectrum, spectrum
from jointscope.recordings.campaign import Campaign, Topology
from jointscope.recordings.reader import read_campaign
from jointscope.sim.concealed import paperwork
from jointscope.sim.concealed.measurement import noisy
from jointscope.sim.concealed.rehearsal import declared, rehearse

Real = NDArray[np.float64]
CHANNEL: Final = "acceleration"


@dataclass(frozen=True, eq=False)
class Curve:
    """A held-out run's spectra.

    Attributes:
        run: Its id.
        measured, before, after: Of the arm's acceleration: recorded, by the refitted base, by the diagnosed model [m/s^2].
        score_before, score_after: Over the stated band.
    """

    run: str
    measured: Spectrum = field(repr=False)
    before: Spectrum = field(repr=False)
    after: Spectrum = field(repr=False)
    score_before: BandScore
    score_after: BandScore


@dataclass(frozen=True, eq=False)
class Told:
    """What came of a mismatch.

    Attributes:
        diagnosis: The content of diagnosis.json.
        identified: Damping by the paper's method, with its 95 % interval [N m s/rad]; ``None`` where it isn't asked.
    """

    mismatch: Mismatch
    diagnosis: Mapping[str, Any]
    curves: tuple[Curve, ...]
    identified: Mapping[str, Any] | None

    @property
    def said(self) -> tuple[str, ...]:
        """``name@location`` of what was named, sorted."""
        if self.diagnosis["verdict"] != "effects":
            return ()
        return tuple(sorted(f"{e['effect']}@{e['location']}" for e in self.diagnosis["effects"]))

    @property
    def named(self) -> bool:
        """Whether all that was concealed was named, and nothing else."""
        return self.said == tuple(sorted(cause.label for cause in self.mismatch.causes))

    @property
    def damping(self) -> Mapping[str, Any]:
        """Diagnosed c with its interval [N m s/rad]; where only c + b_l could be told, that less the true b_l."""
        parameters = self.diagnosis["parameters"]
        if "damping" in parameters:
            return dict(parameters["damping"])
        found, b_l = parameters["damping_total"], self.mismatch.rig.joint.load_damping
        low, high = found["interval95"]
        return {**found, "value": found["value"] - b_l, "interval95": [low - b_l, high - b_l]}

    def bias(self, which: str) -> float:
        """Predicted over measured in the stated band, mean over the held-out runs [dB]; ``before`` or ``after``."""
        return float(np.mean([getattr(curve, f"score_{which}").bias for curve in self.curves]))

    def error(self, which: str) -> float:
        """Median |dB| in the stated band, mean over the held-out runs."""
        return float(np.mean([getattr(curve, f"score_{which}").median_error for curve in self.curves]))


def tell(mismatch: Mismatch, folder: Path, *, seed: int, quick: bool) -> Told:
    """Conceal, diagnose in a process of its own, predict the held-out runs; what is there already is kept."""
    campaign_folder = folder / "campaign"
    if not (campaign_folder / "campaign.toml").is_file():
        record(mismatch, campaign_folder, seed=seed, quick=quick)
    answer = folder / "diagnosis"
    if not (answer / "diagnosis.json").is_file():
        _jointscope("diagnose", campaign_folder, "--out", answer)
    diagnosis = json.loads((answer / "diagnosis.json").read_text(encoding="utf-8"))
    model = json.loads((answer / "model.json").read_text(encoding="utf-8"))
    write_text(folder / "base.json", json.dumps({**model, "base": model["base_alone"], "effects": []}) + "\n")
    for name, file in (("before", folder / "base.json"), ("after", answer / "model.json")):
        _jointscope("predict", file, campaign_folder, "--out", folder / name, "--no-pictures")
    identified = None
    if mismatch.reference is not None:
        _jointscope("identify", campaign_folder, "--out", folder / "identified")
        file = folder / "identified" / "identification.json"
        identified = json.loads(file.read_text(encoding="utf-8"))["parameters"]["damping"]
    campaign = read_campaign(campaign_folder)
    return Told(mismatch, diagnosis, _curves(mismatch, campaign, folder), identified)


def record(mismatch: Mismatch, folder: Path, *, seed: int, quick: bool) -> None:
    """Write the campaign; the largest run of every experiment, and a hit in four, are declared held out."""
    rng = np.random.default_rng(seed)
    plan, noise = plan_of(mismatch, rng, quick=quick)
    assert plan.setting is not None
    effects = [cause.effect(plan.setting) for cause in mismatch.causes]
    clean = [declared(c, plan.devices) for c in rehearse(mismatch.rig, plan, effects, range(len(plan.takes)))]
    records = [noisy(channels, plan.devices, noise, rng) for channels in clean]
    topology: Topology = "single-dof" if mismatch.kinds == ("hammer",) else "two-inertia"
    plate = paperwork.nameplate(mismatch.rig, topology, "rotational", rng, 0.1)
    campaign = paperwork.campaign(mismatch.rig, plan, records, plate, rng)
    held = _held_out(plan.takes)
    runs = tuple(replace(run, role="validate" if i in held else "estimate") for i, run in enumerate(campaign.runs))
    folder.parent.mkdir(parents=True, exist_ok=True)
    paperwork.write_case(replace(campaign, runs=runs), folder)


def _held_out(takes: Sequence[Any]) -> set[int]:
    hits = [i for i, take in enumerate(takes) if take.kind == "hammer"]
    held = set(hits[2::4])
    for kind in ("torque-sweep", "speed-motion"):
        driven = [i for i, take in enumerate(takes) if take.kind == kind]
        held |= set(driven[-1:])
    return held


def _jointscope(*words: object) -> None:
    command = [sys.executable, "-m", "jointscope", *map(str, words)]
    done = subprocess.run(
        command, capture_output=True, text=True, env={**os.environ, "OMP_NUM_THREADS": "1"}, check=False
    )
    if done.returncode:
        raise JointscopeError(
            f"jointscope {words[0]} failed with exit code {done.returncode}: {done.stderr[-400:]}"
        )


def _curves(mismatch: Mismatch, campaign: Campaign, folder: Path) -> tuple[Curve, ...]:
    curves = []
    for run in campaign.runs:
        if run.experiment != mismatch.kind or run.role != "validate":
            continue
        sensor = run.select("linear-acceleration")[0]
        rate = sensor.sampling_rate
        M = spectrum(sensor.samples, rate)
        before, after = (
            spectrum(predicted(folder / name / f"{run.id}.csv", sensor.samples.size), rate)
            for name in ("before", "after")
        )
        low, high = mismatch.band
        excited = _excited(M, low, high)
        scores = (band_score(M, before, low, high, excited), band_score(M, after, low, high, excited))
        curves.append(Curve(run.id, M, before, after, *scores))
    return tuple(curves)


def _excited(measured: Spectrum, low: float, high: float) -> NDArray[np.bool_]:
    """Bins in the band where something was excited: within 40 dB of the band's largest."""
    size = np.abs(measured.amplitude)
    inside = (measured.frequency >= low) & (measured.frequency <= high)
    return np.asarray(inside & (size > 0.01 * np.max(size[inside])))


def predicted(file: Path, length: int) -> Real:
    """The predicted acceleration of one run's CSV, shape (length,)."""
    with file.open(encoding="utf-8", newline="") as text:
        values = [float(row[CHANNEL]) for row in csv.DictReader(text) if row[CHANNEL]]
    if len(values) != length:
        raise JointscopeError(f"{file}: holds {len(values)} samples of {CHANNEL}, the recording {length}")
    return np.array(values)
