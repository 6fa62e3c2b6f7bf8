"""The middle of a lane between two boards or walls, from the points of one scan.

    at the car       the slope and the two offsets with the most points
    further on       strips of 0.1 m: left = half + b u, right = -half + b u, one slope b for both,
                     by least squares of the points near the boards of the previous strip

Each strip yields one point of the middle line and leads to the next, so a lane may bend in any way;
a parabola through all points would not fit a lane that bends twice.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan, cos, sin

import numpy as np

from dart_hal.core.types import FloatArray, Pose

# Distance between strips, and half length of a strip [m]: 40 points of a board next to the car, 2
# of one 2 m ahead; in a bend of 1.5 m their mean is 2.5 mm off.
STRIP_SPACING = 0.10
STRIP_HALF_LENGTH = 0.15
# Distance from a board within which points belong to it [m]: 6 sigma of a distance.
BOARD_GATE = 0.10
# Distance ahead [m]: further on, a strip contains one point of a board.
LOOK_DISTANCE = 2.5
# Points from which a board is accepted, in a strip and next to the car.
MIN_STRIP_POINTS = 2
MIN_BOARD_POINTS = 8
# Distance before and behind the rear axle in which boards are searched [m]: in a bend of 1.5 m they
# deviate from the straight by 4 cm, an ``OFFSET_BIN``.
SIDE_HALF_LENGTH = 0.35
# Range of distances from the car to a board: half the body, and no lane any more; bin of the
# histogram [m].
MIN_BOARD_DISTANCE = 0.12
MAX_BOARD_DISTANCE = 1.0
OFFSET_BIN = 0.04
# Directions of the lane relative to the car that are tried [rad].
SLOPES = np.arange(-0.6, 0.601, 0.05)


@dataclass(frozen=True, slots=True, eq=False)
class LaneView:
    """The lane in one scan.

    middle (n, 2) [m], in the frame of the points, every ``STRIP_SPACING`` from the rear axle on;
    half [m]: half width; left, right: which board was found. Without both the middle is empty.
    """

    middle: FloatArray
    half: float
    left: bool
    right: bool

    @property
    def is_complete(self) -> bool:
        """Whether there is a lane to drive in."""
        return len(self.middle) > 1


def find_lane(points: FloatArray, pose: Pose) -> LaneView:
    """Find the lane in points (m, 2) [m; NaN = no echo], from the pose of the car in their frame
    on.
    """
    c = cos(pose.yaw)
    s = sin(pose.yaw)
    dx, dy = (points - (pose.x, pose.y)).T
    in_range = np.hypot(dx, dy) < LOOK_DISTANCE  # False for NaN
    local = np.column_stack((c * dx + s * dy, c * dy - s * dx))[in_range]
    slope, left, right = _find_boards(local)
    if left is None or right is None:
        return LaneView(np.empty((0, 2)), 0.0, left is not None, right is not None)
    middle, half = _trace_middle(local, slope, left, right)
    x, y = middle.T
    return LaneView(np.column_stack((pose.x + c * x - s * y, pose.y + s * x + c * y)), half,
                    True, True)


def _find_boards(points: FloatArray) -> tuple[float, float | None, float | None]:
    """Return slope [rad] of the lane and offsets [m] of its boards, left positive, None without a
    board.

    A Hough transform: for each slope a histogram of the offsets to either side; the slope with the
    largest sum of the two maxima (each of two neighbouring bins) is taken.
    """
    c = np.cos(SLOPES)[:, None]
    s = np.sin(SLOPES)[:, None]
    along = c * points[:, 0] + s * points[:, 1]
    left = c * points[:, 1] - s * points[:, 0]
    classes = int(MAX_BOARD_DISTANCE / OFFSET_BIN)
    hits = []
    for side in (left, -left):
        counts = (
            (np.abs(along) < SIDE_HALF_LENGTH)
            & (side > MIN_BOARD_DISTANCE)
            & (side < classes * OFFSET_BIN)
        )
        row, column = np.nonzero(counts)
        k = row * classes + (side[row, column] / OFFSET_BIN).astype(int)
        found = np.bincount(k, minlength=len(SLOPES) * classes).reshape(len(SLOPES), classes)
        hits.append(found + np.roll(found, -1, axis=1) * (np.arange(classes) < classes - 1))
    best = int(np.argmax(hits[0].max(axis=1) + hits[1].max(axis=1)))
    offsets = [
        OFFSET_BIN * (1.0 + int(np.argmax(h[best]))) if h[best].max() >= MIN_BOARD_POINTS else None
        for h in hits
    ]
    return float(SLOPES[best]), offsets[0], None if offsets[1] is None else -offsets[1]


def _trace_middle(points: FloatArray, heading: float, left: float, right: float
                  ) -> tuple[FloatArray, float]:
    """Return the middle line (n, 2) [m] and the half width [m] at its beginning, in the car's
    frame.

    For each strip: 1. points near either board; 2. common slope by least squares; 3. half width and
    offset from the two intercepts (one board: from the last half width); 4. next strip.
    """
    half = 0.5 * (left - right)
    offset = 0.5 * (left + right)
    x = -offset * sin(heading)
    y = offset * cos(heading)
    middle: list[tuple[float, float]] = []
    width = half
    while len(middle) * STRIP_SPACING < LOOK_DISTANCE:
        c = cos(heading)
        s = sin(heading)
        dx = points[:, 0] - x
        dy = points[:, 1] - y
        along = c * dx + s * dy
        off = c * dy - s * dx
        strip = np.abs(along) < STRIP_HALF_LENGTH
        boards = [(along[k], off[k]) for k in (strip & (np.abs(off - b) < BOARD_GATE)
                                               for b in (half, -half))]
        has_board = [len(u) >= MIN_STRIP_POINTS and u.max() > 0.0 for u, _ in boards]
        if not any(has_board):
            break
        spread = sum(float(np.sum((u - u.mean()) ** 2)) for u, _ in boards if len(u))
        slope = sum(float(np.sum((u - u.mean()) * v)) for u, v in boards if len(u)) / max(
            spread, 1e-3)
        intercepts = [float(v.mean() - slope * u.mean()) if ok else None
                      for (u, v), ok in zip(boards, has_board, strict=True)]
        left_offset, right_offset = intercepts
        half = (
            0.5 * (left_offset - right_offset)
            if left_offset is not None and right_offset is not None
            else half
        )
        offset = (left_offset - half) if left_offset is not None else (right_offset or 0.0) + half
        x = x - offset * s
        y = y + offset * c
        heading = heading + atan(slope)
        middle.append((x, y))
        width = half if len(middle) == 1 else width
        x = x + STRIP_SPACING * cos(heading)
        y = y + STRIP_SPACING * sin(heading)
    return np.array(middle).reshape(-1, 2), width
