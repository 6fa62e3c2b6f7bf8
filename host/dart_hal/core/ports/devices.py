"""Images of a camera on the car or in its surroundings, and scans of a lidar on the car."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol, TypeVar

from dart_hal.core.errors import DartHalError
from dart_hal.core.types import Image, Scan

T_co = TypeVar("T_co", covariant=True)


class DeviceSource(Protocol[T_co]):
    """A stream of what one device measures. ``name``: its name in messages."""

    name: str

    @property
    def trouble(self) -> DartHalError | None:
        """The error while nothing is received, else None. Not raised: the car keeps driving."""

    def poll(self, now: float) -> Sequence[T_co]:
        """Return the images or the complete scans since the last call, in order; never blocks.

        The buffer of images is short: if the program is too slow, the oldest ones are dropped.
        The source counts invalid packets; they raise no error.
        now [s]: present time of the car's clock, to which the times of images and scans refer.
        """

    def close(self) -> None:
        """Close the device; idempotent."""


ImageSource = DeviceSource[Image]
ScanSource = DeviceSource[Scan]
