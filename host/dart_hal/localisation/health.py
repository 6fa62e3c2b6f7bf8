"""Whether the map explains what the lidar sees: rays, and what they say over a few scans.

A beam agrees where the map has its first wall within 8 cm + 2 % of the distance that was measured.
A pose that is wrong keeps many ends near some wall, but few beams that meet that wall first.
"""

from __future__ import annotations

from enum import Enum

import numpy as np

from dart_hal.localisation.field import Map
from dart_hal.localisation.rays import best
from dart_hal.types import FloatArray

NEAR, SHARE = 0.08, 0.02
"""m and share of the distance."""
EVERY = 3
"""Of the beams that are judged."""
RIGHT, STALE_RIGHT = 0.60, 0.46
"""Agreement below which a pose is wrong; and where the map is known to be out of date."""
STALE = 0.75
"""Mean agreement below which the map is out of date: moved boxes, other furniture. Least of a
search: rooms of the map had 0.80 at least (60 scans), with 22 % new walls 0.75 in 98 of 100; rooms
of the same outline with other furniture less in 88 of 100."""
MEMORY = 0.05
"""Weight of one scan in that mean: 20 scans, 2.5 s."""
FRESH = 80
"""Scans, 10 s, in which a track that was searched may not find the map out of date: another room
would look so."""
PATIENCE = 3
"""Scans in a row, 0.4 s, until a pose is given up."""


class Status(str, Enum):
    """TRACKING; MAP_STALE: tracking, in a room that is not the map's any more; LOST: no pose
    explains the scans; AMBIGUOUS: several poses do, and none is told."""

    TRACKING = "TRACKING"
    MAP_STALE = "MAP_STALE"
    LOST = "LOST"
    AMBIGUOUS = "AMBIGUOUS"

    def __str__(self) -> str:
        return self.value

    @property
    def located(self) -> bool:
        """Whether there is a pose to go by."""
        return self in (Status.TRACKING, Status.MAP_STALE)


def agreement(chart: Map, pose: FloatArray, points: FloatArray, rays: FloatArray,
              origin: FloatArray) -> float:
    """Share of the beams that agree with the map at a pose (4,), of every third."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    turn = np.array(((c, s), (-s, c)))
    start = origin[::EVERY]
    reach = points[::EVERY] + pose[3] * rays[::EVERY] - start
    told = np.hypot(*reach.T)
    hit = best()(chart.lines, start @ turn + pose[:2], reach @ turn / told[:, None])
    return float(np.mean(np.abs(told - hit) < NEAR + SHARE * told))


class Judge:
    """One per track. agreed: of its first scan; searched: nobody said where it begins.

    ``mean``: agreement of the last seconds; ``doubted``: the last scan disagrees.
    """

    def __init__(self, agreed: float, *, searched: bool = False) -> None:
        self.mean = agreed
        self._bad, self._fresh = 0, FRESH if searched else 0

    @property
    def doubted(self) -> bool:
        return self._bad > 0

    def add(self, agreed: float) -> Status:
        """The agreement of one more scan."""
        stale, self._fresh = self.mean < STALE, self._fresh - 1
        self._bad = self._bad + 1 if agreed < (STALE_RIGHT if stale else RIGHT) else 0
        if self._bad >= PATIENCE or (stale and self._fresh > 0):
            return Status.LOST
        if not self._bad:
            self.mean += MEMORY * (agreed - self.mean)
        return Status.MAP_STALE if stale else Status.TRACKING
