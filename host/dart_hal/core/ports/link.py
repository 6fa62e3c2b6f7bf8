"""Bytes to and from a Nano, and the clock of the link."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from dart_hal.core.types import Applied


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes of the link and the host time [s] at which the last of them arrived."""

    data: bytes
    t: float


class Link(Protocol):
    """A byte stream to a Nano; also a base class.

    Implementations define read, write and close. The other members have defaults for a link
    without line rate, port or recording.
    """

    rates: tuple[int, ...] = ()
    """Line rates [bit/s] that a Nano may use."""
    device: str = ""
    """Name of the port; "" = there is none."""
    applied: Applied | None = None
    """Output of the pins at the arrival of the newest chunk; None = not recorded."""

    @property
    def baud(self) -> int:
        """Present line rate [bit/s]; 0 = the link has no rate."""
        return 0

    def set_baud(self, baud: int) -> None:
        """Change to another of ``rates``. Raises LinkLost."""
        return

    def ping_sent(self, ping_id: int) -> float | None:
        """Return the host time [s] at which the ping was sent; None = not recorded."""
        return None

    def read(self, timeout: float) -> Chunk | None:
        """Wait up to ``timeout`` s of this backend's clock for bytes; None = no bytes received.

        Returns at the latest at the next frame delimiter in virtual time.
        Raises LinkLost if the device is disconnected.
        """

    def write(self, data: bytes) -> None:
        """Queue bytes and start to send them. Raises LinkLost."""

    def close(self) -> None: ...


class Clock(Protocol):
    """Host time of a backend: monotonic seconds, virtual or real."""

    def now(self) -> float: ...

    def sleep(self, seconds: float) -> None:
        """Wait; in virtual time the simulation advances."""
