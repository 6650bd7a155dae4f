"""Of the drive: ripple, lag, gain; a torque constant that warms and a brake that slips."""

from __future__ import annotations

from typing import Final

import numpy as np

from jointscope.sim.outside.effect import Build, Law, Maker, Scene

LARGE_RATIO: Final = 90.0  # beyond it orders above 3 would be faster than the joint


def torque_ripple(scene: Scene, rng: np.random.Generator) -> Law:
    """A sin(order n q_s + phase) with one harmonic, on the motor side."""
    orders = (1.0, 2.0, 4.0, 6.0, 10.0) if scene.rig.ratio < LARGE_RATIO else (1.0, 2.0, 3.0)
    order, phase, second = float(rng.choice(orders)), float(rng.uniform(-3.0, 3.0)), float(rng.uniform(0.0, 0.4))

    def build(size: float) -> Build:
        amplitude = 0.02 * scene.rig.rated_torque * size
        physics = {
            "ripple": amplitude, "ripple_order": order, "ripple_phase": phase, "ripple_second": second
        }  # fmt: skip
        return Build(physics=physics, parameters={"amplitude": amplitude, "order": order, "phase": phase})

    return Law("constant, one harmonic", "amplitude", build, most=10.0, departs=True)


def lag(scene: Scene, rng: np.random.Generator) -> Law:
    """First order between the logged torque and the acting one."""
    return Law(
        "first order", "time_constant",
        lambda size: Build(physics={"lag": 8e-4 * size}, parameters={"time_constant": 8e-4 * size}), most=6.0,
    )  # fmt: skip


def gain(scene: Scene, rng: np.random.Generator) -> Law:
    """Acting torque over logged torque."""
    sign = float(rng.choice((-1.0, 1.0)))

    def build(size: float) -> Build:
        value = 1.0 + sign * min(0.35, 0.08 * size)
        return Build(physics={"gain": value}, parameters={"gain": value})

    return Law("constant", "gain", build, most=4.0)


def warming(scene: Scene, rng: np.random.Generator) -> Law:
    """A torque constant that falls within each run (in no catalogue)."""

    def build(size: float) -> Build:
        share = min(0.5, 0.1 * size)
        return Build(physics={"warming": share, "warming_time": 1.2}, parameters={"relative": share})

    return Law("exponential", "relative", build, most=10.0, departs=True)


def slipping_brake(scene: Scene, rng: np.random.Generator) -> Law:
    """A brake that creeps beyond a torque (in no catalogue)."""
    rig = scene.rig
    damping = 0.05 * float(np.sqrt(rig.stiffness * rig.motor_inertia))

    def build(size: float) -> Build:
        limit = rig.stiffness * scene.swing / (1.0 + 0.5 * size) + rig.gravity
        return Build(physics={"brake_torque": limit, "brake_damping": damping}, parameters={"slip_torque": limit})

    return Law("viscous slip", "slip_torque", build, most=10.0, departs=True)


MAKERS: Final[dict[str, Maker]] = {
    "torque-ripple@motor": torque_ripple, "drive-lag@motor": lag, "torque-gain@motor": gain,
    "torque-constant-warms@motor": warming, "brake-slip@motor": slipping_brake,
}  # fmt: skip
