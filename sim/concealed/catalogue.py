"""All laws, by draw; which effects are taken for each other."""

from __future__ import annotations

from jointscope.sim.concealed import (
    acquisition,
    arm_side,
    departures_of_the_test,
    drive_side,
    friction,
    further_modes,
    transmission,
    unlisted_development,
    unlisted_of_the_test,
)
from jointscope.sim.concealed.law import Draw, Law

LISTED: tuple[Law, ...] = (
    *friction.LAWS, *transmission.LAWS, *drive_side.LAWS, *arm_side.LAWS, *further_modes.LAWS, *acquisition.LAWS,
    *departures_of_the_test.LAWS,
)  # fmt: skip
UNLISTED: tuple[Law, ...] = (*unlisted_development.LAWS, *unlisted_of_the_test.LAWS)

LOOK_ALIKES: tuple[frozenset[str], ...] = tuple(
    frozenset(group.split())
    for group in (
        "backlash@transmission coulomb-friction@load hysteresis@transmission stiffness-nonlinearity@transmission",
        "backlash@transmission stiffness-nonlinearity@transmission stiffness-drift@transmission end-stop@load",
        "coulomb-friction@motor coulomb-friction@load stribeck-friction@motor load-dependent-friction@transmission",
        "coulomb-friction@load stribeck-friction@load quadratic-damping@load hysteresis@transmission",
        "coulomb-friction@load structural-damping@transmission quadratic-damping@load",
        "load-dependent-friction@transmission torque-gain@motor coulomb-friction@motor sensor-gain@acquisition",
        "delay@acquisition drive-lag@motor torque-logging@acquisition clock-drift@acquisition",
        "sensor-resonance@acquisition delay@acquisition link-flexibility@load sensor-gain@acquisition",
        "payload@load torque-gain@motor sensor-gain@acquisition stiffness-drift@transmission",
        "gravity@load sensor-tilt@acquisition coulomb-friction@motor torque-gain@motor",
        "link-flexibility@load base-compliance@base neighbour-flexibility@neighbour sensor-resonance@acquisition",
        "transmission-error@transmission torque-ripple@motor external-vibration@base",
        "external-vibration@base base-compliance@base sensor-tilt@acquisition gravity@load sensor-gain@acquisition",
        "payload@load link-flexibility@load sensor-resonance@acquisition",
        "sensor-saturation@acquisition stiffness-nonlinearity@transmission quadratic-damping@load",
    )
)  # science: which model recovers most of another's gain once both are refitted


MISTAKEN_FOR: dict[str, str] = {
    "brake-slip": "coulomb-friction@load backlash@transmission hysteresis@transmission stiffness-nonlinearity@transmission",
    "cable-drag": "coulomb-friction@load stribeck-friction@load hysteresis@transmission gravity@load",
    "electrical-pickup": "torque-logging@acquisition drive-lag@motor delay@acquisition torque-ripple@motor",
    "rattling-mass": "link-flexibility@load backlash@transmission coulomb-friction@load quadratic-damping@load",
    "loose-bolt": "link-flexibility@load stiffness-nonlinearity@transmission backlash@transmission",
    "turning-stiffness": "transmission-error@transmission stiffness-drift@transmission torque-ripple@motor",
    "heating-motor": "torque-gain@motor coulomb-friction@motor load-dependent-friction@transmission",
    "churning-grease": "coulomb-friction@motor stribeck-friction@motor torque-gain@motor",
    "stray-magnet": "gravity@load end-stop@load torque-ripple@motor coulomb-friction@load",
    "fretting": "quadratic-damping@load hysteresis@transmission structural-damping@transmission "
    "stiffness-nonlinearity@transmission",
}  # what an explainer that must name something would name instead


def laws(draw: Draw, *, unlisted: bool = False) -> tuple[Law, ...]:
    """The laws that a draw may use."""
    return tuple(law for law in (UNLISTED if unlisted else LISTED) if draw in law.draws)


def rivals(label: str) -> tuple[str, ...]:
    """``name@location`` of whatever is readily taken for ``label``, in a fixed order."""
    effect = label.split("@")[0]
    if effect in MISTAKEN_FOR:
        return tuple(sorted(MISTAKEN_FOR[effect].split()))
    return tuple(sorted({other for group in LOOK_ALIKES if label in group for other in group} - {label}))
