"""Poses of the car that something outside of it measures: motion capture, beacons, a camera."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from dart_hal.core.types import ExternalPose


class PoseSource(Protocol):
    """A stream of poses of one body. ``name``: what messages call it; ``on_board``: they are of the
    rear axle and by the car's own clock, for the car makes them itself."""

    name: str
    on_board: bool

    def poll(self, now: float) -> Sequence[ExternalPose]:
        """Poses that have arrived since the last call, in order of arrival; never blocks.

        now [s]: the car's clock at this moment, on which ``arrival`` is told.
        Bytes that are no pose are counted by the source, not raised.
        """

    def close(self) -> None:
        """Let go of sockets and files; idempotent."""
