"""Laws of the test draw that depart from the textbook's under the same names; no other draw has them.

Written from the effect names alone, last of all, and apart from the open draws' departures: a diagnosis that was
tuned on those has not seen these.
"""

from __future__ import annotations

import math
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from jointscope.sim.concealed import arm_side, drive_side, friction, further_modes, transmission
from jointscope.sim.concealed.acquisition import LAWS as ACQUISITION
from jointscope.sim.concealed.drive_side import DRIVES
from jointscope.sim.concealed.engine import Slot
from jointscope.sim.concealed.equations_of_the_test import (
    ageing,
    counterweight,
    knee_loss,
    late_drag,
    relaxing,
    round_teeth,
    rubber,
    sagging_gain,
    second_order_lag,
    slipping_elements,
    steep_dahl,
    three_slopes,
    wandering_line,
)
from jointscope.sim.concealed.law import TEST_DRAW, InLoop, Install, Law, Moment, Setting, Values
from jointscope.sim.concealed.mjcf import find, words

Chain = Mapping[str, float]


def _like(laws: tuple[Law, ...], effect: str, name: str, location: str | None = None) -> Law:
    """A textbook law of an effect, to take its span, shape and units from."""
    found = next(
        law for law in laws if law.effect == effect and not law.departs and location in (None, law.location)
    )
    return replace(found, law=name, departs=True, draws=TEST_DRAW, loop=None, install=None,
                  chain=None)  # fmt: skip


def _with(law: Law, *, loop: InLoop | None = None, install: Install | None = None) -> Law:
    return replace(law, loop=loop, install=install)


def _dry(side: int) -> list[Law]:
    where = "load" if side else "motor"

    def elements(v: Values, s: Setting, m: Moment) -> Slot:
        around = 1.0 if side else s.rig.joint.reduction_ratio
        pairs: list[float] = []
        for share, reach in ((0.5, 0.4), (0.3, 1.0), (0.2, 2.5)):
            limit = share * v["torque"]
            pairs += [limit / (reach * 0.3 * v["presliding"]), limit]
        return Slot(slipping_elements, (3.0, side, 0.12, 3.0 * around, *pairs))

    def aged(v: Values, s: Setting, m: Moment) -> Slot:
        stiffness = v["torque"] / (0.5 * v["presliding"])
        return Slot(ageing, (v["torque"], v["rise"], v["stribeck_velocity"], s.windup * 0.05, stiffness, side))

    return [
        _with(_like(friction.LAWS, "coulomb-friction", "uneven-elements", where), loop=elements),
        _with(_like(friction.LAWS, "stribeck-friction", "ageing-contacts", where), loop=aged),
    ]


def _losses() -> list[Law]:
    def knee(v: Values, s: Setting, m: Moment) -> Slot:
        return Slot(knee_loss, (v["coefficient"], s.rig.joint.reflected_inertia, 0.1 * s.torque))

    def threshold(v: Values, s: Setting, m: Moment) -> Slot:
        return Slot(late_drag, (1.6 * v["coefficient"], 0.12 * s.speed))

    return [
        _with(_like(friction.LAWS, "load-dependent-friction", "with-knee"), loop=knee),
        _with(_like(friction.LAWS, "quadratic-damping", "beyond-a-speed"), loop=threshold),
    ]


