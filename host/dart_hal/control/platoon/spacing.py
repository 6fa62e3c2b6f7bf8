"""How far it is to the car ahead: what stands in the own way, by the lidar; else what it told.

    lidar   points of a scan within the width of the own way ahead, the nearest handful of them
    told    where the predecessor says it is; used where nothing is seen

Whatever stands there is what must not be hit, so the cluster need not be the one that was told.
"""

from __future__ import annotations

import numpy as np

from dart_hal.control.paths import Path
from dart_hal.control.platoon.follower import Gap
from dart_hal.core.types import FloatArray

# m from the rear axle to the front and to the rear end of a car (docs/reference/hardware.md).
NOSE = 0.2375
TAIL = 0.0625
# m to either side of the path: a body's half, 0.095, and 5 cm beside it; boards are at 0.35.
WIDE = 0.15
# m ahead in which a car is looked for: six gaps.
REACH = 3.0
# Points within so many m of way that are a thing: a tail 1.5 m ahead is hit by a dozen beams.
LEAST = 3
DEEP = 0.06
# m that a gap is wrong at most: a distance by 1.5 %, a mean of beams by 5 mm, a scan by its age;
# and where poses of two cars are told, at 1 m/s each by 0.1 s of age.
SEEN = 0.05
HEARD = 0.20


def seen(points: FloatArray, t: FloatArray, path: Path, s: FloatArray) -> Gap | None:
    """By the end points (n, 2) [m] of a scan, taken at t (n,) [s] when the own rear axle was at the
    arc lengths s (n,) [m]; None: nothing is in the way."""
    if not len(points):
        return None
    way, aside = _along(points, path, float(s[-1]))
    gap = way - s - NOSE
    inside = (np.abs(aside) < WIDE) & (gap > -NOSE) & (gap < REACH)
    if not inside.any():
        return None
    order = np.argsort(gap[inside])
    near = gap[inside][order]
    at = t[inside][order]
    upto = np.searchsorted(near, near + DEEP)
    firm = np.flatnonzero(upto - np.arange(len(near)) >= LEAST)
    if not len(firm):
        return None
    k = slice(int(firm[0]), int(upto[firm[0]]))
    return Gap(float(at[k].mean()), float(np.median(near[k])), SEEN)


def heard(x: float, y: float, t: float, path: Path, s: float) -> Gap:
    """By the rear axle x, y [m] that the predecessor told for t [s]; s [m]: the own arc length."""
    ahead = path.closest(x, y, s + NOSE + TAIL)
    return Gap(t, ahead - TAIL - s - NOSE, HEARD)


def _along(points: FloatArray, path: Path, s: float) -> tuple[FloatArray, FloatArray]:
    """Arc length [m] and offset [m] of points, by the part of the path that lies ahead of s."""
    spots = s + np.arange(0.0, NOSE + REACH, 2.0 * path.spacing)
    if not path.closed:
        spots = spots[spots <= path.length]
    x, y, heading = np.array([path.at(float(one))[:3] for one in spots]).T
    k = np.argmin((points[:, 0, None] - x) ** 2 + (points[:, 1, None] - y) ** 2, axis=1)
    dx = points[:, 0] - x[k]
    dy = points[:, 1] - y[k]
    c = np.cos(heading[k])
    sn = np.sin(heading[k])
    return spots[k] + c * dx + sn * dy, c * dy - sn * dx
