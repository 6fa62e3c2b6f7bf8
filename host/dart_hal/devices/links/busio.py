"""The interface of ``busio.I2C``, based on one method: a transfer that writes, reads, or both."""

from __future__ import annotations

from abc import ABC, abstractmethod


class TransferBus(ABC):
    """An I2C bus; subclasses implement ``transfer``.

    Not thread-safe by itself: callers use ``try_lock``. Methods raise what ``transfer`` raises, an
    OSError or BusError.
    """

    _locked = False

    @abstractmethod
    def transfer(self, address: int, data: bytes, n: int) -> bytes:
        """Write ``data`` if it is not empty, then read ``n`` bytes, then send STOP."""

    def try_lock(self) -> bool:
        """Lock the bus; return False if it is already locked."""
        if self._locked:
            return False
        self._locked = True
        return True

    def unlock(self) -> None:
        """Unlock the bus."""
        self._locked = False

    def scan(self) -> list[int]:
        """Return the addresses that acknowledge a one-byte read."""
        found = []
        for address in range(0x08, 0x78):
            try:
                self.transfer(address, b"", 1)
            except OSError:
                continue
            found.append(address)
        return found

    def writeto(self, address: int, buffer: bytes, *, start: int = 0,
                end: int | None = None) -> None:
        """Write ``buffer[start:end]``."""
        self.transfer(address, bytes(buffer[start:end]), 0)

    def readfrom_into(self, address: int, buffer: bytearray, *, start: int = 0,
                      end: int | None = None) -> None:
        """Fill ``buffer[start:end]`` with bytes read from ``address``."""
        place = range(len(buffer))[start:end]
        buffer[place.start:place.stop] = self.transfer(address, b"", len(place))

    def writeto_then_readfrom(self, address: int, out_buffer: bytes, in_buffer: bytearray, *,
                              out_start: int = 0, out_end: int | None = None,
                              in_start: int = 0, in_end: int | None = None) -> None:
        """Write, send a repeated START, and read, as for reading a register."""
        place = range(len(in_buffer))[in_start:in_end]
        data = bytes(out_buffer[out_start:out_end])
        in_buffer[place.start:place.stop] = self.transfer(address, data, len(place))
