"""Who drives: the process that holds the lock on a car's serial port.

Every program of ours locks the port that it opens (``exclusive``), and the
kernel lists all locks for everybody. So a driver is seen without opening the
port, which would reset the Nano, and a killed one is gone at once.
"""

from __future__ import annotations

import os
from pathlib import Path

from dart_hal.errors import PortMissing
from dart_hal.links.base import Url
from dart_hal.links.serial_port import find_port

LOCKS = Path("/proc/locks")


def port_of(url: Url) -> str | None:
    """The serial port that a URL names; None = it is not plugged in."""
    if url.scheme != "hwgrep":
        return url.target
    try:
        return find_port(url.target)
    except PortMissing:
        return None


def holder(device: str, locks: Path = LOCKS) -> int | None:
    """Process id of who holds the port ``device``; None = nobody does.

    0: one whose number the kernel does not tell, as of another container.
    """
    try:
        node = os.stat(device)
    except OSError:
        return None
    return parse_locks(locks.read_text(encoding="ascii"), node.st_dev, node.st_ino)


def parse_locks(text: str, device: int, inode: int) -> int | None:
    """The owner of a whole-file lock in the text of /proc/locks.

    ``1: FLOCK  ADVISORY  WRITE 4711 00:06:1234 0 EOF``: process, then major
    and minor number of the file system in hexadecimal and the file's inode.
    Lines of waiting processes carry an arrow behind the number.
    """
    wanted = f"{os.major(device):02x}:{os.minor(device):02x}:{inode}"
    for line in text.splitlines():
        words = line.split()
        if words[1:2] == ["FLOCK"] and words[5:6] == [wanted]:
            return int(words[4])
    return None
