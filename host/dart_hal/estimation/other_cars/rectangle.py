"""Pose of a rectangle of known size from the beams around it.

A pose is judged by what each beam would measure with the rectangle there:

    expected distance = the nearer of rectangle and wall

A beam counts by its squared error in standard deviations, at most ``MAX_COST``. So beams that pass
through the rectangle contradict it, as those do that end on something else. A beam that ends before
the rectangle means little: something is in front of it.

The visible sides need no separate treatment, since the hidden ones are not expected to be hit.
"""

from __future__ import annotations

from math import hypot
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import FloatArray
from dart_hal.estimation.other_cars.sweep import RoomBeams

# m: noise of a distance with what else is not modelled: mixed pixels, error of the own pose.
RANGE_STD = 0.025
# Largest cost of a beam, and that of one which something in front of the rectangle ends.
MAX_COST = 9.0
SHADOW_COST = 3.0
# The costs of neighbouring beams are divided by this, because their errors are common.
COST_DIVISOR = 2.0
# m around the circumscribed circle of a rectangle: its beams are judged, too.
WINDOW_MARGIN = 0.15
# s from the median time of the beams of a window: the first and the last beams of a turn meet at
# one angle, with the time of a turn between them.
MAX_TIME_SPREAD = 0.02


class CarSize(NamedTuple):
    """length, width [m] of the body; centre_x [m]: its centre from the
    rear axle."""

    length: float
    width: float
    centre_x: float


class RectangleFit(NamedTuple):
    """Poses of a rear axle that explain the beams.

    mean (3,): x, y [m], yaw [rad]; cov (3, 3); hits: beams that end on the rectangle of the mean;
    due: beams that should hit it, without those that end before it; share: hits among them;
    shadowed: whether most beams end before it.
    """

    mean: FloatArray
    cov: FloatArray
    hits: int
    due: int
    share: float
    shadowed: bool


def select_window(sweep: RoomBeams, centre: FloatArray, size: CarSize) -> RoomBeams:
    """Return the beams that pass near a centre (2,) [m], all of about one time."""
    offset = centre - sweep.origin
    along = (offset * sweep.direction).sum(axis=1)
    across = np.abs(offset[:, 0] * sweep.direction[:, 1] - offset[:, 1] * sweep.direction[:, 0])
    radius = 0.5 * hypot(size.length, size.width) + WINDOW_MARGIN
    found = sweep.select((along > 0.0) & (across < radius))
    if not len(found.t):
        return found
    return found.select(np.abs(found.t - np.median(found.t)) < MAX_TIME_SPREAD)


def rectangle_distances(poses: FloatArray, size: CarSize, sweep: RoomBeams) -> FloatArray:
    """Return the distances (h, n) [m] along n beams to rectangles with axle poses (h, 3)."""
    c = np.cos(poses[:, 2:])
    s = np.sin(poses[:, 2:])
    dx = sweep.origin[:, 0] - poses[:, :1]
    dy = sweep.origin[:, 1] - poses[:, 1:2]
    ux, uy = sweep.direction.T
    near = np.full(dx.shape, -np.inf)
    far = np.full(dx.shape, np.inf)
    # In the axes of the rectangle, a beam is inside the strip of each pair of sides between two
    # distances; it is inside the rectangle where both intervals overlap.
    sides = ((c * dx + s * dy - size.centre_x, c * ux + s * uy, 0.5 * size.length),
             (c * dy - s * dx, c * uy - s * ux, 0.5 * size.width))
    for start, slope, half in sides:
        inverse = 1.0 / np.where(np.abs(slope) < 1e-9, 1e-9, slope)
        middle = -start * inverse
        reach = np.abs(half * inverse)
        near = np.maximum(near, middle - reach)
        far = np.minimum(far, middle + reach)
    return np.where((near <= far) & (near > 0.0), near, np.inf)


def fit_rectangle(poses: FloatArray, size: CarSize, sweep: RoomBeams) -> RectangleFit:
    """Weigh poses (h, 3), drawn from what is known before, by the beams; return their mean.

    Yaws may differ by less than half a turn. The sweep has at least one beam.
    """
    distance = rectangle_distances(poses, size, sweep)
    expected = np.minimum(distance, sweep.wall)
    error = (sweep.range - expected) / RANGE_STD
    cost = np.minimum(error * error, MAX_COST)
    cost[(distance < sweep.wall) & (error < -3.0)] = SHADOW_COST
    total = cost.sum(axis=1)
    weight = np.exp(-0.5 / COST_DIVISOR * (total - total.min()))
    weight /= weight.sum()
    mean = weight @ poses
    off = poses - mean
    cov = (weight[:, None] * off).T @ off
    reach = rectangle_distances(mean[None], size, sweep)[0]
    miss = (sweep.range - reach) / RANGE_STD
    expects = reach < sweep.wall
    hits = int(np.sum(expects & (np.abs(miss) <= 3.0)))
    shadows = int(np.sum(expects & (miss < -3.0)))
    due = int(np.sum(expects)) - shadows
    return RectangleFit(mean, cov, hits, due, hits / max(due, 1), shadows > due)
