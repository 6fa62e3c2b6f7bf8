"""Reject STATE frames with a valid CRC and impossible values.

A CRC-16 accepts one damaged frame in 65536. Most of these are detected by a device time that runs
backwards, by more edges than a wheel can cause, or by a yaw rate outside of the gyro's range.
"""

from __future__ import annotations

from collections.abc import Sequence

from dart_hal.wire.frame import layout
from dart_hal.wire.messages import BY_NAME, STATE, TICKS_PER_SECOND

# [rad/s] The BNO055 ends at 2000 deg/s = 34.9 rad/s.
MAX_GYRO = 35.0

# [1/s] The firmware counts at most 255 edges in each of the three phases of 10 ms. A glitch rule of
# less than its default admits the noise of a sensor, which the estimate of the speed detects.
MAX_EDGE_RATE = 76_500.0

# [ticks] Longest step of device time between two frames of one run.
MAX_SILENCE = 60 * TICKS_PER_SECOND

# Positions of t_ck and enc_count in the values of a STATE.
_T = 0
_COUNT = 1
_GYRO_AT = layout(STATE.id)["gyro"]
_GYRO_SCALE = next(f.scale for f in BY_NAME["STATE"].fields if f.name == "gyro")
_MASK32 = 0xFFFF_FFFF


class Gates:
    """Checks STATE frames in the order of arrival, each against the last accepted one.

    max_edge_rate [1/s] of ring A; max_gyro [rad/s]. If a frame agrees with the rejected one before
    it, it is accepted: the Nano restarted, and the values were no bit errors.
    """

    __slots__ = ("_base", "_edge_rate", "_gyro_raw", "_refused")

    def __init__(self, max_edge_rate: float = MAX_EDGE_RATE, max_gyro: float = MAX_GYRO) -> None:
        self._edge_rate = max_edge_rate / TICKS_PER_SECOND
        self._gyro_raw = max_gyro / _GYRO_SCALE
        self.rebase()

    def rebase(self) -> None:
        """Start a new run: only the yaw rate of the next frame is checked."""
        self._base: tuple[int, int] | None = None
        self._refused: tuple[int, int] | None = None

    def passes(self, values: Sequence[int]) -> bool:
        """Return whether these values (``Frame.values()`` of a STATE) are possible."""
        if max(map(abs, values[_GYRO_AT])) > self._gyro_raw:  # type: ignore[arg-type]
            return False
        now = values[_T], values[_COUNT]
        if self._follows(self._base, now) or (
                self._refused is not None and self._follows(self._refused, now)):
            self._base = now
            self._refused = None
            return True
        self._refused = now
        return False

    def _follows(self, previous: tuple[int, int] | None, now: tuple[int, int]) -> bool:
        """Return whether (time [ticks], edges) can follow the previous values."""
        if previous is None:
            return True
        elapsed = (now[0] - previous[0]) & _MASK32
        edges = (now[1] - previous[1]) & _MASK32
        # One more edge is possible, as the latch may be on either side of it.
        return 0 < elapsed < MAX_SILENCE and edges <= elapsed * self._edge_rate + 1
