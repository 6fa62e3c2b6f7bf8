"""The middle of a lane between two boards or walls, out of the points of one scan.

    beside the car   the slope and the two offsets on which most points lie
    from there on    strips of 0.1 m: left = half + b u, right = -half + b u, one slope b for both,
                     by least squares of the points near the boards of the strip before

Each strip gives one point of the middle line and leads to the next, so a lane may bend as it likes;
a parabola through all points leaves one that bends twice.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import atan, cos, sin

import numpy as np

from dart_hal.core.types import FloatArray, Pose

# m from strip to strip, and to either side of one of which points count: 40 points of a board
# beside the car, 2 of one 2 m ahead; on a bend of 1.5 m their mean is 2.5 mm off.
STRIP = 0.10
WINDOW = 0.15
# m beside a board in which points are its own: 6 sigma of a distance.
GATE = 0.10
# m that are looked ahead: further, a strip holds one point of a board.
REACH = 2.5
# Points of a board in a strip, and beside the car, from which on it is seen.
LEAST = 2
ENOUGH = 8
# m before and behind the rear axle in which boards are looked for: on a bend of 1.5 m they leave
# the straight by 4 cm, a ``BIN``.
BESIDE = 0.35
# m from the car to a board: the body's half, and what is no lane any more; of a class.
NARROW = 0.12
WIDE = 1.0
BIN = 0.04
# rad of the lane to the car that are tried.
SLOPES = np.arange(-0.6, 0.601, 0.05)


@dataclass(frozen=True, slots=True, eq=False)
class Sight:
    """What one scan shows. middle (n, 2) [m], in the frame of its points, every ``STRIP`` from
    beside the rear axle on; half [m] of the width; left, right: which board is beside the car.

    Without both the middle is empty: half a lane is no lane.
    """

    middle: FloatArray
    half: float
    left: bool
    right: bool

    @property
    def whole(self) -> bool:
        """A lane to drive in."""
        return len(self.middle) > 1


def look(points: FloatArray, pose: Pose) -> Sight:
    """The lane in points (m, 2) [m; NaN = nothing came back], from the car's pose among them on."""
    c = cos(pose.yaw)
    s = sin(pose.yaw)
    dx, dy = (points - (pose.x, pose.y)).T
    near = np.hypot(dx, dy) < REACH  # NaN is not
    at = np.column_stack((c * dx + s * dy, c * dy - s * dx))[near]
    slope, left, right = _beside(at)
    if left is None or right is None:
        return Sight(np.empty((0, 2)), 0.0, left is not None, right is not None)
    middle, half = _march(at, slope, left, right)
    x, y = middle.T
    return Sight(np.column_stack((pose.x + c * x - s * y, pose.y + s * x + c * y)), half,
                 True, True)


def _beside(at: FloatArray) -> tuple[float, float | None, float | None]:
    """Slope [rad] of the lane and offsets [m] of its boards, left positive; None: there is none."""
    c = np.cos(SLOPES)[:, None]
    s = np.sin(SLOPES)[:, None]
    along = c * at[:, 0] + s * at[:, 1]
    left = c * at[:, 1] - s * at[:, 0]
    classes = int(WIDE / BIN)
    hits = []
    for side in (left, -left):
        counts = (np.abs(along) < BESIDE) & (side > NARROW) & (side < classes * BIN)
        row, column = np.nonzero(counts)
        k = row * classes + (side[row, column] / BIN).astype(int)
        found = np.bincount(k, minlength=len(SLOPES) * classes).reshape(len(SLOPES), classes)
        hits.append(found + np.roll(found, -1, axis=1) * (np.arange(classes) < classes - 1))
    best = int(np.argmax(hits[0].max(axis=1) + hits[1].max(axis=1)))
    offsets = [BIN * (1.0 + int(np.argmax(h[best]))) if h[best].max() >= ENOUGH else None
               for h in hits]
    return float(SLOPES[best]), offsets[0], None if offsets[1] is None else -offsets[1]


def _march(at: FloatArray, heading: float, left: float, right: float
           ) -> tuple[FloatArray, float]:
    """Middle (n, 2) [m] and half width [m] at its beginning, in the car's axes."""
    half = 0.5 * (left - right)
    side = 0.5 * (left + right)
    x = -side * sin(heading)
    y = side * cos(heading)
    middle: list[tuple[float, float]] = []
    width = half
    while len(middle) * STRIP < REACH:
        c = cos(heading)
        s = sin(heading)
        dx = at[:, 0] - x
        dy = at[:, 1] - y
        along = c * dx + s * dy
        off = c * dy - s * dx
        strip = np.abs(along) < WINDOW
        boards = [(along[k], off[k]) for k in (strip & (np.abs(off - b) < GATE)
                                               for b in (half, -half))]
        seen = [len(u) >= LEAST and u.max() > 0.0 for u, _ in boards]
        if not any(seen):
            break
        spread = sum(float(np.sum((u - u.mean()) ** 2)) for u, _ in boards if len(u))
        slope = sum(float(np.sum((u - u.mean()) * v)) for u, v in boards if len(u)) / max(
            spread, 1e-3)
        here = [float(v.mean() - slope * u.mean()) if ok else None
                for (u, v), ok in zip(boards, seen, strict=True)]
        one, two = here
        half = 0.5 * (one - two) if one is not None and two is not None else half
        side = (one - half) if one is not None else (two or 0.0) + half
        x = x - side * s
        y = y + side * c
        heading = heading + atan(slope)
        middle.append((x, y))
        width = half if len(middle) == 1 else width
        x = x + STRIP * cos(heading)
        y = y + STRIP * sin(heading)
    return np.array(middle).reshape(-1, 2), width
