"""Laws that the concealed effects obey, in closed form, whatever their implementation."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from jointscope.models.joint import hammer_accelerance, load_acceleration_per_torque
from jointscope.models.parameters import Joint, Rig
from jointscope.sim.concealed import catalogue, engine, transmission
from jointscope.sim.concealed.engine import Drive, march
from jointscope.sim.concealed.law import Effect, Law, Moment, Setting, log_between
from jointscope.sim.concealed.mjcf import compile_plant

K, C, J = 190e3, 60.0, 3.0
RIG = Rig(
    joint=Joint(
        stiffness=K, damping=C, load_inertia=J, motor_inertia=2.1e-4, reducer_inertia=2.4e-4, reduction_ratio=141.0,
        motor_damping=2.0, load_damping=2.0, efficiency=0.7,
    ),
    arm_mass=12.0, arm_com_radius=0.42, hammer_radius=0.8, accelerometer_radius=0.95, gravity=0.0,
)  # fmt: skip
QUIET = replace(RIG, joint=replace(RIG.joint, damping=4.0, load_damping=0.0))
SETTING = Setting(
    rig=RIG, kinds=frozenset({"hammer", "torque-sweep", "speed-motion"}), devices=True, force=300.0, torque=190.0,
    drive_torque=150.0, acceleration=60.0, speed=1.8, travel=1.5, angle=0.0, daq_rate=1024.0, log_rate=500.0, runs=8,
)  # fmt: skip
W0 = math.sqrt(K / J)


def laws_of(effect: str, location: str | None = None) -> list[Law]:
    return [
        law for law in catalogue.LISTED + catalogue.UNLISTED
        if law.effect == effect and location in (None, law.location)
    ]  # fmt: skip


def numbers(law: Law, share: float = 0.5, rig: Rig = RIG, seed: int = 3) -> Effect:
    setting = replace(SETTING, rig=rig)
    low, high = law.span(setting)
    effect = Effect(law, law.shape(setting, np.random.default_rng(seed)))
    return effect.scaled(log_between(low, high, share))


def moment(braked: bool = True, index: int = 0) -> Moment:
    return Moment(index=index, runs=8, begin=0.0, braked=braked, kind="hammer", duration=2.0)


def act(effects: tuple[Effect, ...], push: np.ndarray, *, rig: Rig = RIG, drive: Drive | None = None, when=None):
    setting = replace(SETTING, rig=rig)
    when = when or moment(braked=drive is None)
    plant = compile_plant(rig, effects, setting, when, 0.0)
    slots = tuple(e.law.loop(e.values, setting, when) for e in effects if e.law.loop)
    return march(
        plant, start=0.0, push=push, drive=drive or Drive(0, np.zeros(push.size)), slots=slots, gravity=rig.gravity,
        settle=0.1 if rig.gravity == 0.0 else 0.6,
    )  # fmt: skip


def knock(windup: float, rig: Rig = RIG, seconds: float = 1.0) -> np.ndarray:
    """A short push whose free vibration has about this amplitude of wind-up [rad]."""
    times = np.arange(round(seconds / engine.TIMESTEP)) * engine.TIMESTEP
    length = 0.002
    force = windup * J * W0 / (rig.hammer_radius * length * 2.0 / math.pi)
    return np.where(times < length, force * np.sin(math.pi * times / length), 0.0)


def ringdown(windup: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, amplitudes and frequencies [Hz] of the half swings of a decaying vibration."""
    h = engine.TIMESTEP
    x = windup - 0.0
    crossings = np.flatnonzero(np.diff(np.sign(x)) != 0)
    crossings = crossings[crossings * h > 0.01]
    at = (crossings - x[crossings] / (x[crossings + 1] - x[crossings])) * h
    peaks = np.array([np.max(np.abs(x[a : b + 1])) for a, b in pairwise(crossings)])
    return 0.5 * (at[1:] + at[:-1]), peaks, 0.5 / np.diff(at)


