"""Laws of the integrator: convergence order, equilibrium, energy, closed forms, inverse dynamics."""

import math

import numpy as np
import pytest

from jointscope.models.joint import (
    hammer_accelerance,
    load_acceleration_per_torque,
    motor_acceleration_per_torque,
)
from jointscope.models.parameters import Joint
from jointscope.prediction.integrate import Loop, integrate
from jointscope.prediction.plant import Plant
from jointscope.prediction.sensors import external_torque, shaft_torque

JOINT = Joint(
    stiffness=193_665.0,
    damping=59.76,
    load_inertia=3.02,
    motor_inertia=2.1e-4,
    reducer_inertia=2.48e-4,
    reduction_ratio=141.0,
    motor_damping=2.0,
    load_damping=2.0,
    efficiency=0.7,
)


def plant(motor="free", moment=0.0, **changes):
    values = dict(
        motor=motor,
        motor_inertia=JOINT.reflected_inertia,
        load_inertia=JOINT.load_inertia,
        stiffness=JOINT.stiffness,
        damping=JOINT.damping,
        motor_damping=JOINT.motor_damping,
        load_damping=JOINT.load_damping,
        gravity_moment=moment,
        ratio=JOINT.reduction_ratio,
        gain=JOINT.efficiency * JOINT.reduction_ratio,
    )
    return Plant(**{**values, **changes})


def pulse(t, centre=0.1, width=0.004):
    return np.exp(-0.5 * ((t - centre) / width) ** 2)


def march(p, duration, rate, *, q=0.0, torque=lambda t: 0 * t, load=lambda t: 0 * t, loop=None):
    n = round(duration * rate)
    t = np.arange(2 * n + 1) / (2 * rate)
    return integrate(p, start=0.0, rate=rate, arm_angle=q, motor_torque=torque(t), load_torque=load(t), loop=loop)


@pytest.mark.parametrize("motor", ["free", "held", "rigid"])
def test_the_error_falls_with_the_fourth_power_of_the_step(motor):
    p = plant(motor, moment=47.0)
    hold = p.holding_torque(-1.0)
    errors = []
    fine = march(p, 0.4, 32000.0, q=-1.0, torque=lambda t: hold + pulse(t), load=lambda t: 50 * pulse(t))
    for rate in (1000.0, 2000.0, 4000.0):
        coarse = march(p, 0.4, rate, q=-1.0, torque=lambda t: hold + pulse(t), load=lambda t: 50 * pulse(t))
        errors.append(np.max(np.abs(coarse.angle - fine.angle[:: round(32000 / rate)])))
    orders = np.log2(np.array(errors[:-1]) / np.array(errors[1:]))
    assert np.all(orders > 3.7)


@pytest.mark.parametrize(("which", "closed_form"), [
    ("acceleration", load_acceleration_per_torque),
    ("motor_acceleration", motor_acceleration_per_torque),
])  # fmt: skip
def test_free_motor_follows_the_closed_form(which, closed_form):
    rate, n = 8000.0, 32000
    motion = march(plant(), n / rate, rate, torque=lambda t: pulse(t) * np.sin(300 * t))
    t = np.arange(n + 1) / rate
    f = np.array([2.0, 10.0, 33.3, 46.0, 60.0, 90.0])
    kernel = np.exp(-2j * np.pi * np.outer(f, t)) / rate
    # what rings on after the record is rigid rotation, whose acceleration b/J decays too slowly to matter above 2 Hz
    G = closed_form(JOINT, 2j * np.pi * f) * plant().gain
    response = kernel @ getattr(motion, which)
    tail = getattr(motion, which)[-1] * np.exp(-2j * np.pi * f * t[-1]) / (2j * np.pi * f)
    expected = G * (kernel @ (pulse(t) * np.sin(300 * t)))
    assert np.abs((response + tail) / expected - 1.0) == pytest.approx(0.0, abs=2e-4)


def test_held_motor_follows_the_hammer_closed_form():
    rate, n = 8000.0, 24000
    motion = march(plant("held"), n / rate, rate, load=lambda t: 400 * pulse(t, width=0.003))
    t = np.arange(n + 1) / rate
    f = np.array([2.0, 10.0, 40.3, 60.0, 90.0])
    kernel = np.exp(-2j * np.pi * np.outer(f, t)) / rate
    ratio = (kernel @ motion.acceleration) / (kernel @ (400 * pulse(t, width=0.003)))
    expected = hammer_accelerance(JOINT, 2j * np.pi * f)
    assert np.abs(ratio / expected - 1.0) == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("q", [-1.2, -math.pi / 3, 0.0, 0.7, 2.0])
@pytest.mark.parametrize("motor", ["free", "held", "rigid"])
def test_a_held_arm_stays_where_it_is(q, motor):
    p = plant(motor, moment=47.0)
    motion = march(p, 0.5, 4000.0, q=q, torque=lambda t: p.holding_torque(q) + 0 * t)
    assert np.max(np.abs(motion.angle - q)) < 1e-9
    assert np.max(np.abs(motion.acceleration)) < 1e-6


