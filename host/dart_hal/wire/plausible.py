"""Gates behind the CRC: a STATE frame must also be possible.

A CRC-16 passes one damaged frame in 65536. Device time that runs backwards,
edges that no wheel can make, or a yaw rate outside the gyro's range betray
most of those.
"""

from __future__ import annotations

from collections.abc import Sequence

from dart_hal.wire.frame import layout
from dart_hal.wire.messages import BY_NAME, STATE, TICKS_PER_SECOND

MAX_GYRO = 35.0
"""[rad/s] The BNO055 ends at 2000 deg/s = 34.9 rad/s."""

MAX_EDGE_RATE = 10_000.0
"""[1/s] The firmware's glitch rule refuses edges closer than 100 us."""

MAX_SILENCE = 60 * TICKS_PER_SECOND
"""[ticks] Longest step of device time between two frames of one run."""

_T, _COUNT = 0, 1
_GYRO_AT = layout(STATE.id)["gyro"]
_GYRO_SCALE = next(f.scale for f in BY_NAME["STATE"].fields if f.name == "gyro")
_MASK32 = 0xFFFF_FFFF


class Gates:
    """Judges STATE frames in the order of their arrival.

    max_edge_rate [1/s] of ring A; max_gyro [rad/s]. A refused frame becomes
    the new base when the next one agrees with it: then the Nano restarted,
    and not a bit was flipped.
    """

    __slots__ = ("_base", "_edge_rate", "_gyro_raw", "_refused")

    def __init__(self, max_edge_rate: float = MAX_EDGE_RATE, max_gyro: float = MAX_GYRO) -> None:
        self._edge_rate = max_edge_rate / TICKS_PER_SECOND
        self._gyro_raw = max_gyro / _GYRO_SCALE
        self.rebase()

    def rebase(self) -> None:
        """Another run begins: the next frame is judged by its gyro alone."""
        self._base: tuple[int, int] | None = None
        self._refused: tuple[int, int] | None = None

    def passes(self, values: Sequence[int]) -> bool:
        """True when these values (``Frame.values()`` of a STATE) are possible."""
        if max(map(abs, values[_GYRO_AT])) > self._gyro_raw:  # type: ignore[arg-type]
            return False
        now = values[_T], values[_COUNT]
        if self._follows(self._base, now) or (
                self._refused is not None and self._follows(self._refused, now)):
            self._base, self._refused = now, None
            return True
        self._refused = now
        return False

    def _follows(self, before: tuple[int, int] | None, now: tuple[int, int]) -> bool:
        if before is None:
            return True
        elapsed = (now[0] - before[0]) & _MASK32
        edges = (now[1] - before[1]) & _MASK32
        # One edge may lie on either side of the latch.
        return 0 < elapsed < MAX_SILENCE and edges <= elapsed * self._edge_rate + 1
