"""Friction and drag: Coulomb and Stribeck at motor and load, friction that follows the load, quadratic damping, grease."""

from __future__ import annotations

from typing import Final

import numpy as np

from jointscope.sim.outside.effect import Build, Law, Maker, Scene
from jointscope.sim.outside.physics import Change
from jointscope.sim.outside.rig import log_uniform

BRISTLES_SHARE: Final = 0.6  # of the motors' frictions
ASYMMETRIES: Final = (0.0, 0.0, 0.06, 0.12)


def coulomb_at_motor(scene: Scene, rng: np.random.Generator) -> Law:
    """T sign(w) of the motor."""
    return _at_motor(scene, rng, falls=False)


def stribeck_at_motor(scene: Scene, rng: np.random.Generator) -> Law:
    """T + (T_s - T) exp(-(w/w_s)^2) of the motor."""
    return _at_motor(scene, rng, falls=True)


def coulomb_at_load(scene: Scene, rng: np.random.Generator) -> Law:
    """T sign(w) of the arm."""
    return _at_load(scene, rng, falls=False)


def stribeck_at_load(scene: Scene, rng: np.random.Generator) -> Law:
    """T + (T_s - T) exp(-(w/w_s)^2) of the arm."""
    return _at_load(scene, rng, falls=True)


def _asymmetry(rng: np.random.Generator, falls: bool) -> float:
    found = float(rng.choice(ASYMMETRIES) * rng.choice((-1.0, 1.0)))
    return 0.0 if falls else found


def _smoothing(scene: Scene) -> float:
    """Speed within which friction rises to its level [rad/s]."""
    own = 0.004 * scene.swing * scene.rig.own_rate if scene.hit else 8e-4 * scene.speed
    return max(own, 2e-4 * scene.speed)


def _parameters(torque: float, ratio: float, falls: bool, falls_at: float, asymmetry: float) -> dict[str, float]:
    if falls:
        return {"torque": torque, "breakaway": torque * ratio, "stribeck_velocity": falls_at}
    return {"torque": torque, "asymmetry": asymmetry}


def _at_motor(scene: Scene, rng: np.random.Generator, *, falls: bool) -> Law:
    asymmetry, ratio = _asymmetry(rng, falls), float(rng.uniform(1.3, 1.9))
    falls_at = log_uniform(rng, 0.015, 0.06) * 1.2 * scene.speed
    bristles, presliding = bool(rng.random() < BRISTLES_SHARE), log_uniform(rng, 8e-5, 3e-4)  # rad
    smoothing = max(_smoothing(scene), 5e-4 * scene.speed)

    def build(size: float) -> Build:
        torque = 0.08 * scene.rig.rated_torque * size
        physics: dict[str, Change] = {
            "motor_friction": torque, "motor_asymmetry": asymmetry, "motor_smoothing": smoothing,
            "motor_bristles": float(bristles), "bristle_stiffness": torque / presliding,
            "bristle_damping": 0.15 * float(np.sqrt(torque / presliding * scene.rig.motor_inertia)),
        }  # fmt: skip
        if falls:
            physics |= {"motor_breakaway": torque * ratio, "motor_stribeck_speed": falls_at}
        return Build(physics=physics, parameters=_parameters(torque, ratio, falls, falls_at, asymmetry))

    return Law("LuGre" if bristles else "tanh", "torque", build, departs=bristles)


def _at_load(scene: Scene, rng: np.random.Generator, *, falls: bool) -> Law:
    rig = scene.rig
    asymmetry, ratio = _asymmetry(rng, falls), float(rng.uniform(1.3, 1.9))
    falls_at = log_uniform(rng, 0.015, 0.06) * 1.2 * scene.speed
    if scene.hit and not scene.moved:
        falls_at = 0.15 * scene.swing * rig.own_rate
    unit = 0.032 * rig.stiffness * scene.swing if scene.hit and rig.stiffness > 0.0 else 0.05 * rig.rated_torque
    smoothing = _smoothing(scene)

    def build(size: float) -> Build:
        torque = unit * size
        physics: dict[str, Change] = {
            "load_friction": torque, "load_asymmetry": asymmetry, "load_smoothing": smoothing
        }  # fmt: skip
        if falls:
            physics |= {"load_breakaway": torque * ratio, "load_stribeck_speed": falls_at}
        return Build(physics=physics, parameters=_parameters(torque, ratio, falls, falls_at, asymmetry))

    return Law("tanh", "torque", build)


def load_dependent(scene: Scene, rng: np.random.Generator) -> Law:
    """mu |T_S| against the motor's motion."""

    def build(size: float) -> Build:
        share = min(0.3, 0.08 * size)
        physics = {"loaded_friction": share, "loaded_smoothing": 2e-3 * scene.speed}
        return Build(physics=physics, parameters={"coefficient": share})

    return Law("mu |T_S| tanh(w_m/w_e)", "coefficient", build, most=3.7)


def quadratic(scene: Scene, rng: np.random.Generator) -> Law:
    """C w |w| of the arm."""
    rig = scene.rig
    if scene.moved:
        unit = 0.06 * rig.rated_torque / scene.speed**2
    else:
        unit = 0.3 * rig.damping / (scene.swing * rig.own_rate)
    return Law(
        "w |w|", "coefficient",
        lambda size: Build(physics={"drag": unit * size}, parameters={"coefficient": unit * size}),
    )  # fmt: skip


def cable(scene: Scene, rng: np.random.Generator) -> Law:
    """A cable whose drag is larger on one side of the travel (in no catalogue)."""

    def build(size: float) -> Build:
        torque = 0.06 * scene.rig.rated_torque * size
        physics = {"cable_torque": torque, "cable_width": 0.06, "cable_bend": 0.9}
        return Build(physics=physics, parameters={"torque": torque})

    return Law("Dahl, wide on one side", "torque", build, most=10.0, departs=True)


def grease(scene: Scene, rng: np.random.Generator) -> Law:
    """Viscosity that shears down and recovers at rest (in no catalogue)."""

    def build(size: float) -> Build:
        viscous = 0.12 * scene.rig.rated_torque / scene.speed * size
        physics = {"grease": viscous, "grease_recovery": 1.5, "grease_shear": 0.15}
        return Build(physics=physics, parameters={"viscous": viscous})

    return Law("thixotropic", "viscous", build, most=10.0, departs=True)


MAKERS: Final[dict[str, Maker]] = {
    "coulomb-friction@motor": coulomb_at_motor, "coulomb-friction@load": coulomb_at_load,
    "stribeck-friction@motor": stribeck_at_motor, "stribeck-friction@load": stribeck_at_load,
    "load-dependent-friction@transmission": load_dependent, "quadratic-damping@load": quadratic,
    "one-sided-cable-drag@load": cable, "thixotropic-grease@load": grease,
}  # fmt: skip
