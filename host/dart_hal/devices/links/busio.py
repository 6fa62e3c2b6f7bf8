"""The shape of ``busio.I2C`` over one method: a transfer that writes, reads, or both."""

from __future__ import annotations

from abc import ABC, abstractmethod


class TransferBus(ABC):
    """A bus whose kind is in ``transfer`` alone.

    Not thread-safe by itself: callers take ``try_lock``. Methods raise what
    ``transfer`` raises, an OSError or BusError.
    """

    _locked = False

    @abstractmethod
    def transfer(self, address: int, data: bytes, n: int) -> bytes:
        """Write ``data`` if there is any, then read ``n`` bytes; a STOP ends it."""

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
        """Write, repeated START, read: the way to read a register."""
        place = range(len(in_buffer))[in_start:in_end]
        data = bytes(out_buffer[out_start:out_end])
        in_buffer[place.start:place.stop] = self.transfer(address, data, len(place))
