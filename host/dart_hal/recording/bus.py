"""A bus that records its transactions."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from dart_hal.core.ports import Bus


class BusRecorder(Protocol):
    """Receiver of transactions (``recording.run.RunWriter``)."""

    def i2c(self, address: int, wrote: bytes, t: float, read: bytes = b"") -> None: ...


class RecordedBus:
    """Passes all calls to a bus and records those that succeed while ``recorder`` is set.

    now: host time [s]. Errors of the bus are raised and not recorded: the transaction did not
    happen.
    """

    def __init__(self, bus: Bus, now: Callable[[], float]) -> None:
        self._bus = bus
        self._now = now
        self.recorder: BusRecorder | None = None

    def try_lock(self) -> bool:
        return self._bus.try_lock()

    def unlock(self) -> None:
        self._bus.unlock()

    def scan(self) -> list[int]:
        return self._bus.scan()

    def writeto(self, address: int, buffer: bytes, *, start: int = 0,
                end: int | None = None) -> None:
        self._bus.writeto(address, buffer, start=start, end=end)
        self._record(address, bytes(buffer[start:end]), b"")

    def readfrom_into(self, address: int, buffer: bytearray, *, start: int = 0,
                      end: int | None = None) -> None:
        self._bus.readfrom_into(address, buffer, start=start, end=end)
        self._record(address, b"", bytes(buffer[start:end]))

    def writeto_then_readfrom(self, address: int, out_buffer: bytes, in_buffer: bytearray, *,
                              out_start: int = 0, out_end: int | None = None,
                              in_start: int = 0, in_end: int | None = None) -> None:
        self._bus.writeto_then_readfrom(address, out_buffer, in_buffer, out_start=out_start,
                                        out_end=out_end, in_start=in_start, in_end=in_end)
        self._record(address, bytes(out_buffer[out_start:out_end]),
                   bytes(in_buffer[in_start:in_end]))

    def _record(self, address: int, wrote: bytes, read: bytes) -> None:
        if self.recorder is not None:
            self.recorder.i2c(address, wrote, self._now(), read)
