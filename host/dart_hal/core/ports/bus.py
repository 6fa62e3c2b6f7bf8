"""The I2C bus: its shape, and what its errors mean.

Every OSError of a transfer leaves the rooms as a BusError that says so.
"""

from __future__ import annotations

import errno
import os
from typing import Protocol, runtime_checkable

from dart_hal.core.errors import BusError

NACK = (errno.EREMOTEIO, errno.ENXIO, errno.EIO)
"""Error numbers with which drivers report a missing acknowledge."""

_MEANING = {
    errno.EREMOTEIO: ("nobody acknowledged the address or a byte",
                      "wrong address (decimal 40 for 0x40), wrong bus, loose jumper, no power"),
    errno.ENXIO: ("nobody acknowledged the address", "wrong address, wrong bus or no power"),
    errno.EIO: ("the transfer broke off", "loose jumper, or wires too long for the clock"),
    errno.ETIMEDOUT: ("the bus did not become free", "SDA or SCL held low: a part without power, "
                      "or a slave stopped in the middle of a byte"),
    errno.EAGAIN: ("arbitration was lost", "a second master, or noise on the wires"),
    errno.EBUSY: ("a kernel driver owns that address", "unbind the driver from the device tree"),
    errno.ENOENT: ("there is no such bus", "another bus number, or I2C is switched off"),
    errno.EACCES: ("this user may not open the bus", "the user is not in the group i2c"),
}
_REMEDY = {
    errno.ENOENT: "ls /dev/i2c-* ; then set [pwm] bus in car.toml",
    errno.EACCES: "sudo usermod -aG i2c $USER ; then log in again",
}


def explain(error: OSError, address: int | None, where: str) -> BusError:
    """An OSError of an I2C transfer as a BusError with cause and remedy."""
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
    """The shape of ``busio.I2C`` that Adafruit's drivers use."""

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
    """How a bus is called in messages: its device, or its class."""
    return os.fspath(getattr(bus, "where", type(bus).__name__))
