"""A route along the wall on one side, from the points of one scan.

Routes of two arcs each are tried. The best one keeps its distance to the wall and away from all
else; it ends before a collision. Where the wall ends, the route turns around its end, so a car gets
around a room and through a corridor, whatever its corners. After a full turn around a box the car
leaves it. Where no echo returns between two visible things there may be glass: a straight wall is
assumed.
"""

from __future__ import annotations

from math import cos, hypot, inf, pi, sin

import numpy as np
from scipy.spatial import cKDTree

from dart_hal.control.lane import LaneView
from dart_hal.core.types import FloatArray, Pose

# Distance between points of a route [m], number of points of its first arc and of both: a corner of
# a corridor.
ROUTE_SPACING = 0.1
FIRST_ARC_POINTS = 8
ROUTE_POINTS = 20
# Curvatures of the first and the second arc [1/m]: DART turns with 1.9, part of which remains for
# the tracker.
FIRST_CURVATURES = np.linspace(-1.7, 1.7, 15)
SECOND_CURVATURES = np.linspace(-1.6, 1.6, 9)
# Distance from the rear axle to the centre of the car's second circle [m].
FRONT_CIRCLE = 0.22
# Clearance at which the car would collide, half its width and 0.1 m; and the desired clearance [m].
MIN_CLEARANCE = 0.2
TARGET_CLEARANCE = 0.4
# Number of beams in a row without echo, of which 3 % are accidental; largest distance to the points
# on both sides of them [m].
MIN_GLASS_BEAMS = 6
MAX_GLASS_DISTANCE = 4.0
# Distance before and behind a point of the route in which its wall is searched [m].
WALL_HALF_LENGTH = 0.25
# Distance beyond the gap from which on all walls cost the same [m].
MAX_WALL_EXCESS = 0.6
# Rotation towards the wall from which on it is a box that was rounded [rad]; distance without a
# wall after it [m]. Around a room the car turns away from its walls.
BOX_ANGLE = 2.5 * pi
LEAVE_DISTANCE = 1.5
# Costs of a point in collision, of the squared lack of clearance, of the squared error of the wall
# distance, and of a squared curvature.
COLLISION_COST = 20.0
CLEARANCE_COST = 15.0
WALL_COST = 4.0
CURVATURE_COST = 0.05


class Wall:
    """Wall follower of one drive; called with each scan. side: 1 left, -1 right; gap [m]: from the
    rear axle.
    """

    def __init__(self, side: int = -1, gap: float = 0.6) -> None:
        self.side = side
        self.gap = gap
        self._min_heading = inf
        self._left_box_at = (inf, inf)

    def __call__(self, points: FloatArray, pose: Pose) -> LaneView:
        """Return the route in points (m, 2) [m; NaN = no echo], from the pose of the car in their
        frame on.

        It is empty if it is blocked or if there are no points.
        """
        c = cos(pose.yaw)
        s = sin(pose.yaw)
        dx, dy = (points - (pose.x, pose.y)).T
        local = _add_glass(np.column_stack((c * dx + s * dy, c * dy - s * dx)))
        local = local[
            np.hypot(*local.T) < ROUTE_SPACING * ROUTE_POINTS + self.gap + MAX_WALL_EXCESS
        ]
        route = (
            _plan_route(local, self, WALL_COST * self._has_wall(pose))
            if len(local)
            else np.empty((0, 2))
        )
        x, y = route.T
        return LaneView(np.column_stack((pose.x + c * x - s * y, pose.y + s * x + c * y)),
                        self.gap, self.side > 0, self.side < 0)

    def _has_wall(self, pose: Pose) -> bool:
        """Return whether the car follows a wall at a pose; False while it leaves a box."""
        turned = self.side * pose.yaw
        self._min_heading = min(self._min_heading, turned)
        if turned - self._min_heading > BOX_ANGLE:
            self._min_heading = turned
            self._left_box_at = (pose.x, pose.y)
        return hypot(pose.x - self._left_box_at[0], pose.y - self._left_box_at[1]) > LEAVE_DISTANCE


