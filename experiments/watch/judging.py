"""A take judged by itself and against the ones before it: good, good once something is mended, or to be repeated."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from numpy.typing import NDArray

from jointscope.identification.hit_spectra import Rejected, read_hit
from jointscope.identification.quality import findings
from jointscope.identification.quality_coherence import FEWEST
from jointscope.recordings.campaign import Campaign, Run, Signal
from jointscope.recordings.finding import Finding
from jointscope.recordings.pulses import Pulse, baseline, find_pulses
from jointscope.recordings.quality_rest import quiet_start

Real = NDArray[np.float64]
Verdict = Literal["good", "mend", "repeat"]

ADVICE: Final[dict[str, tuple[Verdict, str]]] = {
    "double-hit": ("repeat", "strike once and let the hammer fall back"),
    "clipping": ("repeat", "widen that channel's range, or strike more softly"),
    "overload": ("repeat", "widen that channel's range, or strike more softly"),
    "dead-channel": ("repeat", "check sensor, cable and supply of that channel"),
    "truncated-decay": ("repeat", "record until the arm is quiet"),
    "undersampled-pulse": ("repeat", "take a softer tip or sample faster"),
    "sample-gaps": ("repeat", "the device lost samples: check its buffer"),
    "unsettled-iepe": ("repeat", "wait until the sensor has settled, then record"),
    "low-coherence": ("repeat", "strike the same point in the same direction"),
    "low-level": ("repeat", "excite more strongly, or narrow that channel's range"),
    "no-input": ("repeat", "record what drives the arm"),
    "no-output": ("repeat", "record how the arm moves"),
    "inverted-polarity": ("mend", "turn the sensor round, or paste the line"),
    "suspicious-unit": ("mend", "correct the unit in campaign.toml"),
    "gravity-mismatch": ("mend", "check arm_angle, the sensor's mounting, coupling and gain"),
    "lagging-speed": ("mend", "take the drive's speed filter out, or log the angle and leave the speed out"),
    "clock-skew": ("mend", "start the devices by one trigger, or say start = 'unknown'"),
    "held-samples": ("mend", "log at the true rate, or declare it"),
    "quantisation": ("mend", "narrow that channel's range"),
    "offset": ("good", "zero the amplifier when convenient"),
    "mains-hum": ("good", "look for a ground loop when convenient"),
    "time-jitter": ("good", "resampled; a hardware clock would be better"),
}
_RANK: Final[dict[Verdict, int]] = {"good": 0, "mend": 1, "repeat": 2}
QUIET: Final = 5.0  # times its noise that a channel must reach, rms
ALIKE: Final = 2.0  # ratio of peaks up to which hits are expected to give one and the same response
UNLIKE: Final = 0.25  # share of a response that like hits don't foretell
AFTER: Final = 0.25  # s after a hit


@dataclass(frozen=True, kw_only=True)
class Reason:
    """Something about a take.

    Attributes:
        name: As ``inspect`` calls it, or ``low-level``.
        channel: The column, or empty.
        detail: One line with the figures.
        verdict: What it makes of the take.
        advice: What to do.
        toml: The corrected line of ``campaign.toml``, or ``None``.
    """

    name: str
    channel: str
    detail: str
    verdict: Verdict
    advice: str
    toml: str | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class Take:
    """A judged take.

    Attributes:
        run: As read.
        level: Peak force or largest drive signal, in the channel's unit; NaN where nothing drives it.
        level_unit: Of ``level``.
    """

    run: Run
    verdict: Verdict
    reasons: tuple[Reason, ...]
    level: float
    level_unit: str


def judge(run: Run, campaign: Campaign, before: Sequence[Take]) -> Take:
    """Judge a take.

    Args:
        campaign: What the run belongs to; only its nameplate and topology are used.
        before: Takes that can be used, oldest first: hits of like level must give a like response.
    """
    alone = Campaign(
        path=campaign.path, rig=campaign.rig, runs=(run,), mjcf=campaign.mjcf, urdf=campaign.urdf,
        joints=campaign.joints,
    )  # fmt: skip
    reasons = [_reason(finding) for finding in findings(alone)]
    told = {(reason.name, reason.channel) for reason in reasons}
    reasons += [r for r in _levels(run) if ("dead-channel", r.channel) not in told]
    if run.experiment == "hammer":
        if campaign.rig.topology != "arm" and not any(r.verdict == "repeat" for r in reasons):
            hit = read_hit(run, campaign.rig)
            if isinstance(hit, Rejected):
                reasons.append(_of(hit.finding, "", hit.detail))
        if not any(reason.verdict == "repeat" for reason in reasons):
            reasons += _coherence(run, before)
    level, unit = excitation_level(run)
    verdicts: list[Verdict] = [reason.verdict for reason in reasons]
    worst: Verdict = max(verdicts, key=lambda verdict: _RANK[verdict], default="good")
    ordered = sorted(reasons, key=lambda reason: -_RANK[reason.verdict])
    return Take(run=run, verdict=worst, reasons=tuple(ordered), level=level, level_unit=unit)


def _reason(finding: Finding) -> Reason:
    return _of(finding.finding, finding.channel, finding.detail, finding.toml)


def _of(name: str, channel: str, detail: str, toml: str | None = None) -> Reason:
    verdict, advice = ADVICE.get(name, ("repeat", "take it again"))
    return Reason(name=name, channel=channel, detail=detail, verdict=verdict, advice=advice, toml=toml)


def main_pulse(run: Run) -> tuple[Signal, Pulse] | None:
    """The hammer's channel and its strongest contact."""
    for force in run.select("force", role="input"):
        pulses = find_pulses(force.samples, force.sampling_rate)
        if pulses:
            return force, max(pulses, key=lambda pulse: abs(pulse.height))
    return None


