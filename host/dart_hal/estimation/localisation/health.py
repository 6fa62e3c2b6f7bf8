"""Whether the map explains what the lidar sees: rays, and what they say over a few scans.

A beam agrees where the map has its first wall within 8 cm + 2 % of the distance that was measured.
A pose that is wrong keeps many ends near some wall, but few beams that meet that wall first.

Other beams end before that wall, or pass through it. Before it anything may stand: another car, a
box that is new. Boxes are carried off too: where a beam passes one and meets the wall behind, it
agrees with the walls. But nothing passes through a wall that is there, so such beams count against
a pose. One alone does not: it has grazed an edge, or tells a distance between both sides of one.
"""

from __future__ import annotations

from collections import deque
from enum import Enum
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.estimation.localisation.field import Map
from dart_hal.estimation.localisation.rays import best

NEAR, SHARE = 0.08, 0.02
"""m and share of the distance."""
EVERY = 3
"""Of the beams that are judged."""
PASSES, DOUBTFUL = 7.0, 50.0
"""Weight of the share of beams that pass through a wall, where it is asked whether this is the room
of the map at all; and where boxes have moved as well. In that room none did, whatever boxes had
come and gone, by exact maps; by grids of 5 cm up to 0.8 % in the mean."""
AGREED = 0.60
"""Agreement of one scan above which it counts, where maps and lidars are measured."""
DOUBT, RIGHT = 0.60, 0.45
"""Worth of a scan below which it gives no pose, and mean worth of three such in a row below which
the pose is given up. In three scans wrong poses had 0.33 at most in the mean, 0.56 in one of them
(2726 poses); good ones 0.56 at least in the mean (35 000 scans, a third of them with half of the
map's boxes gone and 22 % new walls); rooms 5200 to 5215 and 7100 to 7107."""
FITS = 0.70
"""Proof, of a search and in the mean of a track that was searched, below which this is not the room
of the map."""
STALE = 0.75
"""Mean agreement below which the map is out of date: moved boxes, other furniture."""
MEMORY = 0.05
"""Weight of one scan in that mean: 20 scans, 2.5 s."""
FRESH = 80
"""Scans, 10 s, in which a track that was searched must go on to fit."""
PATIENCE, LONGEST = 3, 20
"""Scans in a row, 0.4 s, until a pose is given up; and 2.5 s where they are doubted, no worse."""


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
    """Shares of the beams that agree with the map, that pass through its walls, that would agree
    if its boxes were gone, and that meet its boxes, less those that pass them."""

    share: float
    passed: float
    gone: float = 0.0
    boxes: float = 0.0

    @property
    def worth(self) -> float:
        """How well the pose explains the scan, whatever was carried off or put down."""
        return self.share + self.gone - self.passed

    @property
    def familiar(self) -> bool:
        """Whether more of the boxes in sight stand where they did than not."""
        return self.boxes >= 0.0

    def proof(self, passes: float = PASSES) -> float:
        """How well this is the room of the map, likewise; passes: weight of those beams."""
        return self.share + self.gone - passes * self.passed


def agreement(chart: Map, pose: FloatArray, points: FloatArray, rays: FloatArray,
              origin: FloatArray) -> Agreement:
    """Of every third beam, at a pose (4,)."""
    c, s = np.cos(pose[2]), np.sin(pose[2])
    turn = np.array(((c, s), (-s, c)))
    start = origin[::EVERY]
    reach = points[::EVERY] + pose[3] * rays[::EVERY] - start
    told = np.hypot(*reach.T)
    start, ahead = start @ turn + pose[:2], reach @ turn / told[:, None]
    limit = NEAR + SHARE * told
    beyond = told - best()(chart.lines, start, ahead)
    behind = told - best()(chart.walls, start, ahead)
    agrees, far = np.abs(beyond) < limit, beyond >= limit
    gone = far & (np.abs(behind) < limit)
    boxes = np.mean(agrees & (behind < beyond)) - np.mean(gone | _pairs(far & (behind <= -limit)))
    return Agreement(float(np.mean(agrees)), float(np.mean(_pairs(behind >= limit))),
                     float(np.mean(gone)), float(boxes))


def _pairs(beams: BoolArray) -> BoolArray:
    """Those with a neighbour among them."""
    ring = np.concatenate((beams[-1:], beams, beams[:1]))
    both: BoolArray = beams & (ring[:-2] | ring[2:])
    return both


class Judge:
    """One per track. mean: agreement of its first scan; searched: that scan, where nobody but a
    search says that this is the room of the map.

    ``mean``: agreement of the last seconds; ``doubted``: the last scan disagrees.
    """

    def __init__(self, mean: float, searched: Agreement | None = None) -> None:
        self.mean, self._proof, self._passes, self._fresh = mean, 1.0, PASSES, 0
        self._bad: deque[float] = deque(maxlen=LONGEST)
        if searched is not None:
            self._passes = PASSES if searched.familiar else DOUBTFUL
            self._proof, self._fresh = searched.proof(self._passes), FRESH

    @property
    def fresh(self) -> bool:
        """Whether this may still be another room."""
        return self._fresh > 0

    @property
    def doubted(self) -> bool:
        return bool(self._bad)

    def add(self, agreed: Agreement) -> Status:
        """The agreement of one more scan."""
        stale, self._fresh = self.mean < STALE, self._fresh - 1
        if agreed.worth < DOUBT:
            self._bad.append(agreed.worth)
            last = list(self._bad)[-PATIENCE:]
            if len(self._bad) == LONGEST or (len(last) == PATIENCE
                                             and sum(last) < PATIENCE * RIGHT):
                return Status.LOST
        else:
            self._bad.clear()
            self.mean += MEMORY * (agreed.share - self.mean)
            if self._fresh > 0:
                self._proof += MEMORY * (agreed.proof(self._passes) - self._proof)
        if self._proof < FITS and self._fresh > 0:
            return Status.LOST
        return Status.MAP_STALE if stale else Status.TRACKING
