"""Which program drives a car: the process that holds the lock on its serial port.

Every program of this package locks the port that it opens (``exclusive``), and the kernel lists all
locks. So the driver is found without opening the port, which would reset the Nano, and the lock of
a killed one disappears at once.
"""

from __future__ import annotations

from dart_hal.core.errors import PortMissing
from dart_hal.core.process.locks import holder
from dart_hal.core.url import Url
from dart_hal.devices.links.serial_port import find_port

__all__ = ["holder", "port_of"]


def port_of(url: Url) -> str | None:
    """Return the serial port of a URL; None = it is not plugged in."""
    if url.scheme != "hwgrep":
        return url.target
    try:
        return find_port(url.target)
    except PortMissing:
        return None
