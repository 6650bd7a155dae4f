"""Of the arm and what is around it: gravity, payload, bending, mount, neighbour, end stop, vibration from outside."""

from __future__ import annotations

from typing import Final

import numpy as np

from jointscope.sim.outside.effect import Build, Law, Maker, Scene
from jointscope.sim.outside.physics import CARRIER, OUTER_BODY, Change
from jointscope.sim.outside.rig import log_uniform

MACHINES: Final = (16.6, 24.5, 29.0, 50.0, 33.3)  # Hz, of what vibrates nearby


def gravity(scene: Scene, rng: np.random.Generator) -> Law:
    """A torque about the horizontal that the nameplate denies, or has wrong."""
    rig = scene.rig
    unit = 0.2 * rig.gravity * float(rng.choice((-1.0, 1.0))) if rig.vertical else 0.25 * rig.rated_torque

    def build(size: float) -> Build:
        moment = unit * size
        if rig.vertical:
            moment = float(np.clip(moment, -0.7 * rig.gravity, 2.0 * rig.gravity))
        return Build(physics={"gravity": rig.gravity + moment}, parameters={"moment": moment})

    return Law("M cos q", "moment", build)


def payload(scene: Scene, rng: np.random.Generator) -> Law:
    """More inertia in half of the runs, without a word in the file."""
    loaded = {int(i) for i in rng.permutation(scene.runs)[: scene.runs // 2]}
    inertia = scene.rig.load_inertia

    def build(size: float) -> Build:
        def carried(place: int) -> dict[str, float]:
            return {"load_inertia": inertia * (1.0 + 0.06 * size)} if place in loaded else {}

        return Build(per_run=carried, parameters={"inertia": 0.06 * size * inertia})

    return Law("inertia in half of the runs", "inertia", build)


def bending(scene: Scene, rng: np.random.Generator) -> Law:
    """An outer body on a spring; ``frequency`` is its own with the inner one held; hits and sensor on the inner one."""
    rig = scene.rig
    frequency = log_uniform(rng, max(2.2 * rig.own_frequency, 45.0), min(7.0 * rig.own_frequency, 240.0))
    share = log_uniform(rng, 0.005, 0.03)

    def build(size: float) -> Build:
        outer = min(0.45, 0.12 * size) * rig.load_inertia
        stiffness = outer * (2.0 * np.pi * frequency) ** 2
        physics: dict[str, Change] = {
            "further": OUTER_BODY, "load_inertia": rig.load_inertia - outer, "further_inertia": outer,
            "further_stiffness": stiffness, "further_damping": 2.0 * share * float(np.sqrt(stiffness * outer)),
        }  # fmt: skip
        return Build(physics=physics, parameters={"frequency": frequency, "inertia": outer})

    return Law("outer body on a spring", "frequency", build, most=4.0)


def mount(scene: Scene, rng: np.random.Generator) -> Law:
    """The mount slides perpendicularly to the arm as it is at its first pose."""
    return _carrier(scene, rng, turns=False)


def neighbour(scene: Scene, rng: np.random.Generator) -> Law:
    """Another joint that turns along."""
    return _carrier(scene, rng, turns=True)


def _carrier(scene: Scene, rng: np.random.Generator, *, turns: bool) -> Law:
    """``frequency`` of the mode alone; ``modal_share`` = coupling^2/(M J_L)."""
    rig = scene.rig
    low, high = (1.4, 3.0) if rng.random() < 0.6 else (0.4, 0.75)
    frequency = rig.own_frequency * log_uniform(rng, low, high)
    damping, lever = log_uniform(rng, 0.008, 0.04), rig.length * float(rng.uniform(0.3, 0.7))

    def build(size: float) -> Build:
        share = min(0.5, 0.08 * size)
        if turns:
            inertia = (0.5 + 1.5 * share) * rig.load_inertia
            coupling = float(np.sqrt(share * inertia * rig.load_inertia))
            reach = lever * coupling / rig.load_inertia
        else:
            coupling, reach = rig.arm_mass * rig.centre, 1.0
            inertia = coupling**2 / (share * rig.load_inertia)
        stiffness = inertia * (2.0 * np.pi * frequency) ** 2
        physics = {
            "further": CARRIER, "further_inertia": inertia, "further_stiffness": stiffness,
            "further_damping": 2.0 * damping * float(np.sqrt(stiffness * inertia)), "coupling": coupling,
            "lever": reach, "coupling_angle": 0.0 if rig.vertical else scene.poses[0],
        }  # fmt: skip
        return Build(physics=physics, parameters={"frequency": frequency, "modal_share": share})

    law = "turns, inertially coupled" if turns else "slides across the arm"
    return Law(law, "frequency", build, least=0.01, most=6.0)


def end_stop(scene: Scene, rng: np.random.Generator) -> Law:
    """Linear contact with damping that never pulls, at one end of the travel."""
    above, stiffness = bool(rng.random() < 0.5), log_uniform(rng, 0.3, 2.0) * scene.rig.stiffness

    def build(size: float) -> Build:
        depth = 0.03 * (scene.highest - scene.lowest) * size
        angle = scene.highest - depth if above else scene.lowest + depth
        physics = {
            "stop_angle": angle, "stop_stiffness": stiffness, "stop_damping": 0.004 * stiffness,
            "stop_side": 1.0 if above else -1.0,
        }  # fmt: skip
        return Build(physics=physics, parameters={"angle": angle, "stiffness": stiffness})

    return Law("linear contact", "angle", build, least=0.02)


def vibration(scene: Scene, rng: np.random.Generator) -> Law:
    """A tone from outside: a torque on the arm [N m], or the floor's acceleration [m/s^2]; its phase differs by run."""
    rig = scene.rig
    frequency, floor = float(rng.choice(MACHINES)), bool(rng.random() < 0.5)
    phases = rng.uniform(0.0, 2.0 * np.pi, scene.runs)
    unit = 0.05 * scene.acceleration * (1.0 if floor else rig.load_inertia / rig.sensor_radius)

    def build(size: float) -> Build:
        physics = {
            "shaking": unit * size, "shaking_frequency": frequency,
            "shaken_moment": rig.arm_mass * rig.centre if floor else 0.0,
        }  # fmt: skip
        return Build(
            physics=physics, per_run=lambda place: {"shaking_phase": float(phases[place])},
            parameters={"frequency": frequency, "amplitude": unit * size},
        )  # fmt: skip

    return Law("floor" if floor else "torque", "frequency", build, most=20.0)


MAKERS: Final[dict[str, Maker]] = {
    "gravity@load": gravity, "payload@load": payload, "link-flexibility@load": bending,
    "base-compliance@base": mount, "neighbour-flexibility@neighbour": neighbour, "end-stop@load": end_stop,
    "external-vibration@base": vibration,
}  # fmt: skip
