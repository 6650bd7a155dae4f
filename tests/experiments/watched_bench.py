"""A bench that is watched: hits of a braked joint in closed form, a template campaign, and what the watch says of it."""

import numpy as np
from scipy.signal import TransferFunction, cont2discrete, decimate, lfilter, ss2tf

from jointscope.experiments.watch.session import Judged, Session, Standing

K, J, C, RATE, FINE = 193665.0, 3.02, 61.76, 1024.0, 8
HEAD = """format = "jointscope-campaign/1"
[rig]
topology = "two-inertia"
motion = "rotational"
plane = "horizontal"
reduction_ratio = 141.0
load_damping = 2.0
"""
RUN = """
[[run]]
id = "{id}"
experiment = "hammer"
brake = true
[[run.stream]]
file = "{file}"
sampling_rate = 1024.0
channels = [
  {{ column = "{prefix}force", quantity = "force", unit = "N", location = "arm", role = "input", radius = 0.8 }},
  {{ column = "{prefix}acc", quantity = "linear-acceleration", unit = "m/s^2", location = "arm", role = "output",
     radius = 0.95, full_scale = 490.0 }},
]
"""


def hit(rng, peak=200.0, *, stiffness=K, second=0.0, seconds=2.0, noise=0.01, sign=1.0, clip=None):
    """Force [N] and tangential acceleration [m/s^2] of a braked joint: the exact response of J q'' + c q' + K q = r F."""
    rate = RATE * FINE
    n = round(seconds * rate)
    t = np.arange(n) / rate
    force = np.zeros(n)
    for start, size in ((0.1, peak), (0.16, second * peak)):
        inside = (t >= start) & (t < start + 0.008)
        force[inside] += size * np.sin(np.pi * (t[inside] - start) / 0.008)
    system = TransferFunction([0.8 / J, 0.0, 0.0], [1.0, C / J, stiffness / J]).to_ss()
    discrete = cont2discrete((system.A, system.B, system.C, system.D), 1.0 / rate, method="foh")
    numerator, denominator = ss2tf(*discrete[:4])
    acc = 0.95 * lfilter(numerator[0], denominator, force)
    force, acc = (decimate(x, FINE, ftype="fir") for x in (force, acc))
    acc = sign * acc + rng.normal(0.0, noise, acc.size)
    if clip is not None:
        acc = np.clip(acc, -clip, clip)
    return force + rng.normal(0.0, 0.1, force.size), acc


def write_csv(path, force, acc):
    path.write_text("force,acc\n" + "\n".join(f"{f:.5f},{a:.6f}" for f, a in zip(force, acc, strict=True)) + "\n")


def bench_in(tmp_path):
    """A template campaign of one hit, and an empty folder that takes arrive in."""
    like, folder = tmp_path / "like", tmp_path / "today"
    like.mkdir()
    folder.mkdir()
    write_csv(like / "first.csv", *hit(np.random.default_rng(0)))
    (like / "campaign.toml").write_text(HEAD + RUN.format(id="first", file="first.csv", prefix=""))
    return like, folder


def judged(events):
    return {event.take.run.id: event.take for event in events if isinstance(event, Judged)}


def standing(events):
    return next(event for event in events if isinstance(event, Standing))


def session(bench, within=0.01):
    like, folder = bench
    return Session(folder, like, within=within)
