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

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from jointscope.cli import main as jointscope
from jointscope.errors import JointscopeError
from jointscope.recordings.reader import read_campaign

sys.path.insert(0, str(Path(__file__).parent))
from campaign_damage import damage  # type: ignore[import-not-found]
from sound_campaign import sound  # type: ignore[import-not-found]

SECONDS = 20.0
MEMORY = 4 * 2**30

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
