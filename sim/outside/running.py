"""A session's runs as the joint goes through them: at rest first, then driven or hit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from jointscope.sim.outside.effect import Build
from jointscope.sim.outside.equations import elastic, integrate, kinematic_error, ripple, stiffness_at
from jointscope.sim.outside.excitation import half_steps
from jointscope.sim.outside.layout import ACTING, FURTHER, Q_S, STATES, STEP, STORE, STRUCTURE, Q
from jointscope.sim.outside.physics import LOAD_SPEED, OUTER_BODY, TORQUE, Change, Control, Physics, packed
from jointscope.sim.outside.takes import Take

Real = NDArray[np.float64]
SETTLING: Final = 1.0  # s before a run, where something shakes the rig from outside
ROUNDS: Final = 60  # of the search for the wind-up at rest
DAMPED: Final = 0.7  # share of a Newton step that is taken in it


def wind_up_at_rest(physics: Physics, angle: float) -> float:
    """q_s - q + e at which the elastic torque is m g r cos q [rad]; 0, amid the play, where there is no gravity."""
    torque = physics.gravity * float(np.cos(angle))
    if physics.stiffness == 0.0:
        return 0.0
    found = torque / physics.stiffness
    if physics.gap > 0.0:
        if torque == 0.0:
            return 0.0
        found += float(np.sign(torque)) * physics.gap / 2.0
    record = packed(replace(physics, stiffness_rate=0.0))
    for _ in range(ROUNDS):
        stiffness = stiffness_at(record, angle + found, 0.0)
        found -= DAMPED * (elastic(record, found, stiffness)[0] - torque) / stiffness
    return found


def at_rest(physics: Physics, control: Control, angle: float) -> tuple[Real, Control]:
    """The state in which the joint rests at ``angle`` [rad], and the drive that keeps it there."""
    record = packed(physics)
    motor = angle + (wind_up_at_rest(physics, angle) if control.mode != LOAD_SPEED else 0.0)
    if physics.error != 0.0:
        wound = motor
        for _ in range(ROUNDS // 2):
            motor = wound - kinematic_error(record, motor, 0.0, angle, 0.0)[0]
    preload = (physics.gravity * float(np.cos(angle)) - ripple(record, motor)) / physics.gain
    state = np.zeros(STATES)
    state[Q_S], state[Q], state[ACTING], state[STRUCTURE] = motor, angle, preload, 1.0
    state[FURTHER] = angle if physics.further == OUTER_BODY else 0.0
    return state, replace(control, preload=preload, reference=motor if control.mode == TORQUE else angle)


def go(physics: Physics, take: Take) -> Real:
    """One run, shape (n, STORED) at ``layout.RATE``."""
    state, control = at_rest(physics, take.control, take.angle)
    steps, _ = half_steps(take.duration)
    settling = round(SETTLING / STEP) if physics.shaking != 0.0 else 0
    found: Real = integrate(packed(physics), packed(control), state, take.programme, steps, settling, STEP, STORE)
    return found


def go_all(
    physics: Physics,
    takes: Sequence[Take],
    builds: Sequence[Build] = (),
    scaled: Mapping[str, float] | None = None,
) -> list[Real]:
    """Every run, with the effects of ``builds`` and some constants of the plain joint multiplied by ``scaled``."""
    changes: dict[str, Change] = {}
    for build in builds:
        changes.update(build.physics)
    for name, factor in (scaled or {}).items():
        changes[name] = getattr(physics, name) * factor
    with_effects = replace(physics, **changes)  # type: ignore[arg-type]
    found = []
    for place, take in enumerate(takes):
        own: dict[str, float] = {}
        for build in builds:
            if build.per_run is not None:
                own.update(build.per_run(place))
        found.append(go(replace(with_effects, **own) if own else with_effects, take))  # type: ignore[arg-type]
    return found
