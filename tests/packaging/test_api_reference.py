"""The API reference builds from the docstrings, and a warning of the builder is an error."""

import subprocess
import sys

import pytest


@pytest.mark.slow
def test_the_reference_builds_without_a_warning(tmp_path):
    pytest.importorskip("pdoc", reason="pdoc is not installed: extra [docs]")
    code = (
        "import sys, warnings; from pathlib import Path; import pdoc\n"
        "warnings.filterwarnings('error', category=UserWarning)\n"
        "pdoc.render.configure(docformat='google', math=True)\n"
        "pdoc.pdoc('jointscope', output_directory=Path(sys.argv[1]))\n"
    )
    done = subprocess.run([sys.executable, "-c", code, str(tmp_path)], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr[-3000:]
    for page in ("jointscope.html", "jointscope/models/joint.html", "jointscope/identification/identify.html"):
        assert (tmp_path / page).stat().st_size > 5_000
