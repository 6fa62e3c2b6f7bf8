"""Images of a camera on the car or in its surroundings."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from dart_hal.core.errors import DartHalError
from dart_hal.core.types import Image


class ImageSource(Protocol):
    """A stream of images of one camera. ``name``: its name in messages."""

    name: str

    @property
    def trouble(self) -> DartHalError | None:
        """The error while no images are received, else None. Not raised: the car keeps driving."""

    def poll(self, now: float) -> Sequence[Image]:
        """Return the images since the last call, in order; never blocks.

        The buffer is short: if the program is too slow, the oldest images are dropped.
        now [s]: present time of the car's clock, to which the times of the images refer.
        """

    def close(self) -> None:
        """Close the device; idempotent."""
