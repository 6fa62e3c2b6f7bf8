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


class SmbusBus:
    """``/dev/i2c-N`` for Adafruit's drivers and for the opening sequence.

    Not thread-safe by itself: callers take ``try_lock``. Raises BusError.
    """

    def __init__(self, number: int) -> None:
        from smbus2 import SMBus

        self.where = f"/dev/i2c-{number}"
        self._locked = False
        try:
            self._smbus: Any = SMBus(number)
        except OSError as error:
            raise explain(error, None, self.where) from error

    def try_lock(self) -> bool:
        """Take the bus; False when it is taken."""
        if self._locked:
            return False
        self._locked = True
        return True

    def unlock(self) -> None:
        """Give the bus back."""
        self._locked = False

    def scan(self) -> list[int]:
        """Addresses that acknowledge a one-byte read."""
        found = []
        for address in range(0x08, 0x78):
            try:
                self.readfrom_into(address, bytearray(1))
            except BusError:
                continue
            found.append(address)
        return found

    def writeto(self, address: int, buffer: bytes, *, start: int = 0,
                end: int | None = None) -> None:
        """Write ``buffer[start:end]`` and a STOP."""
        from smbus2 import i2c_msg

        self._transfer(address, i2c_msg.write(address, bytes(buffer[start:end])))

    def readfrom_into(self, address: int, buffer: bytearray, *, start: int = 0,
                      end: int | None = None) -> None:
        """Fill ``buffer[start:end]`` with bytes read from ``address``."""
        from smbus2 import i2c_msg

        place = range(len(buffer))[start:end]
        message = i2c_msg.read(address, len(place))
        self._transfer(address, message)
        buffer[place.start:place.stop] = bytes(message)

    def writeto_then_readfrom(self, address: int, out_buffer: bytes, in_buffer: bytearray, *,
                              out_start: int = 0, out_end: int | None = None,
                              in_start: int = 0, in_end: int | None = None) -> None:
        """Write, repeated START, read: the way to read a register."""
        from smbus2 import i2c_msg

        place = range(len(in_buffer))[in_start:in_end]
        read = i2c_msg.read(address, len(place))
        self._transfer(address, i2c_msg.write(address, bytes(out_buffer[out_start:out_end])), read)
        in_buffer[place.start:place.stop] = bytes(read)

    def close(self) -> None:
        """Close the device; the PCA9685 keeps its last pulses."""
        self._smbus.close()

    def deinit(self) -> None:
        """The name that ``busio`` has for it."""
        self.close()

    def _transfer(self, address: int, *messages: Any) -> None:
        try:
            self._smbus.i2c_rdwr(*messages)
        except OSError as error:
            raise explain(error, address, self.where) from error


def bus_name(bus: object) -> str:
    """How a bus is called in messages: its device, or its class."""
    return os.fspath(getattr(bus, "where", type(bus).__name__))
