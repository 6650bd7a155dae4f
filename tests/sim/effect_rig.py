"""A rig whose effects are stepped in MuJoCo the way confirm does it, and what is read off its oscillations."""

import math
from pathlib import Path

import numpy as np

from jointscope.models.effects import augment
from jointscope.recordings.campaign import Campaign, Channel, Nameplate, Run, Stream
from jointscope.sim.effects import loop_of, physics_of
from jointscope.sim.replay import replay_run

K, C, J_L, J_M, N = 2e5, 0.0, 3.0, 9.0, 100.0
W0 = math.sqrt(K / J_L)
BASE = {
    "stiffness": K, "damping": C, "load_inertia": J_L, "motor_inertia": J_M, "motor_damping": 0.0, "load_damping": 0.0,
    "gravity_moment": 0.0, "efficiency": 1.0, "torque_scale": 1.0, "torque_offset": 0.0, "torque_age": 0.0, "drive_gain": 0.0,
    "drive_integral": 0.0, "drive_acceleration": 0.0, "drive_velocity": 0.0, "drive_limit": 0.0,
}  # fmt: skip
FLAT = Nameplate(topology="two-inertia", motion="rotational", plane="horizontal", reduction_ratio=N)
UPRIGHT = Nameplate(topology="two-inertia", motion="rotational", plane="vertical", reduction_ratio=N)
RATE = 2000.0
H = 1e-4


def channel(quantity, location, role, samples, **more):
    units = {"force": "N", "torque": "N m", "angle": "rad", "angular-velocity": "rad/s", "position": "m",
             "linear-acceleration": "m/s^2", "angular-acceleration": "rad/s^2", "acceleration": "m/s^2",
             "speed-command": "rad/s", "velocity": "m/s", "voltage": "V"}  # fmt: skip
    return Channel(
        column=f"{quantity} {location} {len(more)}", quantity=quantity, unit=units[quantity], location=location,
        role=role, samples=samples, **more,
    )  # fmt: skip


def run_of(*streams, experiment="hammer", **more):
    """One run of streams (rate, channels)."""
    return Run(
        id="a",
        experiment=experiment,
        streams=tuple(
            Stream(file=f"{i}.csv", sampling_rate=rate, length=len(channels[0].samples), channels=tuple(channels))
            for i, (rate, channels) in enumerate(streams)
        ),
        **more,
    )


def hit(seconds=1.0, impulse=3.0, rate=RATE, **more):
    """A pulse of ``impulse`` [N m s] on the braked arm at 1 m; its angular acceleration and an accelerometer."""
    t = np.arange(round(seconds * rate)) / rate
    width = 1.5e-3
    force = impulse / (width * math.sqrt(math.pi)) * np.exp(-(((t - 0.02) / width) ** 2))
    none = np.zeros(t.size)
    return run_of(
        (rate, [channel("force", "arm", "input", force, radius=1.0),
                channel("angle", "arm", "output", none), channel("angular-acceleration", "arm", "output", none),
                channel("linear-acceleration", "arm", "output", none, radius=0.5)]),
        brake=True, **more,
    )  # fmt: skip


def pushed(torque, rate=RATE, *, start=0.0, every=None, experiment="torque-sweep"):
    """Motor torque [N m on the shaft] on the free rig; with ``every`` a second device logs the motor's samples so often."""
    none = np.zeros(torque.size)
    arm = [
        channel("linear-acceleration", "arm", "output", none, radius=1.0),
        channel("angle", "arm", "output", none),
    ]
    torque = torque[:: every or 1]
    motor = [
        channel("torque", "motor", "input", torque),
        channel("angle", "motor", "output", np.zeros(torque.size)),
    ]
    streams = [(rate, motor + arm)] if every is None else [(rate, arm), (rate / every, motor)]
    return run_of(*streams, experiment=experiment, arm_angle=start)


def entry(effect, location, variant="", runs=None, **parameters):
    found = {"effect": effect, "location": location, "variant": variant, "parameters": parameters}
    return found if runs is None else {**found, "runs": runs}


def stepped(run, *effects, rig=FLAT, timestep=H, plate=None, **base):
    """The run's outputs through the model with ``effects``, by (quantity, location)."""
    keys = ("topology", "motion", "plane", "reduction_ratio", "ground_spring")
    plate = {**{key: getattr(rig, key) for key in keys}, **(plate or {})}
    built = augment({"kind": "diagnosis", "rig": plate, "base": {**BASE, **base}, "effects": list(effects)})
    campaign = Campaign(path=Path("campaign"), rig=rig, runs=(run,))
    done = replay_run(
        campaign, run, built.spec, physics_of(built.description)(run),
        loop=loop_of(built.description["drive"]), timestep=timestep,
    )  # fmt: skip
    return {(s.channel.quantity, s.channel.location): np.array(s.samples) for s in done.select(role="output")}


ARM, MOTOR, ACC = ("angle", "arm"), ("angle", "motor"), ("linear-acceleration", "arm")


def peaks(x, rate=RATE):
    """Times and sizes of the maxima of |x|, by parabolas."""
    size = np.abs(x)
    i = np.flatnonzero((size[1:-1] > size[:-2]) & (size[1:-1] >= size[2:])) + 1
    a, b, c = size[i - 1], size[i], size[i + 1]
    shift = 0.5 * (a - c) / (a - 2.0 * b + c)
    return (i + shift) / rate, b - 0.25 * (a - c) * shift


def frequency(t, x, low, high):
    """Mean frequency of the ring-down between two times, from its maxima [Hz]."""
    inside = (t > low) & (t < high)
    return (np.count_nonzero(inside) - 1) / 2.0 / (t[inside][-1] - t[inside][0])


def tone(f, seconds=1.0, rate=RATE, amplitude=1.0):
    t = np.arange(round(seconds * rate)) / rate
    return t, amplitude * np.sin(2.0 * math.pi * f * t) * np.clip(t / 0.2, 0.0, 1.0) ** 2


def transfer(x, y, f, t):
    late = t > 0.4
    line = np.exp(-2j * math.pi * f * t[late]) * np.hanning(late.sum())
    return complex((line @ (y[late] - y[late].mean())) / (line @ (x[late] - x[late].mean())))


def ratio(effect, f, **more):
    """Arm acceleration with over without ``effect`` at ``f`` [Hz]."""
    t, torque = tone(f)
    run = pushed(torque, **more)
    return transfer(stepped(run, damping=200.0)[ACC], stepped(run, effect, damping=200.0)[ACC], f, t)
