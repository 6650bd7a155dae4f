"""What the workers of a whole test run share: the compiled joint, half of it each."""

from __future__ import annotations

import os

import pytest

WHOLE = 1000  # tests; fewer may not need the compiled joint at all


@pytest.hookimpl(tryfirst=True)
def pytest_runtestloop(session):
    """Compile this worker's share before its first test, so that no two compile the same."""
    workers = int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1"))
    if workers > 1 and len(session.items) > WHOLE:
        from jointscope.diagnosis.kernel.ahead import compile_ahead

        compile_ahead(int(os.environ["PYTEST_XDIST_WORKER"].removeprefix("gw")), workers)