def test_a_hit_follows_the_closed_form():
    """Without an effect the hammer's response is (19) within 0.2 % up to 100 Hz."""
    push = np.concatenate([np.zeros(100), knock(1e-3, seconds=2.5)])
    moved = act((), push)
    y = moved.accelerometer[:, 1]
    f = np.fft.rfftfreq(push.size, engine.TIMESTEP)
    band = (f > 2.0) & (f < 100.0)
    found = np.fft.rfft(y)[band] / np.fft.rfft(push)[band]
    right = RIG.accelerometer_radius * RIG.hammer_radius * hammer_accelerance(RIG.joint, 2j * np.pi * f[band])
    assert np.max(np.abs(found / right - 1.0)) < 2e-3


def test_a_swept_torque_follows_the_closed_form():
    """In a sweep the arm's acceleration over the logged torque is (7) within 1 % from 10 to 70 Hz."""
    n = 30000
    t = np.arange(n) * engine.TIMESTEP
    fade = np.clip(t / 0.05, 0, 1) * np.clip((2.8 - t) / 0.05, 0, 1)
    ratio = RIG.joint.efficiency * RIG.joint.reduction_ratio
    drive = Drive(1, 0.8 * fade * np.sin(2 * np.pi * (4.0 * t + 76.0 / 6.0 * t**2)), (0.02, 0.1))
    moved = act((), np.zeros(n), drive=drive)
    f = np.fft.rfftfreq(n, engine.TIMESTEP)
    band = (f > 10.0) & (f < 70.0)
    found = np.fft.rfft(moved.accelerometer[:, 1])[band] / np.fft.rfft(moved.torque)[band]
    right = RIG.accelerometer_radius * ratio * load_acceleration_per_torque(RIG.joint, 2j * np.pi * f[band])
    assert np.median(np.abs(found / right - 1.0)) < 2e-3
    assert np.max(np.abs(found / right - 1.0)) < 2e-2


@pytest.mark.parametrize("law", laws_of("backlash")[:2], ids=lambda law: law.law)
def test_backlash_lowers_the_frequency_by_its_describing_function(law):
    """f(A) = f0 sqrt(N(A)/K), N = K {1 - 2/pi [asin(d/A) + d/A sqrt(1 - (d/A)^2)]}."""
    gap = 2e-4
    moved = act((Effect(law, {"gap": gap, "inside": 0.0}),), knock(1.2e-3, QUIET), rig=QUIET)
    _, amplitude, frequency = ringdown(moved.windup)
    ratio = 0.5 * gap / amplitude
    keep = ratio < 0.5
    share = 1.0 - 2.0 / np.pi * (np.arcsin(ratio[keep]) + ratio[keep] * np.sqrt(1.0 - ratio[keep] ** 2))
    expected = W0 / (2 * np.pi) * np.sqrt(share)
    assert np.allclose(frequency[keep], expected, rtol=0.012)
    assert np.ptp(expected) > 1.0


def test_the_two_kinds_of_backlash_agree():
    """The dead-band tendon and the law in the loop are one law but for the damping inside the gap."""
    tendon, loop = laws_of("backlash")[:2]
    rig = replace(QUIET, joint=replace(QUIET.joint, damping=1e-3))
    values = {"gap": 1e-4, "inside": 0.0}
    a = act((Effect(tendon, values),), knock(1e-3, rig, 0.3), rig=rig).windup
    b = act((Effect(loop, values),), knock(1e-3, rig, 0.3), rig=rig).windup
    assert np.max(np.abs(a - b)) < 2e-3 * np.max(np.abs(a))


def test_a_cubic_spring_stiffens_along_its_backbone():
    """f = f0 (1 + 3 k3 A^2 / (8 K))."""
    law = laws_of("stiffness-nonlinearity")[0]
    effect = Effect(law, {"share": 0.1, "sign": 1.0})
    k3 = effect.reported(SETTING)["cubic"]
    _, amplitude, frequency = ringdown(act((effect,), knock(8e-4, QUIET), rig=QUIET).windup)
    assert np.allclose(frequency, W0 / (2 * np.pi) * (1.0 + 3.0 * k3 * amplitude**2 / (8.0 * K)), rtol=2e-3)


