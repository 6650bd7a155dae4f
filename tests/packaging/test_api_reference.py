"""The API reference builds from the docstrings, and a warning of the builder is an error."""

import subprocess
import sys
from pathlib import Path

import pytest

BUILDER = Path(__file__).resolve().parents[2] / "docs" / "build_reference.py"


@pytest.mark.slow
def test_the_reference_builds_without_a_warning(tmp_path):
    pytest.importorskip("pdoc", reason="pdoc is not installed: extra [docs]")
    done = subprocess.run(
        [sys.executable, str(BUILDER), str(tmp_path)], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr[-3000:]
    for page in ("jointscope.html", "jointscope/models/joint.html", "jointscope/identification/identify.html"):
        assert (tmp_path / page).stat().st_size > 5_000
