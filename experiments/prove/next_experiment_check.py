"""Does the recording that the diagnosis asks for settle an ambiguous case, and better than another of the menu?

Cases are small campaigns of the concealed generator (``sim.concealed``), their strength moved until the diagnosis, given
the effect and its look-alikes as candidates, is in doubt. Then the suggested recording and one drawn from the menu are
carried out on the same rig in MuJoCo with the same concealed effect, added to the campaign, and diagnosed anew.

  python -m jointscope.experiments.prove.next_experiment_check --out out/next --cases 40
"""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from jointscope.atomic import write_text
from jointscope.diagnosis.adjudicate import Judgement, judge
from jointscope.diagnosis.base import refit_base
from jointscope.diagnosis.effects import catalogue
from jointscope.diagnosis.menu import Take, as_run, lab_of, planned
from jointscope.diagnosis.next_experiment import Suggestion, suggest
from jointscope.diagnosis.pipeline import silent
from jointscope.diagnosis.predict import predict_outputs
from jointscope.diagnosis.prepare import Problem, prepare
from jointscope.diagnosis.rounds import explore
from jointscope.diagnosis.search import Effort
from jointscope.diagnosis.split import split_runs
from jointscope.diagnosis.two_of_three import answered
from jointscope.diagnosis.verdict import Decision
from jointscope.experiments.rehearsal.bench import Work, carry_out
from jointscope.progress import track
from jointscope.recordings.campaign import Campaign, Run
from jointscope.sim.concealed import catalogue as concealed
from jointscope.sim.concealed import paperwork
from jointscope.sim.concealed.bench import Bench, draw_bench
from jointscope.sim.concealed.concealment import AMBIGUOUS
from jointscope.sim.concealed.law import Effect, log_between
from jointscope.sim.concealed.measurement import noisy
from jointscope.sim.concealed.rehearsal import clean_channels, declared

QUICK = Effort(screen_hits=2, hits=4, others=2, singles=8, refine=12, beam=0, children=0, pairs=0, size=1)
DOUBT = (0.02, 0.75)  # probability of the right candidate in which a case counts as ambiguous
KEPT = {"hammer": 6, "torque-sweep": 2, "speed-motion": 2}  # runs of a small campaign
TRIES = 3  # strengths per case


@dataclass(frozen=True)
class Outcome:
    """One ambiguous case.

    Attributes:
        before: Probability of the right candidate.
        expected: Gain that the diagnosis foretold.
        after: With the suggested recording; ``after_random`` with the one drawn from the menu.
    """

    seed: int
    truth: str
    experiments: str
    before: float
    item: str
    expected: float
    after: float
    random_item: str
    after_random: float


def small(bench: Bench) -> Bench:
    """The bench with few runs of every kind, the levels spread alike."""
    chosen: list[int] = []
    for kind, count in KEPT.items():
        members = [i for i, take in enumerate(bench.plan.takes) if take.kind == kind]
        if members:
            chosen += [members[k] for k in np.unique(np.linspace(0, len(members) - 1, count).round().astype(int))]
    takes = tuple(bench.plan.takes[i] for i in sorted(chosen))
    return replace(bench, plan=replace(bench.plan, takes=takes))


def recorded(bench: Bench, effects: Sequence[Effect], seed: int) -> Campaign:
    """The small campaign as a laboratory would hand it over."""
    noise, paper = np.random.default_rng([seed, 3]), np.random.default_rng([seed, 4])
    records = []
    for index in range(len(bench.plan.takes)):
        clean = declared(clean_channels(bench.rig, bench.plan, index, effects), bench.plan.devices)
        records.append(noisy(clean, bench.plan.devices, bench.noise, noise))
    plate = paperwork.nameplate(bench.rig, bench.topology, bench.motion, paper, 0.35 if bench.hard else 0.15)
    return paperwork.campaign(bench.rig, bench.plan, records, plate, paper)


