"""Damaged campaigns: whatever happened to the files, they are read right or refused in one clear line.

The quick part runs with the tests. The long one, with counts:

    python tests/recordings/test_fuzz.py --cases 10000 --seed 0

Never a traceback, a warning, a hang (20 s of processor time, 4 GB) or a half-written result.
"""

import argparse
import contextlib
import io
import json
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
import warnings
from collections import Counter
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from jointscope.cli import main as jointscope
from jointscope.errors import JointscopeError
from jointscope.recordings.reader import read_campaign

SECONDS = 20.0
MEMORY = 4 * 2**30

# ---- sound campaigns to start from ----------------------------------------------------------------------------------

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


# ---- damage ---------------------------------------------------------------------------------------------------------

ODD_TEXTS = [
    "",
    " ",
    "\x00",
    "\u202e",
    "ß" * 300,
    "../x",
    "/etc/passwd",
    "a" * 5000,
    "ﬀ😀",
    "nan",
    "%s%n",
    "\\",
    "'",
    '"',
    "N",
]
ODD_NUMBERS = [
    "nan",
    "inf",
    "-inf",
    "0",
    "-1",
    "1e308",
    "1e-308",
    "-0.0",
    "9" * 400,
    "9" * 5000,
    "1_0",
    "0x10",
    "1e400",
    "64",
]
ODD_VALUES = [*ODD_NUMBERS, "true", "[]", "{}", "[[1]]", '["a"]', "1979-05-27", "07:32:00", '"unknown"', '""', "[1.0, 2.0, 3.0]",
              '{ a = { b = { c = 1 } } }', "[nan, 1.0]", "[0.3, 0.1]", "'text'", '"""x\ny"""', "[" * 3000,
              "[" * 90 + "]" * 90]  # fmt: skip
ODD_CELLS = ["", "nan", "inf", "-inf", "1e400", "oops", "1;2", '"', '"1', "0x1p3", "1,5", "٣", "1j", "9" * 5000,
             " 1 ", "--1", "1e", "\x00",
             "x" * 200_000, "-"]  # fmt: skip


def damage_bytes(data, rng):
    """Truncated, flipped, cut out, doubled, filled, or wrapped."""
    if not data:
        return bytes(rng.integers(0, 256, 20, dtype=np.uint8))
    a, b = sorted(int(x) for x in rng.integers(0, len(data) + 1, 2))
    b = min(b, a + 400)
    noise = bytes(rng.integers(0, 256, int(rng.integers(1, 60)), dtype=np.uint8))
    flipped = bytearray(data)
    for at in rng.integers(0, len(data), int(rng.integers(1, 12))):
        flipped[at] ^= 1 << int(rng.integers(0, 8))
    ways = [
        data[:a], data[a:], bytes(flipped), data[:a] + data[b:], data[:b] + data[a:], data[:a] + noise + data[a:], b"",
        data[:a] + bytes(b - a) + data[b:], b"\xef\xbb\xbf" + data, data.replace(b"\n", b"\r\n"), data.replace(b"\n", b"\r"),
        data + data, b"\xff\xfe" + data.decode("latin-1").encode("utf-16-le"), data.replace(b" ", b"\xc2\xa0"), noise,
        data.replace(b"\n", b"\n\n"), data + b"\x00" * 100, data.replace(b"0", b"9", 5),
    ]  # fmt: skip
    return ways[int(rng.integers(len(ways)))]


def damage_toml(text, rng):
    """A line dropped, doubled, moved, its key or value replaced, or nested too deep."""
    lines = text.split("\n")
    at = int(rng.integers(len(lines)))
    way = int(rng.integers(9))
    value = ODD_VALUES[int(rng.integers(len(ODD_VALUES)))]
    if rng.random() < 0.3:
        value = json.dumps(ODD_TEXTS[int(rng.integers(len(ODD_TEXTS)))])
    if way == 0:
        del lines[at]
    elif way == 1:
        lines.insert(at, lines[int(rng.integers(len(lines)))])
    elif way in (2, 3, 4):
        equal = [k for k, line in enumerate(lines) if "=" in line]
        at = equal[int(rng.integers(len(equal)))] if equal else at
        if "{" in lines[at]:
            parts = lines[at].split("=")
            k = int(rng.integers(1, len(parts)))
            head, comma, tail = parts[k].partition(",")
            parts[k] = f" {value}" + (" }," if not tail and "}" in head else comma + tail)
            lines[at] = "=".join(parts)
        else:
            lines[at] = lines[at].split("=")[0] + "= " + value
    elif way == 5:
        lines[at] = lines[at].replace("column", "colunm").replace("file", "fi le").replace("r", "R", 1)
    elif way == 6:
        lines.insert(at, f"extra = {value}")
    elif way == 7:
        lines.insert(at, "a." * int(rng.integers(1, 2500)) + f"b = {value}")
    else:
        lines.insert(at, f"[[run{'.stream' * int(rng.integers(0, 3))}]]")
    return "\n".join(lines)


