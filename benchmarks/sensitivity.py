"""What a Sobol study of eight parameters costs: closed form, two Dask workers, and a plain MuJoCo loop, in one run.

    python benchmarks/sensitivity.py [--samples 1024] [--plain 8]

10,240 evaluations of hit and sweep by the closed form, the same through two Dask workers on loopback (compared bit for
bit), and the same evaluations as a user would write them: a Python loop over ``mj_step`` at 4096 Hz, of which a few are
timed. Seconds of processor time are beside those of the clock: on a busy machine only they mean something.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from dataclasses import replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import mujoco
import numpy as np
from numpy.typing import NDArray

from jointscope.experiments.sensitivity import analysis, outputs
from jointscope.experiments.sensitivity.cluster import local_cluster
from jointscope.experiments.sensitivity.engine import evaluate_mujoco
from jointscope.experiments.sensitivity.evaluate import evaluate_sample
from jointscope.experiments.sensitivity.study import OUTPUTS, Study, read_study
from jointscope.models.paper import paper_rig
from jointscope.models.parameters import Joint
from jointscope.models.rig import brake, rig_spec

Array = NDArray[np.float64]
STUDY = Path(__file__).resolve().parents[1] / "docs" / "examples" / "sensitivity" / "study.toml"
RATE = 4096.0  # Hz, of the plain loop
AGREE = 0.02  # relative: what the plain loop at that rate may differ by


def plain_loop(model: mujoco.MjModel, actuator: str, drive: Array) -> Array:
    """The arm's acceleration at the accelerometer [m/s^2], shape of ``drive``: one step after the other."""
    data = mujoco.MjData(model)
    column = model.actuator(actuator).id
    first, second = model.joint("reducer").dofadr[0], -1
    if model.nv == 2:
        second = model.joint("motor").dofadr[0]
    acceleration = np.empty(len(drive))
    for k, value in enumerate(drive):
        data.ctrl[column] = value
        mujoco.mj_step(model, data)
        acceleration[k] = data.qacc[first] + (data.qacc[second] if second >= 0 else 0.0)
    return outputs.ACCELEROMETER_RADIUS * acceleration


def plain(nominal: Joint, names: tuple[str, ...], row: Array) -> tuple[float, float]:
    """Peaks of hit and sweep [m/s^2] by the plain loop."""
    joint = replace(nominal, **dict(zip(names, map(float, row), strict=True)))
    rig = replace(paper_rig(), joint=joint, gravity=0.0, arm_com_radius=0.0, hammer_radius=outputs.HAMMER_RADIUS)
    spec = rig_spec(rig)
    spec.option.timestep = 1.0 / RATE
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    force = outputs.hammer_force(np.arange(int(outputs.HAMMER_RECORD * RATE)) / RATE)
    torque = outputs.sweep_torque(np.arange(int(outputs.SWEEP_RECORD * RATE)) / RATE)
    hit = plain_loop(brake(spec, 0.0).compile(), "hammer", force)
    swept = plain_loop(spec.compile(), "motor", torque)
    return float(np.abs(hit).max()), float(np.abs(swept).max())


def timed_serial(study: Study, sample: Array, folder: Path) -> tuple[Array, float, float]:
    """All evaluations in this process: table, clock [s], processor [s]."""
    clock, used = time.perf_counter(), time.process_time()
    table = evaluate_sample(study, sample, folder, workers=1)
    return table, time.perf_counter() - clock, time.process_time() - used


def main() -> int:
    """Print the figures; 1 where numbers differ or the loop disagrees."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--samples", type=int, default=1024, help="N: N (8 + 2) evaluations (default 1024)")
    parser.add_argument("--plain", type=int, default=8, help="evaluations timed by the plain loop (default 8)")
    options = parser.parse_args()
    study = replace(read_study(STUDY, paper_rig().joint), samples=options.samples)
    sample = analysis.draw(study)
    names = tuple(factor.name for factor in study.factors)
    with tempfile.TemporaryDirectory() as scratch:
        base = Path(scratch)
        serial, clock, used = timed_serial(study, sample, base / "serial")
        print(
            f"{len(sample)} evaluations, closed form, one process: {clock:.1f} s by the clock, {used:.1f} s of processor"
        )
        start = time.perf_counter()
        pooled = evaluate_sample(study, sample, base / "pooled", workers=2)
        print(f"the same by two processes: {time.perf_counter() - start:.1f} s by the clock")
        with local_cluster(2) as address:
            start = time.perf_counter()
            distributed = evaluate_sample(study, sample, base / "dask", scheduler=address)
            print(f"the same by two Dask workers on {address}: {time.perf_counter() - start:.1f} s by the clock")
    same = np.array_equal(serial, pooled) and np.array_equal(serial, distributed)
    print(f"numbers of all three: {'identical to the last bit' if same else 'DIFFERENT'}")

    rows = sample[: options.plain]
    used_plain = time.process_time()
    peaks = np.array([plain(study.nominal, names, row) for row in rows])
    used_plain = (time.process_time() - used_plain) / len(rows)
    used_engine = time.process_time()
    evaluate_mujoco(study.nominal, names, rows)
    used_engine = (time.process_time() - used_engine) / len(rows)
    columns = [list(OUTPUTS).index(name) for name in ("hammer_peak", "sweep_peak")]
    apart = float(np.abs(peaks / serial[: len(rows), columns] - 1.0).max())
    each = used / len(sample)
    print(f"one evaluation, processor time: closed form {1e3 * each:.2f} ms; plain mj_step loop at {RATE:g} Hz "
          f"{1e3 * used_plain:.0f} ms; this tool's MuJoCo engine at 16384 Hz {1e3 * used_engine:.0f} ms")  # fmt: skip
    print(f"plain loop over closed form: {used_plain / each:.0f} times; peaks {100 * apart:.2f} % apart at most")
    return 0 if same and apart <= AGREE else 1


if __name__ == "__main__":
    raise SystemExit(main())