def carried_out(
    bench: Bench, effects: Sequence[Effect], campaign: Campaign, takes: Sequence[Take], seed: int
) -> Campaign:
    """The campaign with a planned item carried out on the same rig."""
    lab = lab_of(prepare(campaign))
    rng = np.random.default_rng([seed, 5])
    devices = replace(bench.plan.devices, motor_encoder=True)
    runs: list[Run] = list(campaign.runs)
    begin = max(take.begin for take in bench.plan.takes)
    for take in takes:
        for _ in range(take.count):
            begin += 30.0
            fast = max(devices.daq_rate, devices.log_rate)
            used = replace(devices, daq_rate=fast, log_rate=fast) if take.one_device else devices
            kind = take.experiment
            assert kind != "free"
            work = Work(
                kind=kind, angle=take.angle, duration=take.duration, braked=take.brake,
                force=take.force if take.struck else None, torque=take.torque, speed=take.speed,
                gain=float(rng.normal(0.0, bench.noise.hit_gain)), late=float(rng.normal(0.0, bench.noise.hit_timing)),
                radius=take.radius, one_device=take.one_device,
            )  # fmt: skip
            clean = carry_out(
                bench.rig, bench.setting, work, effects, used, index=len(runs), runs=len(runs) + 1, begin=begin
            )
            run = as_run(take, lab, noisy(clean, used, bench.noise, rng), name=f"s{len(runs)}")
            runs.append(run)
    return replace(campaign, runs=tuple(runs))


@dataclass(frozen=True, eq=False)
class Answer:
    """What the diagnosis says of a campaign, candidates given."""

    problem: Problem
    judgement: Judgement
    decision: Decision

    def belief(self, label: str) -> float:
        """Probability of the right candidate."""
        return sum(r.probability for r in self.decision.ranking if r.names == (label,))


def answer(campaign: Campaign, labels: frozenset[str], pool: ThreadPoolExecutor) -> Answer:
    """The diagnosis with the candidates ``name@location`` alone."""
    problem = prepare(campaign)
    specs = [s for s in catalogue(problem) if f"{s.name}@{s.location}" in labels]
    split = split_runs(problem)
    stage = refit_base(problem, predict_outputs, split.estimate, pool)
    _, hypotheses = explore(stage, specs, QUICK, silent)
    judgement = judge(stage, hypotheses, split.held_out)
    return Answer(problem, judgement, answered(judgement))


@dataclass(frozen=True, eq=False)
class Doubt:
    """An ambiguous case and what is suggested for it."""

    bench: Bench
    effect: Effect
    campaign: Campaign
    labels: frozenset[str]
    answer: Answer
    suggestion: Suggestion


def noisier(bench: Bench, factor: float) -> Bench:
    """The bench with more noise of every channel."""
    noise = bench.noise
    more = replace(
        noise, acceleration=factor * noise.acceleration, torque=factor * noise.torque, arm=factor * noise.arm
    )
    return replace(bench, noise=more)


def ambiguous(seed: int, pool: ThreadPoolExecutor) -> Doubt | None:
    """A case in doubt, or ``None`` where none came of this seed."""
    rng = np.random.default_rng([seed, 1])
    bench = small(draw_bench(rng, "development", experiments=("H", "HS", "H", "S", "H")[seed % 5]))
    bench = noisier(bench, float(rng.choice([1.0, 3.0, 8.0])))
    pool_of_laws = [law for law in concealed.laws("development") if law.applies(bench.setting)]
    doubtful = [law for law in pool_of_laws if law.effect in AMBIGUOUS] or pool_of_laws
    choice = doubtful if rng.random() < 0.6 else pool_of_laws
    law = choice[int(rng.integers(len(choice)))]
    low, high = law.span(bench.setting)
    shape = law.shape(bench.setting, rng)
    labels = frozenset({f"{law.effect}@{law.location}", *concealed.rivals(f"{law.effect}@{law.location}")})
    below, above, share = 0.0, 1.0, 0.35
    for _ in range(TRIES):
        effect = Effect(law, shape).scaled(log_between(low, high, share))
        try:
            campaign = recorded(bench, (effect,), seed)
        except FloatingPointError:
            return None
        found = answer(campaign, labels, pool)
        p = found.belief(effect.label)
        if DOUBT[0] <= p <= DOUBT[1]:
            listed = {r.names for r in found.decision.ranking[:3]}
            suggestion = suggest(found.problem, found.judgement, found.decision, pool)
            if (effect.label,) in listed and suggestion is not None and suggestion.key is not None:
                return Doubt(bench, effect, campaign, labels, found, suggestion)
            return None
        if p > DOUBT[1]:
            above = share
        else:
            below = share
        share = 0.5 * (below + above)
    return None


