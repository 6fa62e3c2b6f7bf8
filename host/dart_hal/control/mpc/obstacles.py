"""Obstacles near a path, as bounds of the lateral error at each stage.

    e_c >= e_o + R - CORRIDOR_RAMP max(|s - s_o| - L, 0)      passed on its left
    e_c <= e_o - R + CORRIDOR_RAMP max(|s - s_o| - L, 0)      passed on its right

    e_c, s     lateral error and arc length of the car's centre; e_o, s_o: of the obstacle's centre
    R          its radius + HALF_WIDTH + LATERAL_MARGIN
    L          R + PLATEAU_LENGTH + spread (t - t_o), along the path

The corridor narrows along a ramp, because a bound that appears suddenly makes the plan jump. The
side is the one with more space. It is kept for an encounter, unless a moving obstacle comes over
to it.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import cos, hypot, inf, sin
from typing import Any

import numpy as np

from dart_hal.control.paths import Path
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray

# Lateral change per distance along the path: at 2 m/s within the curvature that the car can drive.
CORRIDOR_RAMP = 0.4
# Half size of the body [m].
HALF_LENGTH = 0.15
HALF_WIDTH = 0.10
# Distance beyond the body [m]: 5 cm of clearance; 2.5 cm for the corners of a body at 0.17 rad to
# the path; 1.5 cm by which a bend of 0.75 m deviates from the straight side (0.15^2 / 1.5 m); three
# times the lateral error of 1.0 cm with 1 cm of pose noise, as twice that is exceeded once in fifty
# passes.
LATERAL_MARGIN = 0.12
# Distance to the edge of the lane that a passage needs [m]: a drive ends at the edge, and next to
# an obstacle the car has lateral errors of 2 to 3 cm.
OBSTACLE_LANE_MARGIN = 0.04
# Distance along the path, beyond R, over which the full offset is kept [m].
PLATEAU_LENGTH = 0.05
# Distance at which a side is chosen [m]: 1.5 s at 2 m/s.
SIDE_CHOICE_DISTANCE = 3.0
# Distance past the obstacle at which the side is forgotten [m].
SIDE_RELEASE_DISTANCE = 1.0
# Distance [m] from the expected place within which it is the same obstacle: a body length. The
# centres of two cars in one lane are further apart.
MAX_OBSTACLE_JUMP = 2.0 * HALF_LENGTH
# Offset [m] by which a moving obstacle may come to the chosen side before the other one is chosen:
# more than the noise of the pose of another car.
MAX_OFFSET_TO_KEEP_SIDE = 0.05


@dataclass(frozen=True, slots=True)
class Obstacle:
    """A disc in path coordinates.

    s, offset [m]: arc length and lateral position of its centre at time t [s]; radius [m];
    speed [m/s]: along the path; spread [m/s]: growth of its uncertainty along the path.
    """

    s: float
    offset: float
    radius: float
    speed: float = 0.0
    t: float = 0.0
    spread: float = 0.0

    def __post_init__(self) -> None:
        if not self.radius >= 0.0:
            raise UsageError("the radius of an obstacle is no length", found=repr(self.radius),
                             expected="m, 0 or more", remedy="Obstacle(s, offset, radius=0.15)")


@dataclass(frozen=True, slots=True)
class Disc:
    """A disc in the frame of the poses: x, y, radius [m]; speed [m/s] along the path."""

    x: float
    y: float
    radius: float
    speed: float = 0.0

    def locate(self, path: Path, t: float, reach: float = 0.0) -> tuple[Obstacle, ...]:
        """Return the disc in path coordinates at time t [s].

        By the nearest point of the path, and by that of each other branch within ``reach`` [m]: a
        figure of eight passes a disc at its crossing twice. A disc that moves is on the first.
        """
        distance = np.hypot(path.x - self.x, path.y - self.y)
        nearest = int(np.argmin(distance))
        # Stretches of the path within reach, each with its nearest point.
        near = np.flatnonzero(distance < reach)
        stretches = np.split(near, np.flatnonzero(np.diff(near) > 1) + 1) if len(near) else []
        if len(stretches) > 1 and path.closed and near[0] == 0 and near[-1] == len(distance) - 1:
            stretches[0] = np.concatenate((stretches.pop(), stretches[0]))
        found = {nearest}
        if not self.speed:
            found |= {int(one[np.argmin(distance[one])]) for one in stretches}
        return tuple(self._locate_near(path, t, float(path.s[k]))
                     for k in sorted(found, key=lambda k: float(distance[k])))

    def _locate_near(self, path: Path, t: float, s_guess: float) -> Obstacle:
        """Return the disc by the point nearest to an arc length [m].

        The path is continued straight beyond its ends.
        """
        s = path.closest(self.x, self.y, s_guess)
        spot = path.interpolate(s)
        s += cos(spot.heading) * (self.x - spot.x) + sin(spot.heading) * (self.y - spot.y)
        return Obstacle(s, path.offset(self.x, self.y, s), self.radius, self.speed, t)


def required_offset(o: Obstacle) -> float:
    """Offset from the path [m] with which the car passes the obstacle on its wider side."""
    return o.radius + HALF_WIDTH + LATERAL_MARGIN - abs(o.offset)


def clearance(x: float, y: float, yaw: float, o: Obstacle, path: Path, t: float) -> float:
    """Distance [m] between the body, whose centre is at x, y [m], and an obstacle at t [s].

    It is negative if they overlap.
    """
    centre = path.interpolate(o.s + o.speed * (t - o.t))
    dx = centre.x - o.offset * sin(centre.heading) - x
    dy = centre.y + o.offset * cos(centre.heading) - y
    along = abs(dx * cos(yaw) + dy * sin(yaw)) - HALF_LENGTH
    across = abs(dy * cos(yaw) - dx * sin(yaw)) - HALF_WIDTH
    distance = hypot(max(along, 0.0), max(across, 0.0)) + min(max(along, across), 0.0)
    return distance - o.radius


class Corridor:
    """The lane [m] to either side, reduced by the obstacles."""

    def __init__(self, lane: float, length: float = inf) -> None:
        """length [m]: of a closed path, on which an obstacle is met once a lap."""
        self.lane = lane
        self._length = length
        self._obstacles: tuple[Obstacle, ...] = ()
        self.blocked = False
        self._sides: dict[Obstacle, float] = {}

    @property
    def obstacles(self) -> tuple[Obstacle, ...]:
        """Obstacles that reduce the lane; may be set at any time."""
        return self._obstacles

    @obstacles.setter
    def obstacles(self, obstacles: tuple[Obstacle, ...]) -> None:
        sides = {o: self._find_side(o) for o in obstacles}
        self._obstacles = obstacles
        self._sides = {o: side for o, side in sides.items() if side}

    def bounds(self, s: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return (low, high) [m] of the lateral error of the car's centre at progresses s [m],
        times t.

        Sets ``blocked``: whether low is above high anywhere.
        """
        low = np.full(len(s), -self.lane)
        high = np.full(len(s), self.lane)
        for o in self.obstacles:
            s_obstacle = o.s + o.speed * (t - o.t)
            distance = self._wrap(s - s_obstacle)
            side = self._choose_side(o, float(distance[0]))
            if not side:
                continue
            required = o.radius + HALF_WIDTH + LATERAL_MARGIN
            plateau = required + PLATEAU_LENGTH + o.spread * np.maximum(t - o.t, 0.0)
            excess = np.maximum(np.abs(distance) - plateau, 0.0)
            edge = side * o.offset + required - CORRIDOR_RAMP * excess
            # Passed on its left: a lower bound; on its right: an upper bound.
            if side > 0.0:
                low = np.maximum(low, edge)
            else:
                high = np.minimum(high, -edge)
        self.blocked = bool((low > high).any())
        return low, high

    def _find_side(self, o: Obstacle) -> float:
        """Return the side that is chosen for this obstacle, as it was seen before; 0: none."""
        nearest = MAX_OBSTACLE_JUMP
        found = 0.0
        width = self.lane - OBSTACLE_LANE_MARGIN - o.radius - HALF_WIDTH - LATERAL_MARGIN
        for before, side in self._sides.items():
            along = self._wrap(o.s - before.s - before.speed * (o.t - before.t))
            jump = hypot(along, o.offset - before.offset)
            if jump < nearest and side * o.offset <= max(MAX_OFFSET_TO_KEEP_SIDE, width):
                nearest = jump
                found = side
        return found

    def _wrap(self, distance: Any) -> Any:
        """Return distances along the path [m] the short way round, if it is closed."""
        if not np.isfinite(self._length):
            return distance
        return distance - self._length * np.round(distance / self._length)

    def _choose_side(self, o: Obstacle, distance: float) -> float:
        """1: pass on its left, -1: on its right, 0: it is too far away."""
        if not -SIDE_CHOICE_DISTANCE < distance < SIDE_RELEASE_DISTANCE:
            self._sides.pop(o, None)
            return 0.0
        return self._sides.setdefault(o, 1.0 if o.offset <= 0.0 else -1.0)
