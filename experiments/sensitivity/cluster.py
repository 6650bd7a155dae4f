"""A Dask cluster on this machine's loopback, for studies that later move to a real one unchanged."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from jointscope.errors import MissingExtraError


@contextmanager
def local_cluster(workers: int) -> Iterator[str]:
    """Yield the scheduler's address (``tcp://127.0.0.1:port``) of ``workers`` single-threaded processes."""
    try:
        from dask.distributed import LocalCluster
    except ImportError:
        raise MissingExtraError("a local Dask cluster", "cluster") from None
    with LocalCluster(  # type: ignore[no-untyped-call]
        n_workers=workers, threads_per_worker=1, host="127.0.0.1", dashboard_address=None, silence_logs=40
    ) as cluster:
        yield cluster.scheduler_address
