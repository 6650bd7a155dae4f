"""A rigid axis: what drives it is what passes through it, and its own angle is the motor's."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from jointscope.diagnosis import kernel
from jointscope.diagnosis.assembly import _plain
from jointscope.diagnosis.effects import REGISTRY, catalogue
from jointscope.diagnosis.effects.lines import Residuals
from jointscope.diagnosis.pipeline import diagnose
from jointscope.diagnosis.predict import free_prediction, predict_outputs
from jointscope.diagnosis.prepare import prepare
from jointscope.recordings.campaign import Nameplate, Run, Stream

M, RATE = 12.0, 2000.0


def stepped(numbers, drive, motion=None, v0=0.0, dry=False):
    """Rows of the kernel for a mass M under ``drive`` at half steps, or as ``motion`` (q, v, a) prescribes."""
    P, S = (x.copy() for x in _plain())
    P[kernel.J_M], P[kernel.J_L], P[kernel.DIRECT] = 1.0, M, 1.0
    for entry, value in numbers.items():
        P[entry] = value
    S[kernel.MOTOR] = kernel.MOTOR_HELD
    S[kernel.N_RIPPLE] = int(kernel.RIPPLE_0 in numbers or kernel.RIPPLE_0 + 1 in numbers)
    S[kernel.FRICTION_L] = int(dry)
    zero = np.zeros(drive.size)
    q, v, a = (zero, zero, zero) if motion is None else motion
    S[kernel.LOAD_PRESCRIBED] = int(motion is not None)
    out = np.empty(((drive.size + 1) // 2, kernel.N_OUT))
    x = np.array([0.0, 0.0, 0.0, v0])
    kernel.simulate(x, P, S, a, drive if motion is None else zero, q, v, 0.0, 1.0 / RATE, out)
    return out


def test_cogging_takes_no_energy():
    """M v^2/2 + (a/k) cos(k q) is what it was, over any number of pitches."""
    a, k, phase = 9.0, 2.0 * math.pi / 0.024, 0.7
    line = dict(zip(range(kernel.RIPPLE_0, kernel.RIPPLE_0 + 4), (a, 0.0, k, phase), strict=True))
    rows = stepped(line, np.zeros(4001), v0=0.31)
    q, v = rows[:, kernel.X_Q], rows[:, kernel.X_V]
    energy = 0.5 * M * v**2 + a / k * np.cos(k * q + phase)
    assert np.ptp(q) > 5.0 * 0.024
    assert np.ptp(energy) < 1e-7 * energy[0]
    assert np.ptp(v) > 0.01


@pytest.mark.parametrize("ahead", [False, True])
@pytest.mark.parametrize("creeps", [False, True])
@pytest.mark.parametrize("force", [30.0, -30.0])
@pytest.mark.parametrize("motor", [0.0, 0.6])
def test_friction_by_load_takes_its_share_of_what_passes_the_gear(ahead, creeps, force, motor):
    """U = J_M a + T (1 + k), J a = T - R with the friction ahead of T; U = J_M a + T, J a = T (1 - k) - R behind it."""
    mu, drag = 0.2, 1.5
    numbers = {kernel.PASSED: mu if ahead else -mu, kernel.GEAR_SHARE: motor / (1.0 - motor), kernel.B_L: drag}
    if creeps:
        numbers |= {kernel.ROUND_L_LOAD: mu, kernel.ROUND_L_SPEED: 1e-3}
    else:
        numbers |= {kernel.FL_LOAD: mu}
    rows = stepped(numbers, np.full(2001, force), v0=2.0, dry=not creeps)
    moving = rows[:, kernel.X_V] > 0.5
    a, rest = rows[moving, kernel.X_A], drag * rows[moving, kernel.X_V]
    J_M, k = motor * M, mu * np.sign(force)
    if ahead:
        T = (M - J_M) * a + rest
        assert J_M * a + T * (1.0 + k) == pytest.approx(force, rel=1e-6)
    else:
        T = force - J_M * a
        assert (M - J_M) * a + rest == pytest.approx(T * (1.0 - k), rel=1e-6)
    assert np.all(T * force > 0.0)


@pytest.mark.parametrize("motor", [0.0, 0.6])
@pytest.mark.parametrize("passed", [False, True])
@pytest.mark.parametrize("creeps", [False, True])
def test_the_drive_of_a_prescribed_motion_is_what_makes_that_motion(passed, creeps, motor):
    """There and back: the force that a motion takes, given to the axis, is the motion again."""
    mu, k = 0.15, 40.0
    t = np.arange(4001) / (2.0 * RATE)
    motion = (
        0.3 * t**2 + 0.2 * t + 0.02 * np.sin(5.0 * t),
        0.6 * t + 0.2 + 0.1 * np.cos(5.0 * t),
        0.6 - 0.5 * np.sin(5.0 * t),
    )
    line = dict(zip(range(kernel.RIPPLE_0, kernel.RIPPLE_0 + 4), (3.0, 0.1, k, 0.4), strict=True))
    load = {kernel.FL_LOAD: mu}
    if creeps:
        load = {
            kernel.ROUND_L_LOAD: mu,
            kernel.ROUND_L_SPEED: 0.01,
        }
    numbers = {
        **line,
        **load,
        kernel.B_L: 3.0,
        kernel.PASSED: mu if passed else -mu,
        kernel.GEAR_SHARE: motor / (1.0 - motor),
    }
    needed = stepped(numbers, t, motion, dry=not creeps)[:, kernel.X_TEXT]
    drive = np.interp(t, t[::2], needed)
    rows = stepped(numbers, drive, v0=float(motion[1][0]), dry=not creeps)
    assert rows[:, kernel.X_V] == pytest.approx(motion[1][::2], abs=3e-5)


@pytest.mark.parametrize("quantity", ["position", "velocity", "acceleration"])
def test_a_linear_motors_pitch_is_found_in_any_channel(builders, quantity):
    """What is left of a constant mass that cogs says the pitch, whatever was recorded beside the drive."""
    a, k, phase, rate = 4.0, 2.0 * math.pi / 0.024, 0.7, 1000.0
    t = np.arange(6000) / rate
    q = 0.15 * (1.0 - np.cos(1.4 * t))
    v, acc = 0.21 * np.sin(1.4 * t), 0.294 * np.cos(1.4 * t)
    force = M * acc - a * np.sin(k * q + phase)
    noise = np.random.default_rng(1).standard_normal((3, t.size)) * np.array([[2e-6], [1e-4], [0.2]])
    of = {
        "position": (q + noise[0], "m"),
        "velocity": (v + noise[1], "m/s"),
        "acceleration": (acc + noise[2], "m/s^2"),
    }
    names = {"velocity"} if quantity == "velocity" else {quantity, "position"}
    channels = [builders.channel("F", "force", "N", "load", "input", force)]
    channels += [builders.channel(n[0], n, of[n][1], "load", "output", of[n][0]) for n in sorted(names)]
    stream = Stream(file="m.csv", sampling_rate=rate, length=t.size, channels=tuple(channels))
    rig = Nameplate(
        topology="single-dof", motion="translational", plane="horizontal", inertia_reference=M, ground_spring=False
    )
    run = Run(id="m", experiment="speed-motion", streams=(stream,))
    problem = prepare(builders.campaign_of([run], rig))
    theta = problem.theta(load_inertia=M, load_damping=0.0)
    predicted = predict_outputs(problem.runs[0], theta, (), problem)
    outputs = problem.runs[0].outputs
    rows = Residuals(
        [[np.where(o.quantity == quantity, o.data - y, 0.0) for o, y in zip(outputs, predicted, strict=True)]]
    )
    law = next(spec for spec in REGISTRY if spec.name == "torque-ripple" and spec.variant == "pitch")
    assert law.possible(problem) is None
    found = law.residual_starts(problem, rows)
    near = min(found, key=lambda line: abs(line[0] - k))
    assert abs(near[0] - k) * np.ptp(q) < 1.05 * math.pi  # half a period more or less over the travel
    turns = [
        abs(math.remainder(at + (order - k) * 0.15 - phase, math.tau)) for order, at in found if order == near[0]
    ]
    assert min(turns) < 1.1  # one of three phases, a third of a turn apart


def test_a_rigid_axis_is_foretold_inside_its_drives_loop(builders):
    """J v' + b v = K_p (w - v) + K_i int (w - v): what the log is off by does not carry the angle away, as it does open loop."""
    J, b, gain, integral, rate, n = 2.0, 1.5, 60.0, 400.0, 1000.0, 20.0
    t = np.arange(6000) / rate
    w = 0.8 * np.sin(1.1 * t) ** 3
    v, held = np.zeros(t.size), np.zeros(t.size)
    for k in range(t.size - 1):  # Heun's steps
        a = (gain * (w[k] - v[k]) + integral * held[k] - b * v[k]) / J
        v_1, held_1 = v[k] + a / rate, held[k] + (w[k] - v[k]) / rate
        a_1 = (gain * (w[k + 1] - v_1) + integral * held_1 - b * v_1) / J
        v[k + 1] = v[k] + 0.5 * (a + a_1) / rate
        held[k + 1] = held[k] + 0.5 * (w[k] - v[k] + w[k + 1] - v_1) / rate
    q = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1])) / rate])
    torque = gain * (w - v) + integral * held
    channels = (
        builders.channel("w", "speed-command", "rad/s", "motor", "input", n * w),
        builders.channel("T", "torque", "N m", "motor", "input", (torque + 0.2) / n),
        builders.channel("m", "angle", "rad", "motor", "output", n * q),
    )
    stream = Stream(file="m.csv", sampling_rate=rate, length=t.size, channels=channels)
    rig = Nameplate(
        topology="single-dof", motion="rotational", plane="horizontal", reduction_ratio=n, inertia_reference=J,
        ground_spring=False, efficiency=1.0,
    )  # fmt: skip
    problem = prepare(builders.campaign_of([Run(id="m", experiment="speed-motion", streams=(stream,))], rig))
    run = problem.runs[0]
    for known in (1.0, 0.0):
        theta = problem.theta(
            load_inertia=J, load_damping=b, torque_offset=0.0, drive_gain=known * gain,
            drive_integral=known * integral, drive_acceleration=0.0, drive_velocity=0.0, drive_limit=0.0, drive_trust=1.0,
        )  # fmt: skip
        (y,) = (
            y
            for y, o in zip(free_prediction(run, theta, (), problem), run.declared, strict=True)
            if o.quantity == "angle"
        )
        error = np.sqrt(np.mean(np.square(y / n - q))) / np.sqrt(np.mean(np.square(q)))
        assert error < 0.02 if known else error > 0.5