def damage_csv(text, rng):
    """Cells, columns and lines that are not what they should be."""
    lines = text.split("\n")
    at = int(rng.integers(len(lines)))
    cells = lines[at].split(",")
    way = int(rng.integers(10))
    if way < 4:
        cells[int(rng.integers(len(cells)))] = ODD_CELLS[int(rng.integers(len(ODD_CELLS)))]
        lines[at] = ",".join(cells)
    elif way == 4:
        lines = [",".join(line.split(",")[1:]) for line in lines]
    elif way == 5:
        lines[0] = ",".join(rng.permutation(np.array(lines[0].split(","))).tolist())
    elif way == 6:
        lines = [line.replace(",", ";").replace(".", ",") for line in lines]
    elif way == 7:
        jump = float(10.0 ** rng.uniform(-4, 15))
        lines[at:] = [
            f"{_number(line.split(',')[0]) + jump!r},{','.join(line.split(',')[1:])}" for line in lines[at:]
        ]
    elif way == 8:
        lines.insert(at, lines[at])
    else:
        lines = lines[: int(rng.integers(0, 80))]
    return "\n".join(lines)


def _number(text):
    try:
        return float(text)
    except ValueError:
        return 0.0


def damage_columns(columns, rng):
    """Arrays of a wrong kind, shape, length or size."""
    name = list(columns)[int(rng.integers(len(columns)))]
    x = np.asarray(columns[name])
    odd = np.array(x, dtype=complex if np.iscomplexobj(x) else float)
    odd[int(rng.integers(x.size))] = [np.nan, np.inf, 1e300, -1e-320, 0.0][int(rng.integers(5))]
    ways = [
        x[: int(rng.integers(x.size))], x.reshape(-1, 2) if x.size % 2 == 0 else x, x[None, None], np.array(3.0), np.array([]),
        x.astype(str), x.real.astype(np.float16), x.real.astype(np.int8), x.real > 0, x * 1j, odd, np.full(x.shape, np.nan),
        np.zeros(x.shape), x * 1e300, x[::-1], np.array([{"a": 1}] * 3, dtype=object), np.concatenate([x, x]),
        np.zeros(x.size, dtype=[("a", float)]), x.real.astype("datetime64[s]") if False else x.real.astype(">f8"),
    ]  # fmt: skip
    changed = dict(columns)
    changed[name] = ways[int(rng.integers(len(ways)))]
    if rng.random() < 0.15:
        changed = {("x" * 300 if key == name else key): value for key, value in changed.items()}
    if rng.random() < 0.15:
        del changed[next(iter(changed))]
    return changed


def damage(folder, rng):
    """Damage a campaign in place, in one to three ways; returns what was touched."""
    touched = []
    for _ in range(int(rng.integers(1, 4))):
        files = sorted(path for path in folder.iterdir() if path.is_file())
        toml = folder / "campaign.toml"
        path = toml if rng.random() < 0.45 and toml in files else files[int(rng.integers(len(files)))]
        touched.append(path.name)
        data = path.read_bytes()
        plain = rng.random() < 0.4
        try:
            if path.suffix == ".toml" and not plain:
                path.write_text(damage_toml(data.decode(), rng), encoding="utf-8", errors="surrogatepass")
            elif path.suffix == ".csv" and not plain:
                path.write_text(damage_csv(data.decode(), rng), encoding="utf-8", newline="")
            elif path.suffix == ".npz" and not plain:
                with np.load(io.BytesIO(data)) as held:
                    columns = {key: held[key] for key in held}
                np.savez(path, **damage_columns(columns, rng))
            elif path.suffix == ".h5" and not plain:
                _damage_h5(path, rng)
            else:
                path.write_bytes(damage_bytes(data, rng))
        except Exception:  # an earlier damage left nothing to change
            path.write_bytes(damage_bytes(data, rng))
    return touched


def _damage_h5(path, rng):
    with h5py.File(path, "r") as file:
        columns = {key: file[key][()] for key in file}
    changed = damage_columns(columns, rng)
    with h5py.File(path, "w") as file:
        for name, values in changed.items():
            if values.dtype.kind in "OU":
                file.create_dataset(name, data=[str(value) for value in values.ravel()])
            else:
                file.create_dataset(name, data=values)
        name = next(iter(changed), "acc")
        way = int(rng.integers(6))
        if way == 0 and name in file:
            del file[name]
            file[name] = h5py.SoftLink("/nowhere")
        elif way == 1 and name in file:
            del file[name]
            file[name] = h5py.ExternalLink("nowhere.h5", "/x")
        elif way == 2:
            file.create_group("group")["loop"] = h5py.SoftLink("/group")
        elif way == 3 and name in file:
            file[name].attrs["sampling_rate"] = [float("nan"), 1e300, 0.0, 1024.0][int(rng.integers(4))]
        elif way == 4 and name in file:
            del file[name]
            file.create_dataset(name, shape=(10**12,), dtype=float, chunks=(1024,))


