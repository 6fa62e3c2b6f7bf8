"""``avr://``: an emulated Nano without a car, in virtual time.

``avr://default`` runs the firmware of this checkout, ``avr://path.elf`` any other image. The rings
turn at the rate of the URL, the IMU is at rest, and there is no I2C bus for commands.
"""

from __future__ import annotations

from collections import deque
from typing import Protocol

from dart_hal.core.errors import LinkLost, UsageError
from dart_hal.core.ports import Chunk, Link
from dart_hal.core.url import Url
from dart_hal.devices.links.base import Backend
from dart_hal.devices.links.emulator import EmulatedNano

# Edges per main-gear revolution of the white ring, both flanks counted.
DEFAULT_EDGES = 20

AVR_OPTIONS = ("wheel", "edges", "clock_error", "baud", "bootloader")


class VirtualNano(Protocol):
    """Methods of a Nano that `VirtualLink` uses; `EmulatedNano` has them."""

    now: float

    def run(self, until: float) -> bool: ...
    def read(self) -> list[tuple[bytes, float]]: ...
    def write(self, data: bytes) -> None: ...
    def close(self) -> None: ...


class VirtualLink(Link):
    """Link and Clock of a Nano whose time passes only while it is read.

    A read ends at each frame delimiter, so the host can answer a frame as soon as its last stop bit
    is on the wire. The Nano does not run beyond a delimiter that was not read yet, unless the host
    sleeps.
    """

    def __init__(self, nano: VirtualNano) -> None:
        self.nano = nano
        self._queue: deque[Chunk] = deque()
        self._open = True

    def read(self, timeout: float) -> Chunk | None:
        """Return the next chunk within ``timeout`` s of virtual time, None = none.

        Raises LinkLost.
        """
        self._check()
        if not self._queue:
            self.nano.run(self.nano.now + max(0.0, timeout))
            self._collect()
        return self._queue.popleft() if self._queue else None

    def write(self, data: bytes) -> None:
        """Put bytes on the line now. Raises LinkLost."""
        self._check()
        self.nano.write(data)

    def close(self) -> None:
        if self._open:
            self._open = False
            self.nano.close()

    def now(self) -> float:
        """Virtual time [s]."""
        return self.nano.now

    def sleep(self, seconds: float) -> None:
        """Let the Nano run; the bytes that it sends are buffered, as in a driver."""
        self._check()
        until = self.nano.now + seconds
        while self.nano.run(until):
            self._collect()
        self._collect()

    def _collect(self) -> None:
        self._queue.extend(Chunk(data, t) for data, t in self.nano.read())

    def _check(self) -> None:
        if not self._open:
            raise LinkLost("the emulated Nano was closed")


def _number(url: Url, name: str, default: float) -> float:
    try:
        return float(url.options.get(name, default))
    except ValueError:
        raise UsageError(f"{name} must be a number", found=url.text) from None


def open_nano(url: Url) -> EmulatedNano:
    """Create the Nano of an ``avr://`` URL. Raises UsageError, EmulatorMissing.

    Options: wheel [rev/s of the main gear, signed], edges (per revolution),
    clock_error, baud (of the host), bootloader=1.
    """
    url.known(*AVR_OPTIONS)
    image = None if url.target in ("", "default") else url.target
    edges = int(_number(url, "edges", DEFAULT_EDGES))
    if edges < 0 or edges % 2:
        raise UsageError("edges must be an even number", found=url.text)
    nano = EmulatedNano(image, clock_error=_number(url, "clock_error", 0.0),
                        host_baud=_number(url, "baud", 500_000.0),
                        bootloader=url.options.get("bootloader", "0") == "1")
    for ring in (0, 1):
        nano.set_ring(ring, [i / edges for i in range(edges)])
    nano.set_wheel(_number(url, "wheel", 0.0))
    return nano


def open_avr(url: Url) -> Backend:
    """Open the backend of ``avr://``: link and clock of the emulated Nano, no bus, no car."""
    link = VirtualLink(open_nano(url))
    return Backend(url=url, link=link, clock=link, bus=None, virtual=True)
