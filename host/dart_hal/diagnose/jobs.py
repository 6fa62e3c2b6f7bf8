"""Work on several cores, where there is enough of it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from typing import TypeVar

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


def each(work: Callable[[Item], Result], items: Sequence[Item], jobs: int) -> Iterator[Result]:
    """What work makes of each item, in any order; what it makes must not depend on the others."""
    if jobs == 1 or len(items) < 2:
        yield from map(work, items)
        return
    from joblib import Parallel, delayed

    parts = Parallel(n_jobs=jobs, return_as="generator")(
        delayed(_some)(work, items[i::PARTS]) for i in range(min(PARTS, len(items))))
    for part in parts:
        yield from part


def _some(work: Callable[[Item], Result], items: Sequence[Item]) -> list[Result]:
    return [work(item) for item in items]