def _transmission() -> list[Law]:
    laws = transmission.LAWS

    def teeth(v: Values, s: Setting, m: Moment) -> Slot:
        j = s.rig.joint
        half = 0.5 * v["gap"]
        return Slot(round_teeth, (j.stiffness, j.damping, half, 0.3 * half, 4.0 * (v["inside"] - 0.05) * half))

    def slopes(v: Values, s: Setting, m: Moment) -> Slot:
        knee = s.windup * v["knee_share"]
        return Slot(three_slopes, (v["share"] * s.rig.joint.stiffness, knee, 3.0 * knee, v["side"]))

    def slopes_shape(s: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"share": 0.0, "knee_share": float(rng.uniform(0.1, 0.3)), "side": float(rng.uniform(-0.2, 0.2))}

    def dahl(v: Values, s: Setting, m: Moment) -> Slot:
        return Slot(steep_dahl, (v["torque"], v["yield"], 1.0 + v["exponent"]))

    def peaked(v: Values, s: Setting, m: Moment) -> Slot:
        flat = transmission.maxwell_ladder(v["loss_factor"], s.rig.joint.stiffness, 0.0, s.frequency)
        out = [flat[0]]
        for i in range(int(flat[0])):
            octaves = math.log(1.0 / (2.0 * math.pi * flat[2 + 2 * i]) / s.frequency)
            out += [flat[1 + 2 * i] * 1.1 * math.exp(-0.5 * (octaves / 1.8) ** 2), flat[2 + 2 * i]]
        return Slot(transmission.relaxation, tuple(out))

    def creep(v: Values, s: Setting, m: Moment) -> Slot:
        whole = v["sign"] * v["rate"] * s.runs
        return Slot(relaxing, (s.rig.joint.stiffness, whole / math.log(1.0 + s.runs / 3.0), 90.0))

    def sidebands(v: Values, s: Setting, m: Moment) -> Slot:
        j = s.rig.joint
        turns = 1.0 if v["per_output"] else j.reduction_ratio
        a, k = v["amplitude"], v["order"]
        near = 1.0 if v["per_output"] else 1.0 / 20.0
        lines = ((a, k, v["phase"]), (0.35 * a, k + near, v["phase2"]), (0.3 * a, k - near, v["phase3"]),
                 (0.4 * a, 2 * k, v["phase4"]), (0.25 * a, 3 * k, v["phase5"]), (0.2 * a, 5 * k, v["phase6"]))  # fmt: skip
        flat = [number for line in lines for number in line]
        return Slot(
            transmission.kinematic_error,
            (j.stiffness, j.damping, turns, v["per_output"], float(len(lines)), *flat),
        )

    damping = next(law for law in laws if law.effect == "structural-damping").install
    soft = next(law for law in laws if law.law == "soft-below-knee")
    return [
        _with(_like(laws, "backlash", "rounded-teeth"), loop=teeth, install=transmission.without_spring),
        replace(soft, law="three-slopes", draws=TEST_DRAW, shape=slopes_shape, loop=slopes,
               units={"share": "1"}),
        _with(_like(laws, "hysteresis", "steep-dahl"), loop=dahl),
        _with(_like(laws, "structural-damping", "peaked-loss"), loop=peaked, install=damping),
        _with(_like(laws, "stiffness-drift", "relaxing"), loop=creep),
        _with(_like(laws, "transmission-error", "with-sidebands"), loop=sidebands),
    ]  # fmt: skip


def _drive() -> list[Law]:
    laws = drive_side.LAWS

    def slots_and_poles(v: Values, s: Setting, m: Moment) -> Slot:
        n = s.rig.joint.reduction_ratio
        lines: list[float] = []
        for k, size in ((1, 1.0), (3, 0.4), (5, 0.25), (7, 0.15)):
            lines += [v["amplitude"] * size, v["order"] * k, v["phase"] * k]
        return Slot(drive_side.ripple, (n, s.drive_torque, 0.0, 4.0, *lines))

    def loop(v: Values, s: Setting, m: Moment) -> Slot:
        zeta = 0.65
        return Slot(second_order_lag, (2.0 * zeta / v["time_constant"], zeta))

    def sag(v: Values, s: Setting, m: Moment) -> Slot:
        return Slot(sagging_gain, (v["sign"] * v["excess"], 0.3, m.duration))

    return [
        _with(_like(laws, "torque-ripple", "odd-harmonics"), loop=slots_and_poles),
        _with(_like(laws, "drive-lag", "current-loop"), loop=loop),
        _with(_like(laws, "torque-gain", "sagging"), loop=sag),
    ]


def _arm() -> list[Law]:
    laws = arm_side.LAWS
    payload = next(law for law in laws if law.law == "rigid")

    def folding(v: Values, s: Setting, m: Moment) -> Slot:
        return Slot(counterweight, (v["sign"] * v["moment"], 0.3))

    def soft_stop(v: Values, s: Setting, m: Moment) -> Slot:
        depth = 0.02 * s.travel if s.moves else 2.0 * s.windup
        return Slot(rubber, (v["angle"], v["side"], v["stiffness"], depth, v["absorb"]))

    def wide(root: ET.Element, v: Values, s: Setting, m: Moment) -> None:
        assert payload.install is not None
        payload.install(root, v, s, m)
        for body in root.iter("body"):
            inertial = body.find("inertial")
            if body.get("name") == "payload" and inertial is not None:  # a body of its own size, and below the arm
                inertial.set("diaginertia", words(*(3 * [0.15 * v["inertia"]])))
                inertial.set("pos", "0 0 -0.05")

    return [
        _with(_like(laws, "gravity", "folding-counterweight"), loop=folding),
        _with(_like(laws, "payload", "below-the-arm"), install=wide),
        _with(_like(laws, "end-stop", "rubber"), loop=soft_stop),
    ]