def check(seed: int, pool: ThreadPoolExecutor) -> Outcome | None:
    """One seed: an ambiguous case and what the two recordings make of it."""
    case = ambiguous(seed, pool)
    if case is None or len(case.suggestion.menu) < 2:
        return None
    menu = planned(lab_of(case.answer.problem))
    keys = [item.key for item in case.suggestion.menu]
    drawn = keys[int(np.random.default_rng([seed, 2]).integers(len(keys)))]
    label, chosen = case.effect.label, str(case.suggestion.key)
    after: dict[str, float] = {}
    for key in sorted({chosen, drawn}):
        more = carried_out(case.bench, (case.effect,), case.campaign, menu[key], seed)
        after[key] = answer(more, case.labels, pool).belief(label)
    expected = next(item.expected_gain for item in case.suggestion.menu if item.key == chosen)
    before = case.answer.belief(label)
    return Outcome(
        seed, label, case.bench.experiments, before, chosen, expected, after[chosen], drawn, after[drawn]
    )


def interval(values: Sequence[float]) -> tuple[float, float, float]:
    """Mean and its 95 % interval by bootstrap."""
    x = np.asarray(values)
    if x.size == 0:
        return math.nan, math.nan, math.nan
    rng = np.random.default_rng(1)
    means = x[rng.integers(x.size, size=(4000, x.size))].mean(axis=1)
    return float(x.mean()), float(np.quantile(means, 0.025)), float(np.quantile(means, 0.975))


def summarise(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """Mean rise of P(right) by the suggestion, and over the item drawn from the menu, with 95 % intervals."""
    rise = interval([o.after - o.before for o in outcomes])
    over = interval([o.after - o.after_random for o in outcomes])
    return {
        "cases": len(outcomes),
        "rise": {"mean": rise[0], "interval95": rise[1:], "least": 0.25},
        "over_random": {"mean": over[0], "interval95": over[1:], "least": 0.10},
        "outcomes": [asdict(o) for o in outcomes],
    }


def run(out: Path, cases: int, first_seed: int, most_seeds: int) -> dict[str, Any]:
    """Check until ``cases`` are in doubt or ``most_seeds`` were tried; finished seeds are kept in ``out``."""
    out.mkdir(parents=True, exist_ok=True)
    outcomes: list[Outcome] = []
    with ThreadPoolExecutor(1) as pool:
        for seed in track(range(first_seed, first_seed + most_seeds), "checking suggestions", most_seeds):
            file = out / f"seed-{seed}.json"
            if not file.is_file():
                found = check(seed, pool)
                write_text(file, json.dumps(None if found is None else asdict(found)) + "\n")
            held = json.loads(file.read_text(encoding="utf-8"))
            if held is not None:
                outcomes.append(Outcome(**held))
            if len(outcomes) >= cases:
                break
    summary = summarise(outcomes)
    write_text(out / "next_experiment.json", json.dumps(summary, indent=1) + "\n")
    return summary


def main() -> int:
    """Print the two figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--cases", type=int, default=40)
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--seeds", type=int, default=200, help="seeds tried at most (default: 200)")
    options = parser.parse_args()
    summary = run(options.out, options.cases, options.first_seed, options.seeds)
    for name, text in (("rise", "P(right) rises by"), ("over_random", "over an item drawn from the menu")):
        part = summary[name]
        low, high = part["interval95"]
        print(f"{text} {part['mean']:.3f} (95 %: {low:.3f} to {high:.3f}; at least {part['least']})")
    print(f"{summary['cases']} ambiguous cases; {options.out / 'next_experiment.json'}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
