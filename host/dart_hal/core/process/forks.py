"""What a forked child must not keep of a program that drives.

A child has every descriptor of its parent: with a worker still alive, the
guard's pipe would not end when the driver dies, and port and lock would stay
taken. Worse, a child that ends would flush and close what is not its own. So
in a child each private file becomes /dev/null, under its old number.
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
    """``file`` is of this process alone from now on, as long as it is open; returns it."""
    _private.add(file)
    return file


def in_child(method: Callable[[], None]) -> None:
    """Call a bound ``method`` in each forked child, while its object lives."""
    _children.add(WeakMethod(method, _children.discard))


class ParentsLock(AbstractContextManager[None]):
    """Stands in a child where the lock of a driving parent was: it cannot be taken."""

    def __enter__(self) -> None:
        raise LinkLost("the car belongs to the process that opened it", found="a forked child",
                       likely="multiprocessing or os.fork() in the middle of a drive",
                       remedy="drive in the parent; let workers send it what they have computed")

    def __exit__(self, *_: object) -> None:
        """Nothing was taken."""


def _let_go() -> None:
    null = os.open(os.devnull, os.O_RDWR)
    for file in list(_private):
        with suppress(OSError, ValueError):  # closed, or a port that is not open
            if (fd := file.fileno()) >= 0:
                os.dup2(null, fd, inheritable=False)
    os.close(null)
    for reference in list(_children):
        if (method := reference()) is not None:
            method()


os.register_at_fork(after_in_child=_let_go)
