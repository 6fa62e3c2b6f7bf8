"""The Jetson's I2C bus in the shape of ``busio.I2C``, on smbus2.

Adafruit's drivers ask for ``busio``, which is not to be had on every host;
they use no more of it than the six methods below. Every OSError leaves here
as a BusError that says what the number means.
"""

from __future__ import annotations

import errno
import os
from typing import Any

from dart_hal.errors import BusError
from dart_hal.links.busio import TransferBus

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


class SmbusBus(TransferBus):
    """``/dev/i2c-N`` for Adafruit's drivers and for the opening sequence.

    Not thread-safe by itself: callers take ``try_lock``. Raises BusError.
    """

    def __init__(self, number: int) -> None:
        from smbus2 import SMBus

        self.where = f"/dev/i2c-{number}"
        try:
            self._smbus: Any = SMBus(number)
        except OSError as error:
            raise explain(error, None, self.where) from error

    def close(self) -> None:
        """Close the device; the PCA9685 keeps its last pulses."""
        self._smbus.close()

    def deinit(self) -> None:
        """The name that ``busio`` has for it."""
        self.close()

    def transfer(self, address: int, data: bytes, n: int) -> bytes:
        """One transaction. Raises BusError."""
        from smbus2 import i2c_msg

        read = i2c_msg.read(address, n)
        messages = [i2c_msg.write(address, data)] if data or not n else []
        try:
            self._smbus.i2c_rdwr(*messages, *([read] if n else []))
        except OSError as error:
            raise explain(error, address, self.where) from error
        return bytes(read) if n else b""


def bus_name(bus: object) -> str:
    """How a bus is called in messages: its device, or its class."""
    return os.fspath(getattr(bus, "where", type(bus).__name__))
