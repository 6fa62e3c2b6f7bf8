"""Independent pieces of work on several cores, through joblib alone.

Whoever outgrows one machine changes one line, ``joblib.parallel_config(
backend="dask")``: what is fanned out below it runs on that cluster
(examples/diagnose_on_a_cluster.py), with the same results.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

PARTS = 8  # of the items: what a process needs to know is much more than an item
ENOUGH = 300.0  # s of driving; below that, starting processes takes longer than they save
Item = TypeVar("Item")
Result = TypeVar("Result")


def wanted(seconds: float) -> int:
    """Processes for so many seconds of driving."""
    return cores() if seconds >= ENOUGH else 1


def cores() -> int:
    """Those that this process may run on."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def each(work: Callable[[Item], Result], items: Sequence[Item], jobs: int = 1, *,
         parts: int = PARTS) -> Iterator[Result]:
    """What work makes of each item, in any order; what it makes must not depend on the others.

    jobs: processes; 1 = none but this one, unless joblib was given a backend.
    parts: packets into which the items are divided; their results arrive together.
    """
    if jobs == 1 and "joblib" not in sys.modules:  # nobody has given it a backend
        yield from map(work, items)
        return
    from joblib import Parallel, delayed, effective_n_jobs

    n_jobs = None if jobs == 1 else jobs  # None: what joblib.parallel_config says, else 1
    if len(items) < 2 or effective_n_jobs(n_jobs) == 1:
        yield from map(work, items)
        return
    parts = min(parts, len(items))
    for part in Parallel(n_jobs=n_jobs, return_as="generator")(
            delayed(_some)(work, items[i::parts]) for i in range(parts)):
        yield from part


def beside(work: Callable[..., Result], *given: Any) -> Iterator[Result]:
    """``work(*given)`` in a process that starts now; ``next`` waits for what it makes."""
    from joblib import Parallel, delayed

    # two, for joblib works in this process where there is one
    found: Iterator[Result] = Parallel(n_jobs=2, return_as="generator")([delayed(work)(*given)])
    return found


def _some(work: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    """One packet, in one process: what it fans out itself stays there."""
    from joblib import parallel_config

    with parallel_config(backend="sequential"):
        return [work(item) for item in items]
