"""Scans of a lidar on the car."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from dart_hal.core.errors import DartHalError
from dart_hal.core.types import Scan


class ScanSource(Protocol):
    """A stream of scans of one lidar. ``name``: its name in messages."""

    name: str

    @property
    def trouble(self) -> DartHalError | None:
        """The error while no scans are received, else None. Not raised: the car keeps driving."""

    def poll(self, now: float) -> Sequence[Scan]:
        """Return the scans completed since the last call, in order; never blocks.

        now [s]: present time of the car's clock, to which the times of the scans refer.
        The source counts invalid packets; they raise no error.
        """

    def close(self) -> None:
        """Close the port; idempotent."""
