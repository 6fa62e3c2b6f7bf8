"""Scans of a lidar that sits on the car."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from dart_hal.core.errors import DartHalError
from dart_hal.core.types import Scan


class ScanSource(Protocol):
    """A stream of scans of one lidar. ``name``: what messages call it."""

    name: str

    @property
    def trouble(self) -> DartHalError | None:
        """Why no scans come now, None while they do. Never raised: the car drives on."""

    def poll(self, now: float) -> Sequence[Scan]:
        """Scans that became complete since the last call, in order; never blocks.

        now [s]: the car's clock at this moment, on which their times are told.
        Bytes that are no packet are counted by the source, not raised.
        """

    def close(self) -> None:
        """Let go of the port; idempotent."""