def _add_glass(points: FloatArray) -> FloatArray:
    """Return the points (m, 2) with an echo, of all in the order of the beams, and points on
    assumed glass.
    """
    echoes = np.flatnonzero(np.isfinite(points[:, 0]))
    if not len(echoes):
        return np.empty((0, 2))
    following = np.append(echoes[1:], echoes[0] + len(points))
    glass = following - echoes > MIN_GLASS_BEAMS
    panes = [points[echoes]]
    for a, b in zip(points[echoes[glass]], points[following[glass] % len(points)], strict=True):
        if max(np.hypot(*a), np.hypot(*b)) < MAX_GLASS_DISTANCE:
            n = int(np.hypot(*(b - a)) / ROUTE_SPACING) + 2
            panes.append(a + np.linspace(0.0, 1.0, n)[:, None] * (b - a))
    return np.vstack(panes)


def _plan_route(points: FloatArray, wall: Wall, wall_cost: float) -> FloatArray:
    """Return the points (n, 2) of the best route, in the frame of the car.

    cost = COLLISION_COST * points from the first collision on
           + CLEARANCE_COST * sum max(TARGET_CLEARANCE - clearance, 0)^2
           + wall_cost * sum (wall distance - gap)^2, at three points
           + CURVATURE_COST * sum curvature^2
    """
    x, y, yaw, curvature = _candidate_routes()
    tree = cKDTree(points)
    front = np.stack((x + FRONT_CIRCLE * np.cos(yaw), y + FRONT_CIRCLE * np.sin(yaw)), axis=-1)
    clearance = np.minimum(tree.query(np.stack((x, y), axis=-1))[0], tree.query(front)[0])
    blocked = np.cumsum(clearance < MIN_CLEARANCE, axis=1) > 0
    cost = COLLISION_COST * blocked.sum(axis=1) + CLEARANCE_COST * (
        np.maximum(TARGET_CLEARANCE - clearance, 0.0) ** 2
    ).sum(axis=1)
    for k in (FIRST_ARC_POINTS - 1, (FIRST_ARC_POINTS + ROUTE_POINTS) // 2, ROUTE_POINTS - 1):
        distance = _wall_distances(points, x[:, k], y[:, k], yaw[:, k], wall)
        cost += wall_cost * np.square(distance - wall.gap)
    best = int(np.argmin(cost + CURVATURE_COST * (curvature**2).sum(axis=0)))
    n = ROUTE_POINTS if not blocked[best].any() else int(np.argmax(blocked[best]))
    return np.vstack((np.zeros(2), np.column_stack((x[best, :n], y[best, :n]))))


def _candidate_routes() -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return x, y [m], yaw [rad] (routes, ROUTE_POINTS) of all, and their two curvatures (2,
    routes).
    """
    curvature = np.stack(np.meshgrid(FIRST_CURVATURES, SECOND_CURVATURES, indexing="ij")).reshape(
        2, -1
    )
    heading_changes = ROUTE_SPACING * np.where(
        np.arange(ROUTE_POINTS) < FIRST_ARC_POINTS, curvature[0][:, None], curvature[1][:, None]
    )
    yaw = np.cumsum(heading_changes, axis=1)
    middle = yaw - 0.5 * heading_changes
    return (
        ROUTE_SPACING * np.cumsum(np.cos(middle), axis=1),
        ROUTE_SPACING * np.cumsum(np.sin(middle), axis=1),
        yaw,
        curvature,
    )


def _wall_distances(points: FloatArray, x: FloatArray, y: FloatArray, yaw: FloatArray, wall: Wall
                    ) -> FloatArray:
    """Return the distance [m] (routes,) to the nearest point on the side of the wall, for one point
    of each.
    """
    c = np.cos(yaw)[:, None]
    s = np.sin(yaw)[:, None]
    dx = points[:, 0] - x[:, None]
    dy = points[:, 1] - y[:, None]
    along = c * dx + s * dy
    lateral = wall.side * (c * dy - s * dx)
    max_distance = wall.gap + MAX_WALL_EXCESS
    nearest: FloatArray = np.where(
        (np.abs(along) < WALL_HALF_LENGTH) & (lateral > 0.0), lateral, max_distance
    ).min(axis=1)
    return np.minimum(nearest, max_distance)
