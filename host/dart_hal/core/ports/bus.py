"""The protocol of an I2C bus, and the meaning of its errors.

Drivers convert every OSError of a transfer to a BusError with cause and remedy.
"""

from __future__ import annotations

import errno
import os
from typing import Protocol, runtime_checkable

from dart_hal.core.errors import BusError

# Error numbers by which drivers report a missing acknowledge.
NACK = (errno.EREMOTEIO, errno.ENXIO, errno.EIO)

# (description, likely cause) by error number.
_MEANING = {
    errno.EREMOTEIO: ("no device acknowledged the address or a byte",
                      "wrong address (decimal 40 for 0x40), wrong bus, loose jumper, no power"),
    errno.ENXIO: ("no device acknowledged the address", "wrong address, wrong bus or no power"),
    errno.EIO: ("the transfer was interrupted", "loose jumper, or wires too long for the clock"),
    errno.ETIMEDOUT: ("the bus did not become free", "SDA or SCL stays low: a part without power, "
                      "or a slave stopped in the middle of a byte"),
    errno.EAGAIN: ("arbitration was lost", "a second master, or noise on the wires"),
    errno.EBUSY: ("a kernel driver uses that address", "unbind the driver from the device tree"),
    errno.ENOENT: ("there is no such bus", "another bus number, or I2C is switched off"),
    errno.EACCES: ("this user has no permission to open the bus",
                   "the user is not in the group i2c"),
}
_REMEDY = {
    errno.ENOENT: "ls /dev/i2c-* ; then set [pwm] bus in car.toml",
    errno.EACCES: "sudo usermod -aG i2c $USER ; then log in again",
}


def explain(error: OSError, address: int | None, where: str) -> BusError:
    """Convert an OSError of an I2C transfer to a BusError with cause and remedy."""
    if isinstance(error, BusError):
        return error
    what, likely = _MEANING.get(error.errno or 0, (str(error), ""))
    target = f"{address:#04x} on {where}" if address is not None else where
    named = BusError(f"I2C {target}: {what}", found=f"Errno {error.errno}", likely=likely,
                     remedy=_REMEDY.get(error.errno or 0, ""))
    named.errno = error.errno
    return named


@runtime_checkable
class Bus(Protocol):
    """The methods of ``busio.I2C`` that Adafruit's drivers use."""

    def try_lock(self) -> bool: ...
    def unlock(self) -> None: ...
    def scan(self) -> list[int]: ...
    def writeto(self, address: int, buffer: bytes, *, start: int = 0,
                end: int | None = None) -> None: ...
    def readfrom_into(self, address: int, buffer: bytearray, *, start: int = 0,
                      end: int | None = None) -> None: ...
    def writeto_then_readfrom(self, address: int, out_buffer: bytes, in_buffer: bytearray, *,
                              out_start: int = 0, out_end: int | None = None,
                              in_start: int = 0, in_end: int | None = None) -> None: ...


def bus_name(bus: object) -> str:
    """Return the name of a bus in messages: its device, else its class."""
    return os.fspath(getattr(bus, "where", type(bus).__name__))