def test_without_damping_or_drive_energy_is_conserved():
    p = plant(moment=47.0, damping=0.0, motor_damping=0.0, load_damping=0.0)
    motion = march(p, 2.0, 8000.0, q=0.3)  # let go of a vertical arm
    twist = motion.motor_angle - motion.angle
    energy = (
        0.5 * p.motor_inertia * motion.motor_speed**2
        + 0.5 * p.load_inertia * motion.speed**2
        + 0.5 * p.stiffness * twist**2
        + p.gravity_moment * np.sin(motion.angle)
    )
    assert np.ptp(energy) < 1e-6 * p.gravity_moment
    assert np.ptp(motion.angle) > 1.0  # and it did swing


def test_momentum_equals_the_impulse_that_went_in():
    p = plant(motor_damping=0.0, load_damping=0.0)
    motion = march(p, 0.5, 8000.0, torque=lambda t: pulse(t))
    momentum = p.motor_inertia * motion.motor_speed[-1] + p.load_inertia * motion.speed[-1]
    assert momentum == pytest.approx(p.gain * 0.004 * math.sqrt(2 * math.pi), rel=1e-9)


def test_a_mirrored_input_on_a_horizontal_rig_mirrors_the_motion():
    right = march(plant(), 0.3, 4000.0, torque=lambda t: pulse(t))
    left = march(plant(), 0.3, 4000.0, torque=lambda t: -pulse(t))
    assert left.angle == pytest.approx(-right.angle, abs=1e-15)


def test_inverse_dynamics_give_back_the_force_that_moved_the_load():
    p = plant("held", moment=47.0)
    n, rate = 2000, 8000.0
    forward = march(p, n / rate, 2 * rate, q=0.4, load=lambda t: 30 * pulse(t))
    nothing = np.zeros(2 * n + 1)
    motion = integrate(
        plant("held", moment=47.0, load_moves=True), start=0.0, rate=rate, arm_angle=0.4, motor_torque=nothing,
        load_torque=nothing, prescribed=np.stack([forward.angle, forward.speed, forward.acceleration]),
    )  # fmt: skip
    assert external_torque(motion, p) == pytest.approx(30 * pulse(motion.times), abs=1e-6)


def test_a_moved_motor_reports_the_torque_that_would_have_moved_it():
    p = plant()
    rate, n = 8000.0, 4000
    forward = march(p, n / rate, rate, torque=lambda t: pulse(t))
    fine = march(p, n / rate, 2 * rate, torque=lambda t: pulse(t))
    moved = np.stack([fine.motor_angle, fine.motor_speed, fine.motor_acceleration])
    nothing = np.zeros(2 * n + 1)
    motion = integrate(
        plant("moves"), start=0.0, rate=rate, arm_angle=0.0, motor_torque=nothing, load_torque=nothing,
        prescribed=moved,
    )  # fmt: skip
    assert motion.angle == pytest.approx(forward.angle, abs=1e-9)
    assert shaft_torque(motion, plant("moves")) == pytest.approx(pulse(forward.times), abs=1e-6)


def _loop(n, rate, share, limit=math.inf, hold=0.0):
    t = np.arange(2 * n + 1) / (2 * rate)
    command = 100.0 * np.sin(math.pi * np.minimum(t / 0.5, 1.0)) ** 2
    law = np.array([0.05, 0.5, 0.0, 0.0, hold, limit])
    return Loop(command=command, command_rate=np.gradient(command, t), law=law, share=share)


def test_a_closed_loop_follows_its_command():
    rate, n = 4000.0, 6000
    loop = _loop(n, rate, 1.0)
    motion = march(plant(), n / rate, rate, loop=loop)
    assert np.max(np.abs(loop.command[::2] - 141.0 * motion.motor_speed)) < 10.0
    assert 141.0 * motion.motor_speed[-1] == pytest.approx(0.0, abs=2.0)


def test_the_share_of_the_law_does_not_matter_when_log_and_law_agree():
    rate, n = 4000.0, 4000
    alone = march(plant(moment=47.0), n / rate, 2 * rate, q=-0.5, loop=_loop(2 * n, 2 * rate, 1.0, hold=0.42))
    mixed = march(
        plant(moment=47.0),
        n / rate,
        rate,
        q=-0.5,
        torque=lambda t: alone.torque,
        loop=_loop(n, rate, 0.3, hold=0.42),
    )
    assert mixed.angle == pytest.approx(alone.angle[::2], abs=2e-5)


def test_the_law_never_exceeds_its_limit():
    rate, n = 4000.0, 4000
    motion = march(plant(), n / rate, rate, loop=_loop(n, rate, 1.0, limit=0.4))
    assert np.max(np.abs(motion.torque)) == pytest.approx(0.4)


def test_the_fastest_eigenvalue_of_an_undamped_pair_is_the_torsion_frequency():
    p = plant(damping=0.0, motor_damping=0.0, load_damping=0.0)
    w = math.sqrt(p.stiffness * (1 / p.motor_inertia + 1 / p.load_inertia))
    assert p.fastest_rate() == pytest.approx(w)
