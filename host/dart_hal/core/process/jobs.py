"""Run independent computations on several cores by joblib.

Within ``cluster.use_cluster`` they run on the workers of a cluster, with the same results.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Any, TypeVar

# Packets of items for the processes: the data that a process needs are much larger than an item.
DEFAULT_PARTS = 8
# s of driving. Below that, starting processes takes longer than the computation.
MIN_PARALLEL_SECONDS = 300.0
Item = TypeVar("Item")
Result = TypeVar("Result")


def choose_processes(seconds: float) -> int:
    """Return the number of processes for a recording of so many seconds of driving.

    On a cluster that is the number of its workers.
    """
    return cluster_workers() or (cores() if seconds >= MIN_PARALLEL_SECONDS else 1)


def cores() -> int:
    """Return the number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def cluster_workers() -> int:
    """Return the number of workers of the cluster that ``each`` uses now; 0 without one."""
    if "joblib" not in sys.modules:
        return 0
    backend = _cluster_backend()
    if backend is None:
        return 0
    with _report_loss(backend):
        return int(backend.effective_n_jobs(None))


def _cluster_backend() -> Any:
    """Return the backend of joblib if it is that of a cluster, else None."""
    from joblib.parallel import get_active_backend

    backend, _ = get_active_backend()
    return backend if hasattr(backend, "client") else None


def _report_loss(backend: Any) -> AbstractContextManager[None]:
    """Return the context in which a lost cluster raises ClusterFailed."""
    if backend is None:
        return nullcontext()
    from dart_hal.core.process.cluster import report_loss

    return report_loss(backend.client)


def each(work: Callable[[Item], Result], items: Sequence[Item], jobs: int = 1, *,
         parts: int = DEFAULT_PARTS) -> Iterator[Result]:
    """Apply ``work`` to each item; the results are in any order and independent of each other.

    jobs: processes; 1 = this process. On a cluster its workers compute, and ``jobs`` has no effect.
    parts: packets of items; the results of a packet arrive together.
    """
    if jobs == 1 and "joblib" not in sys.modules:  # without joblib there is no backend
        yield from map(work, items)
        return
    from joblib import Parallel, delayed, effective_n_jobs

    n_jobs = None if jobs == 1 else jobs  # None: that of joblib.parallel_config, else 1
    workers = cluster_workers()
    if len(items) < 2 or (workers or effective_n_jobs(n_jobs)) == 1:
        yield from map(work, items)
        return
    # Interleaved packets, so that neighbouring items of similar cost are in different ones.
    parts = min(max(parts, workers), len(items))
    with _report_loss(_cluster_backend()):
        for part in Parallel(n_jobs=n_jobs, return_as="generator")(
                delayed(_some)(work, items[i::parts]) for i in range(parts)):
            yield from part


def start_in_background(work: Callable[..., Result], *given: Any) -> Iterator[Result]:
    """Start ``work(*given)`` in another process; ``next`` waits for its result."""
    from joblib import Parallel, delayed

    # With one job, joblib would work in this process.
    found: Iterator[Result] = Parallel(n_jobs=2, return_as="generator")([delayed(work)(*given)])
    return found


def _some(work: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    """Compute one packet in one process; nested calls of ``each`` stay in it."""
    from joblib import parallel_config

    with parallel_config(backend="sequential"):
        return [work(item) for item in items]
