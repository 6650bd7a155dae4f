"""Faults of the recording: clocks, the accelerometer, the torque log. They act in the measurement chain only."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from jointscope.sim.concealed.law import EVERY_DRAW, OPEN_DRAWS, Kind, Law, Moment, Setting, Values

DRIVES: frozenset[Kind] = frozenset({"torque-sweep", "speed-motion"})
ANY: frozenset[Kind] = frozenset({"hammer", "torque-sweep", "speed-motion"})
Chain = Callable[[Values, Moment], Mapping[str, float]]
Span = Callable[[Setting], tuple[float, float]]
Report = Callable[[Values, Setting], dict[str, float]]
Shape = Callable[[Setting, np.random.Generator], dict[str, float]]


def _law(
    effect: str, name: str, main: str, unit: str, strength: str, span: Span, shape: Shape, chain: Chain,
    *, report: Report | None = None, departs: bool = False, seen_in: frozenset[Kind] = ANY, two_devices: bool = False,
) -> Law:  # fmt: skip
    return Law(
        effect=effect, location="acquisition", law=name, departs=departs, main=main, strength=strength, span=span,
        shape=shape, units={main: unit}, report=report, seen_in=seen_in, two_devices=two_devices, chain=chain,
        draws=OPEN_DRAWS if departs else EVERY_DRAW,
    )  # fmt: skip


def _plain(key: str) -> Shape:
    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {key: 0.0}

    return shape


def _clocks() -> list[Law]:
    def ppm(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"ppm": 0.0, "sign": float(rng.choice([-1.0, 1.0])), "period": float(rng.uniform(2.0, 6.0))}

    signed_ppm: Report = lambda v, s: {"ppm": v["sign"] * v["ppm"]}  # noqa: E731
    late = lambda setting: (2e-5, 5e-3)  # noqa: E731
    fast = lambda setting: (2.0, 500.0)  # noqa: E731
    return [
        _law("delay", "constant", "delay", "s", "delay", late, _plain("delay"),
             lambda v, m: {"delay": v["delay"]}, seen_in=DRIVES, two_devices=True),
        _law("delay", "framed", "delay", "s", "delay", late, _plain("delay"),
             lambda v, m: {"delay": 0.75 * v["delay"], "frame": 0.5 * v["delay"]}, departs=True,
             seen_in=DRIVES, two_devices=True),
        _law("clock-drift", "constant", "ppm", "ppm", "ppm", fast, ppm,
             lambda v, m: {"ppm": v["sign"] * v["ppm"]}, report=signed_ppm, seen_in=DRIVES, two_devices=True),
        _law("clock-drift", "wandering", "ppm", "ppm", "ppm", fast, ppm,
             lambda v, m: {"ppm": v["sign"] * v["ppm"], "wander": 3e-7 * v["ppm"], "wander_period": v["period"]},
             report=signed_ppm, departs=True, seen_in=DRIVES, two_devices=True),
    ]  # fmt: skip


def _accelerometer() -> list[Law]:
    def tilt(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"angle": 0.0, "sign": float(rng.choice([-1.0, 1.0])), "cross": float(rng.uniform(-0.02, 0.02))}

    def mount(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"frequency": 0.0, "damping": float(rng.uniform(0.02, 0.15))}

    def level(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {
            "share": 0.0, "unit": setting.acceleration, "weight": setting.rig.gravity, "softness": float(rng.uniform(0.05, 0.2)),
            "recovery": float(rng.uniform(0.01, 0.05)),
        }  # fmt: skip

    def gain(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {
            "excess": 0.0, "sign": float(rng.choice([-1.0, 1.0])),
            "slope": float(rng.uniform(0.1, 0.4) / setting.acceleration),
        }  # fmt: skip

    angle: Report = lambda v, s: {"angle": v["sign"] * v["angle"]}  # noqa: E731
    limit: Report = lambda v, s: {"level": v["weight"] + v["share"] * v["unit"]}  # noqa: E731
    true: Report = lambda v, s: {"gain": 1.0 + v["sign"] * v["excess"]}  # noqa: E731
    low = lambda setting: (0.9 * setting.daq_rate, max(70.0, 1.6 * setting.frequency))  # noqa: E731
    return [
        _law("sensor-tilt", "turned", "angle", "rad", "angle", lambda s: (0.003, 0.35), tilt,
             lambda v, m: {"tilt": v["sign"] * v["angle"]}, report=angle),
        _law("sensor-tilt", "turned-and-crossed", "angle", "rad", "angle", lambda s: (0.003, 0.35), tilt,
             lambda v, m: {"tilt": v["sign"] * v["angle"], "cross": v["cross"] * v["angle"]}, report=angle, departs=True),
        _law("sensor-resonance", "second-order", "frequency", "Hz", "frequency", low, mount,
             lambda v, m: {"resonance": v["frequency"], "resonance_damping": v["damping"]}),
        _law("sensor-resonance", "with-bandwidth-limit", "frequency", "Hz", "frequency", low, mount,
             lambda v, m: {"resonance": v["frequency"], "resonance_damping": v["damping"],
                           "bandwidth": 4.0 * v["frequency"]}, departs=True),
        _law("sensor-saturation", "hard", "level", "m/s^2", "share", lambda s: (1.2, 0.2), level,
             lambda v, m: {"level": v["weight"] + v["share"] * v["unit"]}, report=limit),
        _law("sensor-saturation", "soft-with-recovery", "level", "m/s^2", "share", lambda s: (1.2, 0.2), level,
             lambda v, m: {"level": v["weight"] + v["share"] * v["unit"], "softness": v["softness"], "recovery": v["recovery"]},
             report=limit, departs=True),
        _law("sensor-gain", "constant", "gain", "1", "excess", lambda s: (0.003, 0.2), gain,
             lambda v, m: {"gain": 1.0 + v["sign"] * v["excess"]}, report=true),
        _law("sensor-gain", "bent", "gain", "1", "excess", lambda s: (0.003, 0.2), gain,
             lambda v, m: {"gain": 1.0 + v["sign"] * v["excess"], "gain_slope": v["slope"] * v["excess"] * 0.2},
             report=true, departs=True),
    ]  # fmt: skip


def _log() -> list[Law]:
    def shape(setting: Setting, rng: np.random.Generator) -> dict[str, float]:
        return {"every": 0.0, "log_rate": setting.log_rate}

    def refresh(v: Values) -> float:
        return v["log_rate"] / max(2, round(v["every"]))

    held: Chain = lambda v, m: {"refresh": refresh(v)}  # noqa: E731
    averaged: Chain = lambda v, m: {"refresh": refresh(v), "averaged": 1.0}  # noqa: E731
    lagged: Chain = lambda v, m: {"refresh": refresh(v), "log_lag": 0.3 / refresh(v)}  # noqa: E731
    rate: Report = lambda v, s: {"rate": refresh(v)}  # noqa: E731
    span: Span = lambda setting: (2.0, 10.0)  # noqa: E731
    return [
        _law("torque-logging", "held", "rate", "Hz", "every", span, shape, held, report=rate, seen_in=DRIVES),
        _law("torque-logging", "averaged", "rate", "Hz", "every", span, shape, averaged, report=rate, seen_in=DRIVES),
        _law("torque-logging", "lagged-and-held", "rate", "Hz", "every", span, shape, lagged, report=rate,
             seen_in=DRIVES, departs=True),
    ]  # fmt: skip


LAWS: tuple[Law, ...] = (*_clocks(), *_accelerometer(), *_log())
