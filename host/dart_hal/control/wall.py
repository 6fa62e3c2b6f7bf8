"""A way along the wall on one side, out of the points of one scan.

Ways of two arcs each are tried. The best keeps its distance to the wall and away from all else; it
ends before what it would meet. Where the wall ends, the way turns after it: so a car comes around a
room, and through a corridor, whatever its corners. One that has gone around a box leaves it. Where
nothing comes back between two things that are seen, there may be glass: a straight wall is put.
"""

from __future__ import annotations

from math import cos, hypot, inf, pi, sin

import numpy as np
from scipy.spatial import cKDTree

from dart_hal.control.lane import Sight
from dart_hal.core.types import FloatArray, Pose

# m from point to point of a way, points of its first arc, and of both: a corner of a corridor.
STEP = 0.1
FIRST = 8
STEPS = 20
# 1/m of the first and the second arc: DART turns by 1.9, and keeps some of it to steer.
BENDS = np.linspace(-1.7, 1.7, 15)
LATER = np.linspace(-1.6, 1.6, 9)
# m from the rear axle to where the car's second circle is.
NOSE = 0.22
# m from a point that the car would touch, half its width and 0.1; and that is wished.
BODY = 0.2
AWAY = 0.4
# Beams in a row that do not come back, of which 3 % do not by accident; m from the car to what is
# seen on both sides of them.
GLASS = 6
WITHIN = 4.0
# m before and behind a point of the way in which its wall is looked for.
BESIDE = 0.25
# m more than asked for at which no wall is seen as one: it pulls at the way alike.
OPEN = 0.6
# rad turned towards the wall from which on it is a box, which is gone around; m of way on which
# there is no wall then. Around a room the car turns away from its walls.
ROUND = 2.5 * pi
LEAVES = 1.5
# What a point that is touched, the square of a distance lacking, the square of one from the wall
# that is wrong, and the square of a bend cost.
TOUCH = 20.0
NEAR = 15.0
OFF = 4.0
BENT = 0.05


class Wall:
    """One drive; called with each scan. side: 1 left, -1 right; gap [m] from the rear axle."""

    def __init__(self, side: int = -1, gap: float = 0.6) -> None:
        self.side = side
        self.gap = gap
        self._least = inf
        self._left = (inf, inf)

    def __call__(self, points: FloatArray, pose: Pose) -> Sight:
        """The way in points (m, 2) [m; NaN = nothing came back], from the car's pose among them
        on. Empty where it is blocked, or nothing is seen."""
        c = cos(pose.yaw)
        s = sin(pose.yaw)
        dx, dy = (points - (pose.x, pose.y)).T
        at = _closed(np.column_stack((c * dx + s * dy, c * dy - s * dx)))
        at = at[np.hypot(*at.T) < STEP * STEPS + self.gap + OPEN]
        way = _way(at, self, OFF * self._follows(pose)) if len(at) else np.empty((0, 2))
        x, y = way.T
        return Sight(np.column_stack((pose.x + c * x - s * y, pose.y + s * x + c * y)),
                     self.gap, self.side > 0, self.side < 0)

    def _follows(self, pose: Pose) -> bool:
        """Whether there is a wall for the car at a pose, or a box that it leaves."""
        turned = self.side * pose.yaw
        self._least = min(self._least, turned)
        if turned - self._least > ROUND:
            self._least = turned
            self._left = (pose.x, pose.y)
        return hypot(pose.x - self._left[0], pose.y - self._left[1]) > LEAVES


def _closed(at: FloatArray) -> FloatArray:
    """Points (m, 2) that came back, of all in the order of the beams; and of what may be glass."""
    seen = np.flatnonzero(np.isfinite(at[:, 0]))
    if not len(seen):
        return np.empty((0, 2))
    after = np.append(seen[1:], seen[0] + len(at))
    glass = after - seen > GLASS
    panes = [at[seen]]
    for a, b in zip(at[seen[glass]], at[after[glass] % len(at)], strict=True):
        if max(np.hypot(*a), np.hypot(*b)) < WITHIN:
            n = int(np.hypot(*(b - a)) / STEP) + 2
            panes.append(a + np.linspace(0.0, 1.0, n)[:, None] * (b - a))
    return np.vstack(panes)


def _way(at: FloatArray, wall: Wall, off_cost: float) -> FloatArray:
    """Points (n, 2) of the best way, in the car's axes."""
    x, y, yaw, bend = _ways()
    tree = cKDTree(at)
    nose = np.stack((x + NOSE * np.cos(yaw), y + NOSE * np.sin(yaw)), axis=-1)
    clear = np.minimum(tree.query(np.stack((x, y), axis=-1))[0], tree.query(nose)[0])
    blocked = np.cumsum(clear < BODY, axis=1) > 0
    cost = TOUCH * blocked.sum(axis=1) + NEAR * (np.maximum(AWAY - clear, 0.0)**2).sum(axis=1)
    for k in (FIRST - 1, (FIRST + STEPS) // 2, STEPS - 1):
        off = _beside(at, x[:, k], y[:, k], yaw[:, k], wall)
        cost += off_cost * np.square(off - wall.gap)
    best = int(np.argmin(cost + BENT * (bend**2).sum(axis=0)))
    n = STEPS if not blocked[best].any() else int(np.argmax(blocked[best]))
    return np.vstack((np.zeros(2), np.column_stack((x[best, :n], y[best, :n]))))


def _ways() -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
    """x, y [m], yaw [rad] (ways, STEPS) of all, and their two bends (2, ways)."""
    bend = np.stack(np.meshgrid(BENDS, LATER, indexing="ij")).reshape(2, -1)
    turns = STEP * np.where(np.arange(STEPS) < FIRST, bend[0][:, None], bend[1][:, None])
    yaw = np.cumsum(turns, axis=1)
    middle = yaw - 0.5 * turns
    return (STEP * np.cumsum(np.cos(middle), axis=1), STEP * np.cumsum(np.sin(middle), axis=1),
            yaw, bend)


def _beside(at: FloatArray, x: FloatArray, y: FloatArray, yaw: FloatArray, wall: Wall
            ) -> FloatArray:
    """Distance [m] (ways,) to what is nearest on the wall's side of one point of each."""
    c = np.cos(yaw)[:, None]
    s = np.sin(yaw)[:, None]
    dx = at[:, 0] - x[:, None]
    dy = at[:, 1] - y[:, None]
    along = c * dx + s * dy
    off = wall.side * (c * dy - s * dx)
    far = wall.gap + OPEN
    nearest: FloatArray = np.where((np.abs(along) < BESIDE) & (off > 0.0), off, far).min(axis=1)
    return np.minimum(nearest, far)
