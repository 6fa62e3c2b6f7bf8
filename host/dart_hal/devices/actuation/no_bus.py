"""Placeholder for the I2C bus of a replay, which has none."""

from __future__ import annotations

from dart_hal.core.errors import BusError


class NoBus:
    """Raises BusError on every access, so that an unintended write is noticed."""

    def __getattr__(self, name: str) -> object:
        raise BusError("there is no I2C bus behind this backend", found=name)
