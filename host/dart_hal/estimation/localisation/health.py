"""Agreement of map and scan by ray casting, and the status of a track over several scans.

A beam agrees if the first wall of the map on it is within 8 cm + 2 % of the measured distance. At
a wrong pose many end points are still near some wall, but few beams meet that wall first.

Other beams end before that wall or pass through it:

- Before it: another car or a new box may be there. Such beams do not count.
- Through a box: boxes may have been removed. A beam that meets the wall behind agrees with the
  walls.
- Through a wall: impossible at the right pose, so such beams count against it. A single one does
  not: it has grazed an edge, or averages the distances on both sides of one.
"""

from __future__ import annotations

from collections import deque
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray, TextEnum
from dart_hal.estimation.localisation.field import Map

# m.
AGREEMENT_DISTANCE = 0.08
# Share of the measured distance, in addition.
AGREEMENT_SHARE = 0.02
# Every third beam is evaluated.
BEAM_STRIDE = 3
# Weight of the share of beams through walls in the proof that this is the room of the map. In the
# right room there are none with exact maps, whatever boxes had moved; with grids of 5 cm up to 0.8
# % in the mean.
PASS_WEIGHT = 7.0
# The same if boxes have moved as well.
STRICT_PASS_WEIGHT = 50.0
# Agreement of one scan above which it is used to evaluate maps and lidars.
MIN_AGREEMENT = 0.60
# Score of a scan below which it gives no pose.
MIN_SCAN_SCORE = 0.60
# Mean score of three such scans in a row below which the pose is given up. Wrong poses had at most
# 0.33 in the mean of three, 0.56 in one of them (2726 poses); good ones at least 0.56 in the mean
# (35 000 scans, a third of them with half of the boxes removed and 22 % new walls; rooms 5200 to
# 5215 and 7100 to 7107).
MIN_MEAN_SCORE = 0.45
# Proof, of a search and in the mean of the following track, below which this is not the room of
# the map.
MIN_PROOF = 0.70
# Mean agreement below which the map is out of date: moved boxes, other furniture.
MIN_MAP_AGREEMENT = 0.75
# Weight of one scan in that mean: 20 scans, 2.5 s.
MEAN_WEIGHT = 0.05
# Scans, 10 s, in which a track from a search must keep its proof.
PROBATION_SCANS = 80
# Bad scans in a row, 0.4 s, until a pose is given up.
MIN_BAD_SCANS = 3
# The same, 2.5 s, for scans that are in doubt but not worse.
MAX_BAD_SCANS = 20


class Status(TextEnum):
    """State of the localiser.

    TRACKING; MAP_STALE: tracking, but the room has changed since the map was made; LOST: no pose
    explains the scans; AMBIGUOUS: several poses do, and none is reported.
    """

    TRACKING = "TRACKING"
    MAP_STALE = "MAP_STALE"
    LOST = "LOST"
    AMBIGUOUS = "AMBIGUOUS"

    @property
    def located(self) -> bool:
        """Whether the pose can be used."""
        return self in (Status.TRACKING, Status.MAP_STALE)


class Agreement(NamedTuple):
    """Shares of the beams of one scan.

    share: agree with the map; through_walls: pass through its walls; removed_boxes: would agree
    without its boxes; boxes: meet its boxes, minus those that pass through them.
    """

    share: float
    through_walls: float
    removed_boxes: float = 0.0
    boxes: float = 0.0

    @property
    def score(self) -> float:
        """How well the pose explains the scan, regardless of boxes removed or added."""
        return self.share + self.removed_boxes - self.through_walls

    @property
    def familiar(self) -> bool:
        """Whether more of the visible boxes are in place than not."""
        return self.boxes >= 0.0

    def proof(self, pass_weight: float = PASS_WEIGHT) -> float:
        """Evidence that this is the room of the map; pass_weight: of beams through walls."""
        return self.share + self.removed_boxes - pass_weight * self.through_walls


def agreement(chart: Map, pose: FloatArray, points: FloatArray, rays: FloatArray,
              origin: FloatArray) -> Agreement:
    """Return the agreement of every third beam at a pose (4,)."""
    c = np.cos(pose[2])
    s = np.sin(pose[2])
    rotation = np.array(((c, s), (-s, c)))
    start = origin[::BEAM_STRIDE]
    reach = points[::BEAM_STRIDE] + pose[3] * rays[::BEAM_STRIDE] - start
    measured = np.hypot(*reach.T)
    start = start @ rotation + pose[:2]
    ahead = reach @ rotation / measured[:, None]
    limit = AGREEMENT_DISTANCE + AGREEMENT_SHARE * measured
    past_first = measured - chart.line_index.cast(start, ahead)
    past_wall = (past_first if chart.wall_index is chart.line_index
                 else measured - chart.wall_index.cast(start, ahead))
    agrees = np.abs(past_first) < limit
    is_past = past_first >= limit
    removed_boxes = is_past & (np.abs(past_wall) < limit)
    through_boxes = removed_boxes | _adjacent(is_past & (past_wall <= -limit))
    boxes = np.mean(agrees & (past_wall < past_first)) - np.mean(through_boxes)
    return Agreement(float(np.mean(agrees)), float(np.mean(_adjacent(past_wall >= limit))),
                     float(np.mean(removed_boxes)), float(boxes))


def _adjacent(beams: BoolArray) -> BoolArray:
    """Select beams with a selected neighbour."""
    ring = np.concatenate((beams[-1:], beams, beams[:1]))
    both: BoolArray = beams & (ring[:-2] | ring[2:])
    return both


class TrackJudge:
    """Status of one track.

    Parameters: ``mean``: agreement of its first scan, with which the mean begins; ``searched``: all
    figures of that scan, if only a search indicates that this is the room of the map.

    After a call: ``mean``: agreement, averaged over the last 20 scans; ``in_doubt``: the last scan
    disagrees.
    """

    def __init__(self, mean: float, searched: Agreement | None = None) -> None:
        self.mean = mean
        self._proof = 1.0
        self._pass_weight = PASS_WEIGHT
        self._probation = 0
        self._bad_scores: deque[float] = deque(maxlen=MAX_BAD_SCANS)
        if searched is not None:
            self._pass_weight = PASS_WEIGHT if searched.familiar else STRICT_PASS_WEIGHT
            self._proof = searched.proof(self._pass_weight)
            self._probation = PROBATION_SCANS

    @property
    def on_probation(self) -> bool:
        """Whether this may still be another room."""
        return self._probation > 0

    @property
    def in_doubt(self) -> bool:
        """Whether the last scan disagrees."""
        return bool(self._bad_scores)

    def add(self, agreed: Agreement) -> Status:
        """Add the agreement of one scan; return the status."""
        stale = self.mean < MIN_MAP_AGREEMENT
        self._probation = self._probation - 1
        if agreed.score < MIN_SCAN_SCORE:
            self._bad_scores.append(agreed.score)
            last = list(self._bad_scores)[-MIN_BAD_SCANS:]
            is_bad = len(last) == MIN_BAD_SCANS and sum(last) < MIN_BAD_SCANS * MIN_MEAN_SCORE
            if len(self._bad_scores) == MAX_BAD_SCANS or is_bad:
                return Status.LOST
        else:
            self._bad_scores.clear()
            self.mean += MEAN_WEIGHT * (agreed.share - self.mean)
            if self._probation > 0:
                self._proof += MEAN_WEIGHT * (agreed.proof(self._pass_weight) - self._proof)
        if self._proof < MIN_PROOF and self._probation > 0:
            return Status.LOST
        return Status.MAP_STALE if stale else Status.TRACKING
