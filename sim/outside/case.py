"""One case: rig, session, devices, effects of a wanted visibility, and what is recorded of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jointscope.sim.outside.devices import Devices, draw_devices
from jointscope.sim.outside.effect import Build, Chain, Law, Scene
from jointscope.sim.outside.effects import MAKERS
from jointscope.sim.outside.intent import BANDS, Intent
from jointscope.sim.outside.layout import ARM_ANGLE
from jointscope.sim.outside.noise import Noise, draw_noise, noisy, typical_acceleration
from jointscope.sim.outside.running import go_all
from jointscope.sim.outside.sensing import Record, sensed
from jointscope.sim.outside.setup import Setup, draw_setup
from jointscope.sim.outside.sizing import SHIFT, Sized, Visibility, Yardstick, sized, visibility
from jointscope.sim.outside.takes import Session, draw_session

Real = NDArray[np.float64]
LOGGED: Final = {"torque-logging", "delay", "clock-drift"}  # seen in the torque log of sweeps too


@dataclass(frozen=True)
class Concealed:
    """An effect of a case."""

    label: str
    law: Law
    sized: Sized


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """A finished case.

    Attributes:
        clean: Channels without noise, per run.
        records: With it.
        visibility: Of all effects together; ``None`` without any.
        chain: Faults of the recording.
    """

    intent: Intent
    setup: Setup
    devices: Devices
    session: Session
    noise: Noise
    effects: tuple[Concealed, ...]
    visibility: Visibility | None
    chain: Chain
    clean: tuple[Record, ...]
    records: tuple[Record, ...]


def _chain(builds: Sequence[Build]) -> Chain:
    changes = {name: value for build in builds for name, value in build.chain.items()}
    return replace(Chain(), **changes)  # type: ignore[arg-type]


@dataclass(frozen=True, eq=False)
class _Bench:
    setup: Setup
    devices: Devices
    session: Session

    def runs(self, builds: Sequence[Build] = (), constant: str = "") -> list[Real]:
        scaled = {constant: 1.0 + SHIFT} if constant else None
        return go_all(self.setup.rig.physics, self.session.takes, builds, scaled)

    def records(self, runs: Sequence[Real], builds: Sequence[Build] = ()) -> list[Record]:
        chain = _chain(builds)
        pairs = zip(runs, self.session.takes, strict=True)
        return [sensed(run, take, self.setup.rig, self.devices, chain) for run, take in pairs]

    def seen(self, builds: Sequence[Build] = (), constant: str = "") -> list[Record]:
        return self.records(self.runs(builds, constant), builds)


def draw_case(intent: Intent, seed: np.random.SeedSequence) -> Case:
    """The case that ``seed`` makes of ``intent``.

    Raises:
        FloatingPointError: It flies apart.
    """
    streams = [np.random.default_rng(one) for one in seed.spawn(6)]
    setup = draw_setup(intent, streams[0])
    devices = draw_devices(intent, setup, streams[1])
    session = draw_session(intent, setup, devices.daq_rate, devices.uncertain, streams[2])
    bench = _Bench(setup, devices, session)
    runs = bench.runs()
    plain = bench.records(runs)
    noise = draw_noise(session.takes, plain, setup.rig, hard=intent.hard, rng=streams[3])
    effects: tuple[Concealed, ...] = ()
    found, clean = None, plain
    if intent.labels:
        yard = _yardstick(intent, bench, noise, plain)
        effects = _conceal(intent, bench, yard, _scene(bench, runs, plain), streams[4])
        builds = [effect.sized.build for effect in effects]
        clean = bench.seen(builds)
        found = visibility(yard, clean)
    chain = _chain([effect.sized.build for effect in effects])
    if not all(np.all(np.isfinite(signal)) for record in clean for signal in record.values()):
        raise FloatingPointError(f"{', '.join(intent.labels) or 'the plain joint'} flew apart")
    records = tuple(noisy(record, noise, devices, chain.level, streams[5]) for record in clean)
    return Case(
        intent=intent, setup=setup, devices=devices, session=session, noise=noise, effects=effects,
        visibility=found, chain=chain, clean=tuple(clean), records=records,
    )  # fmt: skip


def _constants(setup: Setup) -> list[str]:
    """Constants of the plain joint that any fit has free."""
    if setup.rigid:
        return ["load_inertia", "load_damping"]
    found = ["load_inertia", "stiffness", "damping", "load_damping"]
    return found if setup.rig.slide or setup.experiments == "H" else [*found, "motor_damping"]


def _yardstick(intent: Intent, bench: _Bench, noise: Noise, plain: Sequence[Record]) -> Yardstick:
    shifted = [bench.seen(constant=constant) for constant in _constants(bench.setup)]
    return Yardstick(
        takes=bench.session.takes, rig=bench.setup.rig, devices=bench.devices, noise=noise, plain=plain,
        shifted=shifted, sweeps_count=bool(intent.names & LOGGED),
    )  # fmt: skip


def _scene(bench: _Bench, runs: Sequence[Real], plain: Sequence[Record]) -> Scene:
    session = bench.session
    travelled = [run[:, ARM_ANGLE] for run, take in zip(runs, session.takes, strict=True) if take.travels]
    angles = np.concatenate(travelled) if travelled else np.zeros(1)
    return Scene(
        rig=bench.setup.rig, experiments=bench.setup.experiments, swing=session.swing, speed=session.speed,
        poses=session.poses, lowest=float(angles.min()), highest=float(angles.max()),
        acceleration=typical_acceleration(session.takes, plain),
        peak=max(float(np.abs(record["acceleration"]).max()) for record in plain), runs=len(session.takes),
    )  # fmt: skip


def _conceal(
    intent: Intent, bench: _Bench, yard: Yardstick, scene: Scene, rng: np.random.Generator
) -> tuple[Concealed, ...]:
    """Each effect sized as if it were alone."""

    def look(build: Build) -> Visibility:
        records = bench.seen([build])
        if not all(np.all(np.isfinite(signal)) for record in records for signal in record.values()):
            return Visibility(z=float("nan"), share=float("nan"))
        return visibility(yard, records)

    found = []
    for label in intent.labels:
        law = MAKERS[label](scene, rng)
        found.append(Concealed(label, law, sized(law, BANDS[intent.band], look, rng)))
    return tuple(found)
