"""Claim: the project's gates see what they should. Deliberate breakages of the source, each must turn a gate red.

  python -m jointscope.experiments.gates.mutations gates.toml --out out/mutations

A copy of the package is broken in one place at a time, in its source; ``jointscope gate`` then runs on the copy in a
process of its own. The unbroken copy comes first and must be green. Exit code 0 when every breakage was caught.
"""

from __future__ import annotations

import argparse
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from jointscope.atomic import write_text
from jointscope.errors import InputError
from jointscope.progress import track

GROUPS = ("simulator", "identification", "prediction", "arm", "diagnosis")
SECONDS = 900  # of processor time, for one run of the gates
RECORDED = ("bench", "ideal", "currents")


@dataclass(frozen=True, kw_only=True)
class Mutation:
    """One breakage.

    Attributes:
        what: In words.
        group: Claims that are measured: those of the part that is broken.
        reuse: What need not be made anew for them, as the break can't reach it.
        file: In the package.
        old: Source that must be there exactly once, so that a mutation can't go stale unseen.
        new: What replaces it.
    """

    what: str
    file: str
    old: str
    new: str
    group: str
    reuse: tuple[str, ...] = ()


MUTATIONS = (
    Mutation(
        what="the sign of the motor's torque, in the simulated model",
        file="models/rig.py",
        old="= joint.efficiency * joint.reduction_ratio",
        new="= -joint.efficiency * joint.reduction_ratio",
        group="simulator",
    ),
    Mutation(
        what="the factor n missing from the torque, in the prediction",
        file="prediction/plant.py",
        old='gain=joint.get("efficiency", 1.0) * ratio',
        new='gain=joint.get("efficiency", 1.0)',
        group="prediction",
        reuse=(*RECORDED, "identified"),
    ),
    Mutation(
        what="the rotor's inertia reflected with n instead of n^2",
        file="models/parameters.py",
        old="* self.reduction_ratio**2",
        new="* self.reduction_ratio",
        group="simulator",
    ),
    Mutation(
        what="the reducer's damping c dropped, in the simulated model",
        file="models/rig.py",
        old="reducer.damping[0] = joint.damping",
        new="reducer.damping[0] = 0.0",
        group="simulator",
    ),
    Mutation(
        what="the reducer's damping c dropped, in the prediction's equation",
        file="prediction/integrate.py",
        old="K * (q_s - q) + c * (w_s - w)",
        new="K * (q_s - q)",
        group="prediction",
        reuse=(*RECORDED, "identified"),
    ),
    Mutation(
        what="the accelerometer's axes swapped, in the recording",
        file="sim/recording.py",
        old='{"tangential": 2, "radial": 0}',
        new='{"tangential": 0, "radial": 2}',
        group="simulator",
    ),
    Mutation(
        what="force and acceleration swapped on reading",
        file="identification/hit_spectra.py",
        old="excitation, responses = hammer_excitation(run, rig), arm_responses(run, rig)\n",
        new="excitation, responses = hammer_excitation(run, rig), arm_responses(run, rig)\n"
        "    from dataclasses import replace as swap\n"
        "    first, second = excitation.signal, responses[0].signal\n"
        "    excitation = swap(excitation, signal=second)\n"
        "    responses = [swap(responses[0], signal=first)]\n",
        group="identification",
        reuse=RECORDED,
    ),
    Mutation(
        what="explicit Euler instead of Runge-Kutta, in the prediction",
        file="prediction/integrate.py",
        old="x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)",
        new="x = x + h * k1",
        group="prediction",
        reuse=(*RECORDED, "identified"),
    ),
    Mutation(
        what="MuJoCo's implicit damping instead of the leapfrog, in the simulator",
        file="sim/stepping.py",
        old="spec.option.integrator = mujoco.mjtIntegrator.mjINT_EULER",
        new="spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST",
        group="simulator",
    ),
    Mutation(
        what="the force window's place in the record not accounted for",
        file="identification/hit_spectra.py",
        old="times = excitation.signal.times[contact.window] - zero",
        new="times = excitation.signal.times[contact.window] - excitation.signal.times[contact.window[0]]",
        group="identification",
        reuse=RECORDED,
    ),
    Mutation(
        what="the force window without its flanks",
        file="identification/hits.py",
        old="margin = round(0.15 * (last - first + 1)) + 3",
        new="margin = -((last - first + 1) // 4)",
        group="identification",
        reuse=RECORDED,
    ),
    Mutation(
        what="the sign of gravity, in the prediction's equation",
        file="prediction/integrate.py",
        old="- b_l * w - G * np.cos(q)) / J_L",
        new="- b_l * w + G * np.cos(q)) / J_L",
        group="prediction",
        reuse=(*RECORDED, "identified"),
    ),
    Mutation(
        what="the hit's radius left out",
        file="identification/conditioning.py",
        old='lever = (channel.radius or 1.0) if channel.quantity == "force" and turning else 1.0',
        new="lever = 1.0",
        group="identification",
        reuse=RECORDED,
    ),
    Mutation(
        what="the time step 0.5 % too long, in the prediction",
        file="prediction/integrate.py",
        old="np.array([q_s, w_s, q, w, 0.0]), 1.0 / rate,",
        new="np.array([q_s, w_s, q, w, 0.0]), 1.005 / rate,",
        group="prediction",
        reuse=(*RECORDED, "identified"),
    ),
    Mutation(
        what="the recorded log one sample late, on reading",
        file="recordings/bandlimited.py",
        old="self._spline(inside - self.start, nu=derivative)",
        new="self._spline(inside - self.start - 1.0 / self.rate, nu=derivative)",
        group="prediction",
        reuse=(*RECORDED, "identified"),
    ),
    Mutation(
        what="degrees taken for radians in the accelerometer's gravity",
        file="prediction/sensors.py",
        old="radius * motion.acceleration + gravity * np.cos(motion.angle)",
        new="radius * motion.acceleration + gravity * np.cos(np.degrees(motion.angle))",
        group="prediction",
        reuse=(*RECORDED, "identified"),
    ),
    Mutation(
        what="the currents' amplitude by the power-keeping Clarke transform",
        file="prediction/currents.py",
        old="-2j / 3.0 * (u + v * turn + w * turn**2)",
        new="-1j * math.sqrt(2.0 / 3.0) * (u + v * turn + w * turn**2)",
        group="prediction",
        reuse=(*RECORDED, "identified"),
    ),
    Mutation(
        what="the accelerometer's high-pass omitted, in the prediction",
        file="prediction/sensors.py",
        old="return np.asarray(dsp.lfilter(b, a, values - values[0]))",
        new="return np.asarray(values - values[0])",
        group="prediction",
        reuse=(*RECORDED, "identified"),
    ),
    Mutation(
        what="gravity's stiffness left out of the spring, six-axis arm",
        file="models/arm/linear.py",
        old="K[inner] = reference.gravity_stiffness(posture)",
        new="K[inner] = 0.0 * reference.gravity_stiffness(posture)",
        group="arm",
    ),
    Mutation(
        what="half of a cubic spring's torque, in the diagnosis",
        file="diagnosis/effects/transmission.py",
        old="assembly.P[kernel.K_3] += values[0]",
        new="assembly.P[kernel.K_3] += 0.5 * values[0]",
        group="diagnosis",
        reuse=("plain", "hardening", "arm-sweeps", "arm-diagnosis"),
    ),
    Mutation(
        what="the accelerometer's radius squared, in the diagnosis",
        file="diagnosis/channels.py",
        old="along * (radius * acceleration[k] + g * up)",
        new="along * (radius * radius * acceleration[k] + g * up)",
        group="diagnosis",
        reuse=("plain", "hardening", "arm-sweeps", "arm-diagnosis"),
    ),
    Mutation(
        what="springs a two-hundredth too stiff beside the rotor that sets the scale, in the diagnosis of an arm",
        file="diagnosis/arm/predict.py",
        old="P[:, kernel.STRIBECK_SPEED] = P[:, kernel.SOFT_WIDTH] = 1.0\n",
        new="P[:, kernel.STRIBECK_SPEED] = P[:, kernel.SOFT_WIDTH] = 1.0\n    P[:, kernel.STIFFNESS] *= 1.005\n",
        group="diagnosis",
        reuse=("plain", "hardening", "hardening-diagnosis", "arm-sweeps"),
    ),
)