@pytest.mark.parametrize("law", laws_of("coulomb-friction", "load"), ids=lambda law: law.law)
def test_coulomb_friction_takes_away_a_constant_amplitude_per_swing(law):
    """dA/dt = -2 T w0/(pi K), with nothing else that damps."""
    rig = replace(QUIET, joint=replace(QUIET.joint, damping=1e-3))
    torque = 1.5
    values = {"torque": torque, "asymmetry": 0.0, "width": 1e-4, "presliding": 2e-6}
    times, amplitude, frequency = ringdown(act((Effect(law, values),), knock(1e-3, rig, 0.8), rig=rig).windup)
    keep = amplitude > 3e-4
    slope = np.polyfit(times[keep], amplitude[keep], 1)[0]
    assert slope == pytest.approx(-2.0 * torque * W0 / (np.pi * K), rel=0.03)
    assert np.ptp(frequency[keep]) < 0.1


def test_set_valued_friction_does_not_creep():
    """Below its limit the mass stands still, exactly as a set-valued law says."""
    law = laws_of("coulomb-friction", "motor")[0]
    n = 10000
    ratio = RIG.joint.efficiency * RIG.joint.reduction_ratio
    hold = Drive(1, np.full(n, 10.0 / ratio))
    effect = Effect(law, {"torque": 20.0, "asymmetry": 0.0, "width": 1.0, "presliding": 1.0})
    moved = act((effect,), np.zeros(n), drive=hold)
    assert abs(moved.motor[-1] - moved.motor[n // 2]) < 1e-9
    free = act((), np.zeros(n), drive=hold)
    assert free.motor[-1] - free.motor[n // 2] > 0.05


def test_quadratic_damping_decays_as_its_average_says():
    """dA/dt = -4 c w0 A^2/(3 pi J)."""
    law = laws_of("quadratic-damping")[0]
    rig = replace(QUIET, joint=replace(QUIET.joint, damping=1e-3))
    c = 40.0
    times, amplitude, _ = ringdown(act((Effect(law, {"coefficient": c}),), knock(1e-3, rig), rig=rig).windup)
    rate = np.gradient(1.0 / amplitude, times)
    assert np.median(rate[3:-3]) == pytest.approx(4.0 * c * W0 / (3.0 * np.pi * J), rel=0.03)


@pytest.mark.parametrize("slope", [0.0, 0.2, -0.2])
def test_the_ladder_of_structural_damping_has_the_loss_that_it_states(slope):
    """Loss modulus loss K (f/f0)^slope from 2 to 300 Hz within 6 %."""
    ladder = transmission.maxwell_ladder(0.05, K, slope, 40.0)
    f = np.geomspace(2.0, 300.0, 60)
    s = 2j * np.pi * f
    modulus = sum(
        ladder[1 + 2 * i] * s * ladder[2 + 2 * i] / (1.0 + s * ladder[2 + 2 * i]) for i in range(int(ladder[0]))
    )
    assert np.allclose(modulus.imag / K, 0.05 * (f / 40.0) ** slope, rtol=0.06)


def test_a_hysteresis_loop_saturates():
    """Past its yield the loop carries its torque and no more; the loss per cycle is that of the elements."""
    law = laws_of("hysteresis")[2]
    rate = {"torque": 10.0, "yield": 5e-5, "shape": 0.5, "exponent": 1.0, "rate": 0.0}
    slot = law.loop(rate, SETTING, moment())
    x, f, s = np.zeros(engine.LAW_STATES), np.zeros(8), np.zeros(16)
    p = np.zeros(engine.LAW_PARAMETERS)
    p[: len(slot.parameters)] = slot.parameters
    windup = 1e-3 * np.sin(np.linspace(0, 4 * np.pi, 4001))
    torque = np.empty_like(windup)
    for k, d in enumerate(windup):
        f[:] = 0.0
        s[engine.WINDUP] = d
        slot.law(p, x, s, f)
        torque[k] = f[engine.TRANSMISSION]
    assert np.max(torque) == pytest.approx(10.0, rel=1e-6)
    lost = np.sum(0.5 * (torque[2001:] + torque[2000:-1]) * np.diff(windup[2000:]))
    pairs = np.array(slot.parameters[2:]).reshape(-1, 2)
    ideal = np.sum(4.0 * pairs[:, 1] * (1e-3 - pairs[:, 1] / pairs[:, 0]))  # Jenkins: 4 W (A - W/k)
    assert lost == pytest.approx(ideal, rel=0.01)


@pytest.mark.parametrize("law", laws_of("link-flexibility") + laws_of("base-compliance"), ids=lambda law: law.law)
def test_a_further_mode_appears_near_its_frequency(law):
    """The eigenfrequencies gain one, not far from the one that is stated."""
    import mujoco

    effect = numbers(law, 0.4)
    plant = compile_plant(RIG, (effect,), SETTING, moment(), 0.0)
    model, data = plant.model, mujoco.MjData(plant.model)
    mujoco.mj_forward(model, data)
    mass = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, mass)
    stiffness = np.diag([float(model.jnt_stiffness[i]) for i in range(model.njnt)])
    found = np.sort(np.sqrt(np.abs(np.linalg.eigvals(np.linalg.solve(mass, stiffness))))) / (2 * np.pi)
    stated = effect.values["frequency"]
    assert found.size >= 2

    assert np.min(np.abs(found / stated - 1.0)) < 0.25
    assert np.min(np.abs(found * 2 * np.pi / W0 - 1.0)) < 0.15


EVERY = [law for law in catalogue.LISTED + catalogue.UNLISTED if law.chain is None]


@pytest.mark.parametrize("law", EVERY, ids=lambda law: f"{law.effect}@{law.location}-{law.law}")
def test_every_law_fades_with_its_strength(law):
    """The weakest form of a law does less than its strongest, and neither diverges."""
    driven = "hammer" not in law.seen_in or (law.location == "motor" and not law.keeps_motor) or law.travels
    n = 4000
    t = np.arange(n) * engine.TIMESTEP
    drive = Drive(2, 1.2 * np.sin(np.pi * t / 0.4) ** 2, (5.0, 100.0), 10.0) if driven else None
    push = np.zeros(n) if driven else knock(1.6e-3, seconds=0.4)
    setting = SETTING if driven else replace(SETTING, kinds=frozenset({"hammer"}), speed=0.2, travel=1e-3)

    def far(share: float) -> float:
        low, high = law.span(setting)
        effect = Effect(law, law.shape(setting, np.random.default_rng(5))).scaled(log_between(low, high, share))
        if law.effect == "end-stop":
            effect = Effect(law, {**effect.values, "angle": 0.1 if driven else 1e-4, "side": 1.0})
        when = moment(braked=not driven, index=3)
        moved = act((effect,), push, drive=drive, when=when)
        return float(np.linalg.norm(moved.accelerometer - base.accelerometer))

    base = act((), push, drive=drive)
    weak, strong = far(0.0), far(1.0)
    assert np.isfinite(strong)
    assert strong > 0.0
    assert weak < 0.5 * strong or law.effect in ("structural-damping",)


@pytest.mark.parametrize("time_constant", [2e-5, 3e-4, 4e-3])
@pytest.mark.parametrize("law", laws_of("drive-lag"), ids=lambda law: law.law)
def test_a_lag_is_late_by_its_time_constant(law, time_constant):
    """A torque that rises evenly comes through as itself, late by the time constant, whatever the engine's step."""
    values = {**law.shape(SETTING, np.random.default_rng(3)), "time_constant": time_constant}
    slot = law.loop(values, SETTING, moment(braked=False))
    p, x = np.zeros(engine.LAW_PARAMETERS), np.zeros(engine.LAW_STATES)
    p[: len(slot.parameters)] = slot.parameters
    s, f, rate, h = np.zeros(16), np.zeros(8), 50.0, engine.TIMESTEP
    s[engine.H] = h
    for k in range(1000):
        s[engine.TAU], f[engine.MOTOR] = rate * k * h, 0.0
        slot.law(p, x, s, f)
    assert f[engine.MOTOR] == pytest.approx(-rate * time_constant, rel=1e-6)
