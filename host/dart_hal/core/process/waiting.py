"""Wait until a file descriptor can be read or written.

It uses poll: select fails for descriptors from 1024 on, which occur in a program with many open
files or sockets.
"""

from __future__ import annotations

import select


def wait_readable(descriptor: int | None, timeout: float) -> bool:
    """Wait at most ``timeout`` s for bytes, for the end of the file or for an error to be read.

    None: only wait for the time. Raises ValueError for a negative descriptor.
    """
    return _wait(descriptor, select.POLLIN, timeout)


def wait_writable(descriptor: int | None, timeout: float) -> bool:
    """Wait at most ``timeout`` s until bytes are taken, or an error is to be raised by a write."""
    return _wait(descriptor, select.POLLOUT, timeout)


def _wait(descriptor: int | None, event: int, timeout: float) -> bool:
    poll = select.poll()
    if descriptor is not None:
        poll.register(descriptor, event)
    return bool(poll.poll(1e3 * max(timeout, 0.0)))