@dataclass(frozen=True, kw_only=True)
class Caught:
    """What a breakage did.

    Attributes:
        red: Claims that turned red.
        of: How many were measured.
    """

    what: str
    file: str
    red: tuple[str, ...]
    of: int


def copy_package(folder: Path) -> Path:
    """Copy the package's source into ``folder``, links followed; the copy's root."""
    import jointscope

    root = folder / "jointscope"
    shutil.copytree(Path(str(jointscope.__file__)).parent, root, ignore=shutil.ignore_patterns("__pycache__"))
    return root


def broken(root: Path, mutation: Mutation) -> str:
    """The broken source of the mutation's file.

    Raises:
        InputError: The source to be replaced isn't there exactly once.
    """
    path = root / mutation.file
    text = path.read_text(encoding="utf-8")
    if text.count(mutation.old) != 1:
        raise InputError(
            path,
            mutation.what,
            f"{mutation.old!r} is there {text.count(mutation.old)} times",
            fix="mend the mutation",
        )
    return text.replace(mutation.old, mutation.new)


def run_gates(
    root: Path, gates: Path, out: Path, groups: Sequence[str] = GROUPS, reuse: Sequence[str] = ()
) -> Caught:
    """Run the gates with the package at ``root``; which claims are red.

    A run that uses up its processor time, as an endless loop would, counts as one red claim: a CI job stops there too.

    Raises:
        InputError: The package that ran isn't the copy, or no result was written.
    """
    code = (
        "import resource, sys, jointscope\n"
        f"resource.setrlimit(resource.RLIMIT_CPU, ({SECONDS}, {SECONDS}))\n"
        f"assert jointscope.__file__.startswith({str(root)!r}), jointscope.__file__\n"
        "from jointscope.cli import main\n"
        "sys.exit(main(sys.argv[1:]))\n"
    )
    words = ["gate", str(gates), "--out", str(out)]
    words += [word for group in groups for word in ("--group", group)]
    words += [word for name in reuse for word in ("--reuse", name)]
    (out / "gates.json").unlink(missing_ok=True)
    done = subprocess.run(
        [sys.executable, "-c", code, *words],
        env={**os.environ, "PYTHONPATH": str(root.parent), "OMP_NUM_THREADS": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode in (-signal.SIGXCPU, -signal.SIGKILL):
        return Caught(what="", file="", of=1, red=(f"the gates end within {SECONDS} s",))
    if not (out / "gates.json").is_file():
        lines = (done.stderr or done.stdout).strip().splitlines()
        raise InputError(gates, None, f"no result: {lines[-1] if lines else f'exit code {done.returncode}'}")
    rows = json.loads((out / "gates.json").read_text(encoding="utf-8"))["gates"]
    red = tuple(row["claim"] for row in rows if row["status"] != "PASS" and not row["excused"])
    return Caught(what="", file="", red=red, of=len(rows))


def try_mutation(root: Path, mutation: Mutation, gates: Path, control: Path, out: Path) -> Caught:
    """Break the copy, run the gates in ``out`` on what ``control`` made, mend the copy."""
    path = root / mutation.file
    text, times = path.read_bytes(), path.stat()
    path.write_text(broken(root, mutation), encoding="utf-8")
    shutil.rmtree(out, ignore_errors=True)
    for name in mutation.reuse:
        shutil.copytree(control / "made" / name, out / "made" / name)
    try:
        found = run_gates(root, gates, out, (mutation.group,), mutation.reuse)
    finally:
        path.write_bytes(text)
        os.utime(path, ns=(times.st_atime_ns, times.st_mtime_ns))
    return Caught(what=mutation.what, file=mutation.file, red=found.red, of=found.of)


def as_markdown(control: Caught, caught: Sequence[Caught]) -> str:
    """The table: what was broken, and which claims saw it."""
    lines = ["| broken | in | red claims | such as |", "|---|---|---|---|"]
    lines.append(f"| nothing (control) | | {len(control.red)} of {control.of} | {'; '.join(control.red[:2])} |")
    for one in caught:
        red = f"{len(one.red)} of {one.of}" if one.red else f"**none of {one.of}**"
        lines.append(
            f"| {one.what} | `{one.file}` | {red} | {'; '.join(one.red[:2]).replace('|', chr(92) + '|')} |"
        )
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> int:
    """Try every mutation; 0 when the control is green and all are caught."""
    parser = argparse.ArgumentParser(
        prog="python -m jointscope.experiments.gates.mutations",
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter,
    )  # fmt: skip
    parser.add_argument("gates", type=Path, help="gates.toml")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    parser.add_argument("--only", metavar="TEXT", help="only mutations whose description holds this")
    options = parser.parse_args(arguments)
    chosen = [one for one in MUTATIONS if not options.only or options.only in one.what]
    gates = options.gates.resolve()
    with tempfile.TemporaryDirectory() as scratch:
        root = copy_package(Path(scratch).resolve())
        for mutation in chosen:
            broken(root, mutation)  # all must apply before the first is run
        control = run_gates(root, gates, Path(scratch) / "control")
        caught = []
        for mutation in track(chosen, "mutations", len(chosen)):
            caught.append(
                try_mutation(root, mutation, gates, Path(scratch) / "control", Path(scratch) / "mutated")
            )
            print(f"{len(caught[-1].red):3d} red: {mutation.what}", file=sys.stderr, flush=True)
    content = {"control": asdict(control), "mutations": [asdict(one) for one in caught]}
    write_text(options.out / "mutations.json", json.dumps(content, indent=1) + "\n")
    write_text(options.out / "mutations.md", as_markdown(control, caught))
    print(as_markdown(control, caught))
    seen = sum(bool(one.red) for one in caught)
    print(f"{seen} of {len(caught)} caught; control {'red' if control.red else 'green'}")
    return 0 if seen == len(caught) and not control.red else 1


if __name__ == "__main__":
    sys.exit(main())