# ---- what may come of it --------------------------------------------------------------------------------------------


@contextlib.contextmanager
def limited(seconds):
    """Stop what uses up its processor time: that is a hang."""

    def stop(number, frame):
        raise HangError(f"more than {seconds:g} s of processor time")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


class HangError(BaseException):
    """Not an Exception: nothing on the way may swallow it."""


def clear_line(problem):
    """Whether an error is one line that says something and names a file."""
    line = str(problem)
    return "\n" not in line and "\r" not in line and 10 < len(line) < 2500 and line.isprintable()


def read(folder):
    """``read`` or ``refused``; anything else is raised."""
    with warnings.catch_warnings(), limited(SECONDS):
        warnings.simplefilter("error")
        try:
            campaign = read_campaign(folder, missing_outputs="allow")
        except JointscopeError as problem:
            assert clear_line(problem), repr(str(problem))
            return None, "refused"
    for run in campaign.runs:
        for one in run.signals:
            if one.channel.samples is not None:
                assert one.channel.samples.shape == (one.stream.length,)
                assert not np.isinf(one.channel.samples).any()
                assert one.stream.gaps == "mask" or np.isfinite(one.channel.samples).all()
    return campaign, "read"


def command(words, out):
    """A command's exit code, after checking what it said and wrote."""
    said, complaint = io.StringIO(), io.StringIO()
    with warnings.catch_warnings(), contextlib.redirect_stdout(said), contextlib.redirect_stderr(complaint):
        warnings.simplefilter("error")
        with limited(6 * SECONDS):
            code = jointscope(words)
    lines = [line for line in complaint.getvalue().splitlines() if line.startswith("jointscope ")]
    assert code in (0, 1, 2), code
    assert code != 2 or (len(lines) == 1 and clear_line(lines[0])), complaint.getvalue()
    for path in out.rglob("*") if out.exists() else ():
        assert ".tmp" not in path.name, path
        if path.suffix == ".json":
            json.loads(path.read_text(), parse_constant=lambda name: pytest.fail(f"a result holds {name}"))
    return code


COMMANDS = ("inspect", "identify", "prepare", "predict")


def use(name, folder, out):
    """Put a damaged campaign that was read through a command."""
    if name == "prepare":
        from jointscope.diagnosis.prepare import prepare

        with warnings.catch_warnings(), limited(6 * SECONDS):
            warnings.simplefilter("error")
            try:
                prepare(read_campaign(folder))
            except JointscopeError as problem:
                assert clear_line(problem), repr(str(problem))
                return 2
        return 0
    if name == "predict":
        model = out.with_suffix(".model.json")
        model.write_text(json.dumps(MODEL))
        return command(["predict", str(model), str(folder), "--out", str(out), "--no-pictures"], out)
    extra = ["--out", str(out), "--no-pictures"] if name == "identify" else ["--json"]
    return command([name, str(folder), *extra], out)


MODEL = {
    "format": "jointscope-model/1", "kind": "base",
    "rig": {"topology": "two-inertia", "motion": "rotational", "plane": "vertical", "reduction_ratio": 141.0,
            "arm_mass": 12.0, "arm_com_radius": 0.5},
    "joint": {"stiffness": 193665.0, "damping": 59.76, "load_inertia": 3.02, "motor_inertia": 1.73e-4,
              "reducer_inertia": 2.85e-4, "reduction_ratio": 141.0, "motor_damping": 2.0, "load_damping": 2.0,
              "efficiency": 0.7},
    "parameters": [], "covariance": [], "terms": [], "input_unit": "N m",
}  # fmt: skip


# ---- tests ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def campaigns(tmp_path_factory):
    rng = np.random.default_rng(1)
    folder = tmp_path_factory.mktemp("sound")
    return {suffix: sound(folder / suffix, suffix, rng) for suffix in ("csv", "npz", "h5")}


@pytest.mark.parametrize("suffix", ["csv", "npz", "h5"])
def test_undamaged_they_are_read_and_used(campaigns, suffix, tmp_path):
    """Negative control: what the damage starts from is sound, for every command that the damaged ones meet."""
    assert read(campaigns[suffix])[1] == "read"
    for name in ("inspect", "predict"):
        (tmp_path / name).mkdir()
        assert use(name, campaigns[suffix], tmp_path / name / "out") == 0


