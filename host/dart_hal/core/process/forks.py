"""Detach forked children from the files of a process that drives.

A child inherits every descriptor of its parent. While it is alive, the guard's pipe would not end
when the driver dies, and port and lock would stay in use. A child that ends would also flush and
close the parent's files. In a child, each private file therefore becomes /dev/null under its old
descriptor.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from contextlib import AbstractContextManager, suppress
from typing import Protocol, TypeVar
from weakref import WeakMethod, WeakSet

from dart_hal.core.errors import LinkLost


class File(Protocol):
    """Anything with a descriptor: a file, a socket, a serial port."""

    def fileno(self) -> int: ...


F = TypeVar("F", bound=File)

_private: WeakSet[File] = WeakSet()
_children: set[WeakMethod[Callable[[], None]]] = set()


def private(file: F) -> F:
    """Detach forked children from ``file`` while it is open; return it."""
    _private.add(file)
    return file


def call_in_children(method: Callable[[], None]) -> None:
    """Call a bound ``method`` in each forked child while its object exists."""
    _children.add(WeakMethod(method, _children.discard))


class ForkedCarLock(AbstractContextManager[None]):
    """Replaces the lock of a driving parent in its children; it cannot be acquired."""

    def __enter__(self) -> None:
        raise LinkLost("the car belongs to the process that opened it", found="a forked child",
                       likely="multiprocessing or os.fork() during a drive",
                       remedy="drive in the parent process; workers send it their results")

    def __exit__(self, *_: object) -> None:
        """Nothing was acquired."""


def _detach() -> None:
    """Replace the private files of a new child by /dev/null, then call its methods."""
    null = os.open(os.devnull, os.O_RDWR)
    for file in list(_private):
        with suppress(OSError, ValueError):  # closed, or a port that is not open
            if (fd := file.fileno()) >= 0:
                os.dup2(null, fd, inheritable=False)
    os.close(null)
    for reference in list(_children):
        if (method := reference()) is not None:
            method()


if hasattr(os, "register_at_fork"):  # Windows has no fork
    os.register_at_fork(after_in_child=_detach)