def excitation_level(run: Run) -> tuple[float, str]:
    """Peak of the hit, or the largest departure of what drives the run from its median, with its unit (SI)."""
    from jointscope.recordings.units import si_unit

    if run.experiment == "hammer":
        found = main_pulse(run)
        return (float("nan"), "") if found is None else (abs(found[1].height), si_unit(found[0].channel))
    for signal in run.select(role="input"):
        x = signal.samples
        return float(np.nanmax(np.abs(x - np.nanmedian(x)))), si_unit(signal.channel)
    return float("nan"), ""


def _levels(run: Run) -> Iterator[Reason]:
    """``low-level``: what was excited must stand out of what the channel reads at rest."""
    hit = main_pulse(run) if run.experiment == "hammer" else None
    for signal in run.select():
        channel = signal.channel
        if channel.quantity == "frf" or "acceleration" not in channel.quantity:
            continue
        noise, excited = _noise_and_signal(run, signal, hit)
        if noise > 0.0 and 0.0 < excited < QUIET * noise:
            detail = f"rms {excited:.3g} when excited, {noise:.3g} at rest: {excited / noise:.2g} times its noise"
            yield _of("low-level", channel.column, detail)
    if hit is not None:
        force, pulse = hit
        _, scatter = baseline(force.samples)
        if abs(pulse.height) < 4.0 * QUIET * scatter:
            detail = f"the hit's peak is {abs(pulse.height) / scatter:.3g} times the channel's noise"
            yield _of("low-level", force.channel.column, detail)


def _noise_and_signal(run: Run, signal: Signal, hit: tuple[Signal, Pulse] | None) -> tuple[float, float]:
    """Standard deviations at rest and when excited; zeros where they can't be had."""
    x = np.nan_to_num(signal.samples - np.nanmedian(signal.samples))
    if hit is None:
        quiet = quiet_start(run, signal)
        return (0.0, 0.0) if quiet is None else (float(np.std(quiet)), float(np.std(x)))
    force, pulse = hit
    at = round((force.times[pulse.first] - signal.stream.start) * signal.sampling_rate)
    rest, ringing = x[: max(at - 4, 0)], x[at : at + round(AFTER * signal.sampling_rate)]
    if rest.size < 16 or ringing.size < 16:
        return 0.0, 0.0
    return float(np.std(rest)), float(np.std(ringing))


def _coherence(run: Run, before: Sequence[Take]) -> Iterator[Reason]:
    """``low-coherence``: a response that the last hits of like level don't foretell, though they foretell each other's."""
    found = main_pulse(run)
    if found is None:
        return
    height = abs(found[1].height)
    alike = [t for t in before if t.run.experiment == "hammer" and 1.0 / ALIKE < t.level / height < ALIKE]
    for signal in run.select(role="output"):
        if "acceleration" not in signal.channel.quantity:
            continue
        pairs = [pair for take in alike if (pair := _pair(take.run, signal, found[0])) is not None][-FEWEST:]
        if len(pairs) < FEWEST:
            continue
        missed, usual = unlike(pairs, (found[0], signal))
        if missed > UNLIKE and missed > 3.0 * usual:
            detail = (
                f"misses what the last {len(pairs)} hits of like level foretell by {100.0 * missed:.0f} % rms; "
                f"those miss each other by {100.0 * usual:.2g} %"
            )
            yield _of("low-coherence", signal.channel.column, detail)


def unlike(pairs: Sequence[tuple[Signal, Signal]], last: tuple[Signal, Signal]) -> tuple[float, float]:
    """How far a hit's response is from the linear one of others, and the most that one of those is from the rest.

    Both as the share |A - H F|/|A| over the lines that every force drives (above a tenth of its largest), with H the
    least-squares FRF of the others. The median coherence would not do: above its resonance every arm is a mass.

    Args:
        pairs: (force, response) of at least two hits, alike in every respect.
        last: Of the hit in question.
    """
    length = min(min(f.samples.size, a.samples.size) for f, a in [*pairs, last])
    F, A = (np.array([_spectrum(pair[side].samples[:length]) for pair in [*pairs, last]]) for side in (0, 1))
    driven = (np.abs(F) > 0.1 * np.abs(F[:, 1:]).max(axis=1, keepdims=True)).all(axis=0)
    driven[:2] = False
    F, A = F[:, driven], A[:, driven]

    def missed(one: int, others: Sequence[int]) -> float:
        H = np.sum(np.conj(F[others]) * A[others], axis=0) / np.maximum(
            np.sum(np.abs(F[others]) ** 2, axis=0), 1e-300
        )
        return float(np.linalg.norm(A[one] - H * F[one])) / max(float(np.linalg.norm(A[one])), 1e-300)

    among = range(len(pairs))
    usual = max(missed(one, [other for other in among if other != one]) for one in among)
    return missed(len(pairs), list(among)), usual


def _spectrum(x: Real) -> NDArray[np.complex128]:
    return np.asarray(np.fft.rfft(np.nan_to_num(x - np.nanmedian(x))), dtype=np.complex128)


def _pair(run: Run, signal: Signal, force: Signal) -> tuple[Signal, Signal] | None:
    """The same channels of an earlier hit, where everything about them is the same."""

    def key(s: Signal) -> tuple[object, ...]:
        c = s.channel
        return c.column, c.quantity, c.radius, c.direction, s.sampling_rate, s.stream.start, c.unit

    forces = [s for s in run.select("force", role="input") if key(s) == key(force)]
    outputs = [s for s in run.select(role="output") if key(s) == key(signal)]
    if not forces or not outputs or force.sampling_rate != signal.sampling_rate:
        return None
    return forces[0], outputs[0]
