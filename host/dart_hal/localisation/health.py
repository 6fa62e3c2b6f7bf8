"""Whether the map explains what the lidar sees: rays, and what they say over a few scans.

A beam agrees where the map has its first wall within 8 cm + 2 % of the distance that was measured.
A pose that is wrong keeps many ends near some wall, but few beams that meet that wall first.

Other beams end before that wall, or pass through it. Before it anything may stand: another car, a
box that is new. But nothing passes through a wall that is there, so such beams count against a
pose that was searched: a room of the same outline with other furniture has them. One alone does
not count: it has grazed an edge, or tells a distance between both sides of one.
"""

from __future__ import annotations

from enum import Enum
from typing import NamedTuple

import numpy as np

from dart_hal.localisation.field import Map
from dart_hal.localisation.rays import best
from dart_hal.types import FloatArray

NEAR, SHARE = 0.08, 0.02
"""m and share of the distance."""
EVERY = 3
"""Of the beams that are judged."""
PASSES = 7.0
"""Weight of the share of beams that pass through a wall, where it is asked whether this is the room
of the map at all: in that room none did (136 scans, rooms 7000 to 7007), by a grid of a hall with
many corners 0.4 % in the mean and 2 % in one scan of 20; in rooms of the same outline that agree in
more than 75 % it is 5 % in the mean (37 of 400 scans), and 4 of those are taken for the map."""
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


class Agreement(NamedTuple):
    """Shares of the beams that agree with the map, and that pass through its walls."""

    share: float
    passed: float

    @property
    def proof(self) -> float:
        """How well this is the room of the map."""
        return self.share - PASSES * self.passed


def agreement(chart: Map, pose: FloatArray, points: FloatArray, rays: FloatArray,
              origin: FloatArray) -> Agreement:
    """Of every third beam, at a pose (4,)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    turn = np.array(((c, s), (-s, c)))
    start = origin[::EVERY]
    reach = points[::EVERY] + pose[3] * rays[::EVERY] - start
    told = np.hypot(*reach.T)
    hit = best()(chart.lines, start @ turn + pose[:2], reach @ turn / told[:, None])
    beyond, limit = told - hit, NEAR + SHARE * told
    through = beyond >= limit
    ring = np.concatenate((through[-1:], through, through[:1]))
    through &= ring[:-2] | ring[2:]
    return Agreement(float(np.mean(np.abs(beyond) < limit)), float(np.mean(through)))


class Judge:
    """One per track. mean: agreement of its first scan; searched: nobody said where it begins.

    ``mean``: agreement of the last seconds; ``doubted``: the last scan disagrees.
    """

    def __init__(self, mean: float, *, searched: bool = False) -> None:
        self.mean = self._proof = mean
        self._bad, self._fresh = 0, FRESH if searched else 0

    @property
    def fresh(self) -> bool:
        """Whether this may still be another room."""
        return self._fresh > 0

    @property
    def doubted(self) -> bool:
        return self._bad > 0

    def add(self, agreed: Agreement) -> Status:
        """The agreement of one more scan."""
        stale, self._fresh = self.mean < STALE, self._fresh - 1
        self._bad = self._bad + 1 if agreed.share < (STALE_RIGHT if stale else RIGHT) else 0
        if self._bad >= PATIENCE or (self._proof < STALE and self._fresh > 0):
            return Status.LOST
        if not self._bad:
            self.mean += MEMORY * (agreed.share - self.mean)
            self._proof += MEMORY * (agreed.proof - self._proof)
        return Status.MAP_STALE if stale else Status.TRACKING