def _modes() -> list[Law]:
    laws = further_modes.LAWS

    def bends(root: ET.Element, v: Values, s: Setting, m: Moment) -> None:
        J = s.rig.joint.load_inertia * v["share"]
        k = J * (1.0 - v["share"]) * (2.0 * math.pi * v["frequency"]) ** 2
        c = 2.0 * v["damping"] * k / (2.0 * math.pi * v["frequency"])
        centre = s.rig.arm_com_radius
        hinges = [(0.15 * centre, 1.05 * k, 1.05 * c), (0.5 * centre, 0.65 * k, 0.65 * c)]
        further_modes.split_arm(root, s, v["share"], hinges)

    def slide_and_rock(root: ET.Element, v: Values, s: Setting, m: Moment) -> None:
        slide = next(law for law in laws if law.law == "sliding")
        assert slide.install is not None
        slide.install(root, v, s, m)
        mount = find(root, "body", "mount")
        J = 3.0 * s.rig.joint.load_inertia / v["share"] ** 0.5
        w = 2.0 * math.pi * 1.7 * v["frequency"]
        rock = ET.Element("joint", {"name": "rock", "type": "hinge", "axis": "0 -1 0", "stiffness": repr(J * w**2),
                                    "damping": repr(0.04 * J * w)})  # fmt: skip
        mount.insert(1, rock)
        inertial = mount.find("inertial")
        assert inertial is not None
        inertial.set("diaginertia", words(J, J, J))

    def offset(root: ET.Element, v: Values, s: Setting, m: Moment) -> None:
        parallel = next(law for law in laws if law.law == "parallel-axis")
        assert parallel.install is not None
        parallel.install(root, v, s, m)
        joint = find(root, "joint", "neighbour")
        d = v["distance"]
        joint.set("pos", words(-d, 0.0, -0.5 * d))

    def wander(v: Values, s: Setting, m: Moment) -> Slot:
        phase = float(np.random.default_rng([int(v["seed"]), m.index]).uniform(-np.pi, np.pi))
        return Slot(wandering_line, (v["amplitude"], v["frequency"], phase, 1.5, 0.4))

    return [
        _with(_like(laws, "link-flexibility", "two-bends"), install=bends),
        _with(_like(laws, "base-compliance", "slide-and-rock"), install=slide_and_rock),
        _with(_like(laws, "neighbour-flexibility", "offset-axis"), install=offset),
        _with(_like(laws, "external-vibration", "wandering-line"), loop=wander),
    ]


def _acquisition() -> list[Law]:
    def chained(effect: str, name: str, textbook: str, more: Mapping[str, float]) -> Law:
        found = next(law for law in ACQUISITION if law.effect == effect and law.law == textbook)
        first = found.chain
        assert first is not None

        def chain(v: Values, m: Moment) -> Chain:
            return {**first(v, m), **more}

        return replace(found, law=name, departs=True, draws=TEST_DRAW, chain=chain)

    def by_run(v: Values, m: Moment) -> Chain:
        own = float(np.random.default_rng([int(v["delay"] * 1e9), m.index]).uniform(-0.3, 0.3))
        return {"delay": v["delay"] * (1.0 + own)}

    def limited(v: Values, m: Moment) -> Chain:
        return {"bandwidth": v["frequency"]}

    def aliased(v: Values, m: Moment) -> Chain:
        return {"tone": 0.8 * v["log_rate"], "tone_amplitude": v["ripple"]}

    def tone_shape(s: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"ripple": 0.0, "log_rate": s.log_rate}

    delay = next(law for law in ACQUISITION if law.effect == "delay")
    mount = next(law for law in ACQUISITION if law.effect == "sensor-resonance")
    logging = next(law for law in ACQUISITION if law.effect == "torque-logging")
    return [
        replace(delay, law="from-run-to-run", departs=True, draws=TEST_DRAW, chain=by_run),
        chained("clock-drift", "slowly-wandering", "constant", {"wander": 4e-5, "wander_period": 11.0}),
        chained("sensor-tilt", "with-cross-axis", "turned", {"cross": 0.004}),
        replace(mount, law="first-order-limit", departs=True, draws=TEST_DRAW, chain=limited),
        chained("sensor-saturation", "companding", "hard", {"softness": 0.35}),
        chained("sensor-gain", "with-bandwidth-limit", "constant", {"bandwidth": 2500.0}),
        replace(logging, law="aliased", departs=True, draws=TEST_DRAW, chain=aliased,
               strength="ripple", span=lambda s: (0.001, 0.2), shape=tone_shape, seen_in=DRIVES,
               report=lambda v, s: {"rate": s.log_rate}),
    ]  # fmt: skip


LAWS: tuple[Law, ...] = (
    *_dry(0), *_dry(1), *_losses(), *_transmission(), *_drive(), *_arm(), *_modes(), *_acquisition(),
)  # fmt: skip
