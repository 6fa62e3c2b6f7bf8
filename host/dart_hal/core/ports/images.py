"""Images of a camera that sees the car, or sits on it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from dart_hal.core.errors import DartHalError
from dart_hal.core.types import Image


class ImageSource(Protocol):
    """A stream of images of one camera. ``name``: what messages call it."""

    name: str

    @property
    def trouble(self) -> DartHalError | None:
        """Why no images come now, None while they do. Never raised: the car drives on."""

    def poll(self, now: float) -> Sequence[Image]:
        """Images that came since the last call, in order; never blocks, and keeps few: of a
        program that is too slow the oldest are dropped.

        now [s]: the car's clock at this moment, on which their times are told.
        """

    def close(self) -> None:
        """Let go of the device; idempotent."""
