"""A sound campaign of hits, a sweep and a frequency response, in files of whichever kind, for tests to damage."""

import h5py
import numpy as np

HEAD = """format = "jointscope-campaign/1"
title = "bench"

[rig]
topology = "two-inertia"
motion = "rotational"
plane = "vertical"
reduction_ratio = 141.0
motor_inertia = 1.73e-4
reducer_inertia = 2.85e-4
arm_mass = 12.0
arm_com_radius = 0.5
efficiency = 0.7
"""
RUN = """
[[run]]
id = "{id}"
experiment = "hammer"
brake = true
arm_angle = 0.0

[[run.stream]]
file = "{file}"
sampling_rate = 1024.0
{more}
channels = [
  {{ column = "force", quantity = "force", unit = "N", location = "arm", radius = 0.8, role = "input" }},
  {{ column = "acc", quantity = "linear-acceleration", unit = "m/s^2", location = "arm", radius = 0.95, role = "output" }},
]
"""
DRIVEN = """
[[run]]
id = "driven"
experiment = "torque-sweep"
arm_angle = -1.0

[[run.stream]]
file = "{file}"
sampling_rate = 500.0
start = 0.002
start_uncertainty = 1e-4
channels = [
  {{ column = "torque", quantity = "torque", unit = "N m", location = "motor", role = "input" }},
  {{ column = "angle", quantity = "angle", unit = "deg", location = "motor", role = "output" }},
]
"""
FRF = """
[[run]]
id = "frf"
experiment = "hammer"
brake = true
arm_angle = 0.0

[[run.stream]]
file = "{file}"
frequency = "f"
channels = [
  {{ column = "h", quantity = "frf", form = "accelerance", unit = "rad/s^2/(N m)", location = "arm", role = "output",
     coherence = "g" }},
]
"""


def hit(rng, count=512, rate=1024.0):
    """Force and acceleration of a ringing arm."""
    t = np.arange(count) / rate
    force = 200.0 * np.sin(np.pi * np.clip((t - 0.01) / 0.006, 0.0, 1.0)) + 0.2 * rng.standard_normal(count)
    ring = np.exp(-10.0 * t) * np.sin(2.0 * np.pi * 40.0 * t) * (t > 0.01)
    return {"time": t, "force": force, "acc": 30.0 * ring + 0.02 * rng.standard_normal(count)}


def driven(rng, count=256):
    t = np.arange(count) / 500.0
    sweep = np.sin(2.0 * np.pi * (4.0 + 20.0 * t) * t)
    return {"torque": sweep + 0.01 * rng.standard_normal(count), "angle": -8000.0 - np.cumsum(np.cumsum(sweep))}


def frf(rng, count=100):
    f = np.linspace(1.0, 100.0, count)
    s = 2j * np.pi * f
    h = s**2 / (3.0 * s**2 + 60.0 * s + 2e5) * (1.0 + 0.01 * rng.standard_normal(count))
    return {"f": f, "h": h, "g": np.full(count, 0.99)}


def save(path, columns):
    """Columns in the format that the path's suffix names."""
    if path.suffix == ".csv":
        rows = zip(*(value.tolist() for value in columns.values()), strict=True)
        text = ",".join(columns) + "\n" + "\n".join(",".join(repr(cell) for cell in row) for row in rows) + "\n"
        path.write_text(text, encoding="utf-8")
    elif path.suffix == ".npz":
        np.savez_compressed(path, **columns)
    else:
        with h5py.File(path, "w") as file:
            for name, values in columns.items():
                file.create_dataset(name, data=values, compression="gzip" if name == "acc" else None)


def sound(folder, suffix, rng):
    """A sound campaign of five runs in files of one kind."""
    folder.mkdir(parents=True)
    more = ('time = "time"', 'time = "time"\ngaps = "mask"', "window = [0.0, 0.4]")
    text = HEAD
    for number, line in enumerate(more):
        text += RUN.format(id=f"hit {number}", file=f"hit-{number}.{suffix}", more=line)
        save(folder / f"hit-{number}.{suffix}", hit(rng))
    text += DRIVEN.format(file=f"driven.{suffix}")
    save(folder / f"driven.{suffix}", driven(rng))
    text += FRF.format(file="frf.npz")
    save(folder / "frf.npz", frf(rng))
    (folder / "campaign.toml").write_text(text, encoding="utf-8")
    return folder
