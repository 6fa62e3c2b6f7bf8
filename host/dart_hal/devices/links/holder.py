"""Who drives: the process that holds the lock on a car's serial port.

Every program of ours locks the port that it opens (``exclusive``), and the
kernel lists all locks for everybody. So a driver is seen without opening the
port, which would reset the Nano, and a killed one is gone at once.
"""

from __future__ import annotations

from dart_hal.core.errors import PortMissing
from dart_hal.core.process.locks import holder
from dart_hal.core.url import Url
from dart_hal.devices.links.serial_port import find_port

__all__ = ["holder", "port_of"]


def port_of(url: Url) -> str | None:
    """The serial port that a URL names; None = it is not plugged in."""
    if url.scheme != "hwgrep":
        return url.target
    try:
        return find_port(url.target)
    except PortMissing:
        return None
