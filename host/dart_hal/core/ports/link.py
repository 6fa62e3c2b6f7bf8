"""Bytes to and from a Nano, and the time in which they travel."""

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
    """A byte stream to a Nano; a base class, too.

    read, write and close are a link's own. The rest has an answer already, that
    of a line without a rate, a port or a past: whoever knows better says so.
    """

    rates: tuple[int, ...] = ()
    """Line rates [bit/s] at which a Nano may be."""
    device: str = ""
    """Name of the port; "" = there is none."""
    applied: Applied | None = None
    """What the pins carried when the newest chunk arrived; None = it was not recorded."""

    @property
    def baud(self) -> int:
        """Line rate now [bit/s]; 0 = the line has none of its own."""
        return 0

    def set_baud(self, baud: int) -> None:
        """Go on at another of ``rates``. Raises LinkLost."""
        return

    def ping_sent(self, ping_id: int) -> float | None:
        """Host time [s] at which that ping had left; None = it was not recorded."""
        return None

    def read(self, timeout: float) -> Chunk | None:
        """Block up to ``timeout`` s of this backend's clock; None = nothing came.

        Returns at the latest at the next frame delimiter in virtual time.
        Raises LinkLost when the other end is gone.
        """

    def write(self, data: bytes) -> None:
        """Queue bytes; they start on the line now. Raises LinkLost."""

    def close(self) -> None: ...


class Clock(Protocol):
    """Host time of a backend: monotonic seconds, virtual or real."""

    def now(self) -> float: ...

    def sleep(self, seconds: float) -> None:
        """Let time pass; in virtual time the world advances."""
