"""The computer's I2C bus with the interface of ``busio.I2C``, by smbus2.

Adafruit's drivers use ``busio``, which does not exist for every computer. They use only the methods
of ``TransferBus``.
"""

from __future__ import annotations

import sys
from typing import Any

from dart_hal.core.errors import BusMissing
from dart_hal.core.ports.bus import explain
from dart_hal.devices.links.busio import TransferBus


class SmbusBus(TransferBus):
    """``/dev/i2c-N`` for Adafruit's drivers and for the set-up of the PCA9685.

    Not thread-safe by itself: callers use ``try_lock``. Raises BusError.
    """

    def __init__(self, number: int) -> None:
        self.where = f"/dev/i2c-{number}"
        try:
            from smbus2 import SMBus
        except ModuleNotFoundError as error:  # it imports fcntl
            raise BusMissing(f"there is no {self.where} on this system", found=sys.platform,
                             remedy="drive from the car's Linux computer") from error
        try:
            self._smbus: Any = SMBus(number)
        except OSError as error:
            raise explain(error, None, self.where) from error

    def close(self) -> None:
        """Close the device; the PCA9685 keeps its last pulses."""
        self._smbus.close()

    def deinit(self) -> None:
        """Close the device, by the name of ``busio``."""
        self.close()

    def transfer(self, address: int, data: bytes, n: int) -> bytes:
        """Make one transaction. Raises BusError."""
        from smbus2 import i2c_msg

        read = i2c_msg.read(address, n)
        messages = [i2c_msg.write(address, data)] if data or not n else []
        try:
            self._smbus.i2c_rdwr(*messages, *([read] if n else []))
        except OSError as error:
            raise explain(error, address, self.where) from error
        return bytes(read) if n else b""