@settings(max_examples=120, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(seed=st.integers(0, 2**32 - 1), suffix=st.sampled_from(("csv", "npz", "h5")))
def test_damaged_they_are_read_or_refused_in_a_line(campaigns, tmp_path_factory, seed, suffix):
    """Hypothesis shrinks to the smallest seed; the damage itself is drawn from it."""
    folder = tmp_path_factory.mktemp("damaged") / "campaign"
    shutil.copytree(campaigns[suffix], folder)
    damage(folder, np.random.default_rng(seed))
    try:
        read(folder)
    finally:
        shutil.rmtree(folder.parent)


@settings(max_examples=150, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(text=st.one_of(st.text(max_size=200), st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=8),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=8), inner, max_size=3), max_leaves=8,
).map(repr)))  # fmt: skip
def test_any_text_as_a_value_is_refused_in_a_line(small, text):
    """Whatever stands behind a key of the file."""
    file = small / "campaign.toml"
    sound_text = file.read_text()
    file.write_text(sound_text.replace("141.0", text, 1), encoding="utf-8")
    try:
        read(small)
    finally:
        file.write_text(sound_text)


FIXED = {
    "a number of five thousand digits": ("141.0", "9" * 5000),
    "a number beyond doubles": ("141.0", "9" * 400),
    "nesting without end": ("141.0", "[" * 5000),
    "dotted keys without end": ('title = "bench"', "a." * 4000 + "b = 1"),
    "a NUL in a file name": ('"a.csv"', '"a\\u0000.csv"'),
    "a file name that no disk takes": ('"a.csv"', '"' + "a" * 5000 + '"'),
    "a folder as data file": ('"a.csv"', '"."'),
    "a rate beyond reason": ("1024.0", "1e300\nwindow = [0.0, 1e300]"),
    "control characters in a name": ('"force", quantity', '"\\u001b[31m\\n", quantity'),
}


@pytest.mark.parametrize("name", FIXED)
def test_what_once_broke_stays_mended(small, name):
    old, new = FIXED[name]
    text = (small / "campaign.toml").read_text()
    assert old in text
    (small / "campaign.toml").write_text(text.replace(old, new, 1))
    assert read(small)[1] == "refused"


# ---- the long run ---------------------------------------------------------------------------------------------------


def main(arguments=None):
    """Ten thousand damaged campaigns, counted; exit code 1 where one of them broke something."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", type=int, default=10_000)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--every", type=int, default=10, help="put every so many of those that are read through a command"
    )
    options = parser.parse_args(arguments)
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    counts, broken, began = Counter(), Counter(), time.monotonic()
    with tempfile.TemporaryDirectory() as scratch:
        base = Path(scratch)
        campaigns = [sound(base / "sound" / s, s, np.random.default_rng(1)) for s in ("csv", "npz", "h5")]
        for case in range(options.cases):
            rng = np.random.default_rng([options.seed, case])
            folder, out = base / "damaged", base / "out"
            for path in (folder, out):
                shutil.rmtree(path, ignore_errors=True)
            shutil.copytree(campaigns[int(rng.integers(3))], folder)
            touched = damage(folder, rng)
            doing = "read"
            try:
                campaign, said = read(folder)
                counts[said] += 1
                if campaign is not None and counts["read"] % options.every == 0:
                    doing = COMMANDS[(counts["read"] // options.every) % len(COMMANDS)]
                    counts[f"{doing}: exit code {use(doing, folder, out)}"] += 1
            except (Exception, HangError, pytest.fail.Exception) as problem:
                frames = traceback.extract_tb(problem.__traceback__)
                own = [f for f in frames if "jointscope" in f.filename or "/recordings/" in f.filename] or frames
                place = f"{Path(own[-1].filename).name}:{own[-1].lineno}"
                key = f"{doing}: {type(problem).__name__} at {place}: {' '.join(str(problem).split())[:100]}"
                if not broken[key]:
                    print(f"case {case} ({', '.join(touched)}): {key}", file=sys.stderr, flush=True)
                broken[key] += 1
            if (case + 1) % 500 == 0:
                print(
                    f"{case + 1} of {options.cases}, {time.monotonic() - began:.0f} s: {dict(counts)}",
                    file=sys.stderr,
                )
    print(f"{options.cases} damaged campaigns, seed {options.seed}, {time.process_time():.0f} s of processor time")
    for name, count in sorted(counts.items()):
        print(f"  {name:28} {count:6}")
    print(f"  tracebacks, warnings, hangs or half-written files: {sum(broken.values())}")
    for key, count in broken.most_common():
        print(f"    {count:5}  {key}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main())
