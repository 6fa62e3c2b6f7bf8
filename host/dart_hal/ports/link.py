"""Bytes to and from a Nano, and the time in which they travel."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol


@dataclass(frozen=True, slots=True)
class Chunk:
    """Bytes of the link and the host time [s] at which the last of them arrived."""

    data: bytes
    t: float


class Link(Protocol):
    """A byte stream to a Nano."""

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
