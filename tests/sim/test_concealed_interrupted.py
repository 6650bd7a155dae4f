"""A draw that is killed in the middle goes on to the same seal."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time

import pytest

from jointscope.sim.concealed import production
from jointscope.sim.concealed.draw import Order
from jointscope.sim.concealed.seal import folder_digest

ORDER = Order(seed=31, cases=4, kind="nulls", draw="development")


# a driver whose cases are stand-ins: the first time, case 1 kills its process
DYING = """
import os, signal, sys
from pathlib import Path
from jointscope.sim.concealed import production
from jointscope.sim.concealed.draw import Order

def dies(task):
    order, index, folder = task
    mark = Path(folder) / f"seen-{index}"
    if index == 1 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    (Path(folder) / f"made-{index}").write_text(str(order.seed))
    return ""

if __name__ == "__main__":
    production._one = dies
    order = Order(seed=31, cases=4, kind="nulls", draw="development")
    outcomes = list(production._local(order, Path(sys.argv[1]), [0, 1, 2, 3], 2))
    assert outcomes == [""] * 4, outcomes
"""


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals are sent")
def test_a_worker_that_is_killed_is_replaced(tmp_path):
    """The case in flight is made again by new processes; none is missing and none is reported as failed."""
    (tmp_path / "driver.py").write_text(DYING)
    (tmp_path / "out").mkdir()
    words = [sys.executable, str(tmp_path / "driver.py"), str(tmp_path / "out")]
    done = subprocess.run(words, capture_output=True, text=True, timeout=600.0, check=False)
    assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in (tmp_path / "out").glob("made-*")) == [f"made-{i}" for i in range(4)]


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals are sent")
def test_a_killed_draw_is_resumed_to_the_same_seal(tmp_path):
    """SIGKILL to the driver and its workers after the first case: resumed, every byte and the seal are the same."""
    whole = production.produce(ORDER, tmp_path / "whole", 1)
    words = [sys.executable, "-m", "jointscope", "conceal", "--seed", "31", "--cases", "4", "--kind", "nulls",
             "--draw", "development", "--workers", "2", "--out", str(tmp_path / "cut")]  # fmt: skip
    driver = subprocess.Popen(words, start_new_session=True)
    parts = tmp_path / "cut" / production.PARTS
    end = time.monotonic() + 600.0
    while not (parts.is_dir() and list(parts.glob("*.sealed"))):
        assert driver.poll() is None and time.monotonic() < end
        time.sleep(0.05)
    os.killpg(driver.pid, signal.SIGKILL)
    driver.wait()
    done = {file.stem: file.stat().st_mtime_ns for file in parts.glob("*.sealed")}
    assert production.produce(ORDER, tmp_path / "cut", 2) == whole
    assert all((parts / f"{name}.sealed").stat().st_mtime_ns == stamp for name, stamp in done.items())
    for case in (tmp_path / "whole").glob("*/campaign.toml"):
        name = case.parent.name
        assert folder_digest(tmp_path / "cut" / name) == folder_digest(case.parent)