def servo(builders, cogging, seed=5):
    """A driven table along known motions, its torque what they take: J a + b v less what cogs, the log with noise of its own."""
    J, b, rate, rng = 0.4, 0.6, 500.0, np.random.default_rng(seed)
    t = np.arange(2000) / rate
    rig = Nameplate(
        topology="single-dof", motion="rotational", plane="horizontal", reduction_ratio=1.0, inertia_reference=0.36,
        ground_spring=False, efficiency=1.0,
    )  # fmt: skip
    runs = []
    for k, (size, w) in enumerate([(0.9, 2.2), (0.6, 3.4), (1.1, 1.6), (0.8, 2.8)]):
        q = size * (1.0 - np.cos(w * t)) + 0.1 * size * np.sin(2.9 * w * t) ** 3
        v = np.gradient(q, t, edge_order=2)
        a = np.gradient(v, t, edge_order=2)
        torque = J * a + b * v - cogging * np.sin(14.0 * q + 0.7)
        channels = (
            builders.channel("T", "torque", "N m", "motor", "input", torque + 0.03 * rng.standard_normal(t.size)),
            builders.channel("m", "angle", "rad", "motor", "output", np.round(q / 1e-5) * 1e-5),
            builders.channel(
                "a", "angular-acceleration", "rad/s^2", "arm", "output", a + 0.02 * rng.standard_normal(t.size)
            ),
        )
        stream = Stream(file="m.csv", sampling_rate=rate, length=t.size, channels=channels)
        role = "validate" if k == 3 else "estimate"
        runs.append(Run(id=f"r{k}", experiment="speed-motion", streams=(stream,), role=role, initial="estimate"))
    return prepare(builders.campaign_of(runs, rig))


@pytest.mark.parametrize("cogging", [0.0, 0.12])
def test_cogging_of_a_direct_drive_is_named_and_the_noise_of_its_log_is_not(builders, cogging):
    problem = servo(builders, cogging)
    with ThreadPoolExecutor(2) as pool:
        found = diagnose(problem, predict_outputs, catalogue(problem), pool).decision
    if cogging == 0.0:
        assert found.verdict == "none"
        return
    assert found.chosen.names == ("torque-ripple@motor",)
    _, (effect,) = found.chosen.fit.coordinates.unpack(found.chosen.fit.x)
    assert effect.values[0] == pytest.approx(cogging, rel=0.05)
    assert effect.values[1] == pytest.approx(14.0, abs=0.05)


def test_the_noise_of_a_rigid_axiss_torque_log_is_taken_off(builders):
    """The model's acceleration is the torque over the inertia: what noise the log leaves in it is no mismatch."""
    run = servo(builders, 0.0).runs[0]
    assert run.motor.noise == pytest.approx(0.03, rel=0.2)
    raw = run.run.streams[0].channels[0].samples
    assert np.std(np.diff(run.motor.samples, 2)) < 0.2 * np.std(np.diff(raw, 2))
