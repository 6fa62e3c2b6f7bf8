"""External poses of the car: from motion capture, beacons or a camera."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from dart_hal.core.types import ExternalPose


class PoseSource(Protocol):
    """A stream of poses of one body. ``name``: its name in messages.

    ``on_board``: the car computes the poses itself; they are poses of the rear axle, with stamps
    of the car's clock. ``map_std`` [m]: standard error of the walls of its map, 0 without one; read
    of a source on board only.
    """

    name: str
    on_board: bool
    map_std: float

    def poll(self, now: float) -> Sequence[ExternalPose]:
        """Return the poses since the last call, in the order of arrival; never blocks.

        now [s]: present time of the car's clock, to which ``arrival`` refers.
        The source counts invalid packets; they raise no error.
        """

    def close(self) -> None:
        """Close sockets and files; idempotent."""
