"""Of the transmission: play, stiffness that bends, drifts or turns, hysteresis, structural damping, kinematic error."""

from __future__ import annotations

from typing import Final

import numpy as np

from jointscope.sim.outside.effect import Build, Law, Maker, Scene
from jointscope.sim.outside.physics import LOSSES, SLIPS, Change
from jointscope.sim.outside.rig import log_uniform

DRIFTS_BY_RUN: Final = 0.35  # share of the drifts that go from run to run, not within each
LOSS_CORNERS: Final = np.geomspace(0.6, 600.0, LOSSES)  # Hz


def backlash(scene: Scene, rng: np.random.Generator) -> Law:
    """A dead zone of width ``gap``."""
    unit = 0.1 * scene.swing
    build = lambda size: Build(physics={"gap": unit * size}, parameters={"gap": unit * size})  # noqa: E731
    return Law("hard dead zone", "gap", build, most=12.0)


def bent_stiffness(scene: Scene, rng: np.random.Generator) -> Law:
    """K d +- K_3 d^3, or K d - T_1 tanh(d/d_1), soft at low torque."""
    stiffness = scene.rig.stiffness
    form, width = int(rng.integers(3)), float(rng.uniform(0.15, 0.3)) * scene.swing
    if form == 2:

        def soft(size: float) -> Build:
            share = 0.12 * size
            physics = {"soft_torque": share * stiffness * width, "soft_width": width}
            return Build(physics=physics, parameters={"soft_fraction": share, "soft_width": width})

        return Law("soft at low torque", "cubic", soft, most=5.0, departs=True)
    sign = 1.0 if form == 0 else -1.0
    unit = 0.08 * sign * stiffness / scene.swing**2
    build = lambda size: Build(physics={"cubic": unit * size}, parameters={"cubic": unit * size})  # noqa: E731
    return Law("cubic", "cubic", build, most=8.0 if sign > 0.0 else 4.0)


def hysteresis(scene: Scene, rng: np.random.Generator) -> Law:
    """One, three or four Dahl elements beside K, together of torque T at full slip."""
    count = int(rng.choice((1, 3, SLIPS)))
    spread = np.geomspace(0.4, 2.5, count) if count > 1 else np.ones(1)
    widths = log_uniform(rng, 0.08, 0.35) * scene.swing * spread
    shares = rng.dirichlet(np.full(count, 4.0))

    def build(size: float) -> Build:
        torque = 0.03 * scene.rig.stiffness * scene.swing * size
        stiffness, unused = torque * shares / widths, SLIPS - count
        physics: dict[str, Change] = {
            "slip_count": float(count), "slip_stiffness": (*map(float, stiffness), *[0.0] * unused),
            "slip_width": (*map(float, widths), *[1.0] * unused),
        }  # fmt: skip
        return Build(physics=physics, parameters={"torque": torque, "stiffness": float(stiffness.sum())})

    return Law(f"Dahl, {count} elements", "torque", build, most=6.0, departs=count > 1)


def structural(scene: Scene, rng: np.random.Generator) -> Law:
    """Loss factor eta, nearly constant from 1 to 300 Hz: six Maxwell elements, c = 0, K(w_0) kept."""
    rig = scene.rig
    times = 1.0 / (2.0 * np.pi * LOSS_CORNERS)
    turned = 1j * rig.own_rate * times
    unit = complex(np.sum(turned / (1.0 + turned)))
    share = rig.damping / (2.0 * float(np.sqrt(rig.stiffness * rig.load_inertia)))

    def build(size: float) -> Build:
        factor = 2.0 * share * max(size, 1e-3)
        each = factor * rig.stiffness / unit.imag
        physics: dict[str, Change] = {
            "damping": 0.0, "stiffness": rig.stiffness - each * unit.real, "loss_count": float(LOSSES),
            "loss_stiffness": (each,) * LOSSES, "loss_time": tuple(map(float, times)),
        }  # fmt: skip
        return Build(physics=physics, parameters={"loss_factor": factor})

    return Law("Maxwell, 6 elements", "loss_factor", build, least=0.3, most=4.0)


def kinematic_error(scene: Scene, rng: np.random.Generator) -> Law:
    """e of the motor's or the output's angle, with two small harmonics; T_S = K (q_s - q + e)."""
    rig, phase = scene.rig, float(rng.uniform(-3.0, 3.0))
    output = bool(rng.random() < 0.35)
    order = float(rng.choice((20.0, 39.0, 40.0, 78.0)) if output else rng.choice((1.0, 2.0, 2.0, 2.0)))
    if not output and order * rig.ratio * scene.speed / (2.0 * np.pi) > 4.0 * rig.own_frequency:
        output, order = True, float(max(6, round(0.875 * rig.own_rate / scene.speed)))
    second, third = float(rng.uniform(0.0, 0.3)), float(rng.uniform(0.0, 0.2))

    def build(size: float) -> Build:
        physics = {
            "error": 8e-5 * size, "error_order": order, "error_phase": phase, "error_of_output": float(output),
            "error_second": second, "error_third": third,
        }  # fmt: skip
        return Build(physics=physics, parameters={"amplitude": 8e-5 * size, "order": order, "phase": phase})

    turn = "output" if output else "motor"
    return Law(f"harmonics per {turn} turn", "amplitude", build, most=10.0, departs=True)


def drift(scene: Scene, rng: np.random.Generator) -> Law:
    """K (1 + rate t) within each run, or from run to run."""
    sign = float(rng.choice((-1.0, 1.0)))
    if rng.random() < DRIFTS_BY_RUN:

        def by_run(size: float) -> Build:
            rate = 0.002 * sign * size

            def stiffness(place: int) -> dict[str, float]:
                return {"stiffness": scene.rig.stiffness * (1.0 + rate * (place - scene.runs / 2.0))}

            return Build(per_run=stiffness, parameters={"rate": rate})

        return Law("per run", "rate", by_run, most=6.0, departs=True)
    unit = 0.015 * sign
    build = lambda size: Build(physics={"stiffness_rate": unit * size}, parameters={"rate": unit * size})  # noqa: E731
    return Law("per second of a run", "rate", build, most=6.0)


def turning(scene: Scene, rng: np.random.Generator) -> Law:
    """K that turns with the motor, twice a turn (in no catalogue)."""
    phase = float(rng.uniform(-3.0, 3.0))

    def build(size: float) -> Build:
        share = min(0.5, 0.08 * size)
        physics = {"turning_stiffness": share, "turning_order": 2.0, "turning_phase": phase}
        return Build(physics=physics, parameters={"relative": share})

    return Law("twice per motor turn", "relative", build, most=10.0, departs=True)


MAKERS: Final[dict[str, Maker]] = {
    "backlash@transmission": backlash, "stiffness-nonlinearity@transmission": bent_stiffness,
    "hysteresis@transmission": hysteresis, "structural-damping@transmission": structural,
    "transmission-error@transmission": kinematic_error, "stiffness-drift@transmission": drift,
    "stiffness-per-motor-turn@transmission": turning,
}  # fmt: skip
