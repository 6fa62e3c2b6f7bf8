"""Collision avoidance: a car stops rather than come too near to another one on the same curve.

    mine    own stopping section                    [s, s + v T + v^2 / 2b]
    theirs  where the other car may be, and its stop    [s_j, s_j + travel in its age + its stop]

Both are sections of the curve. A car continues only if no point of ``mine`` is closer than
``MIN_DISTANCE`` to a point of ``theirs``: two cars that both do so never have sections that meet. A
late or lost message makes the section of the other car longer, never shorter. A car behind on the
same branch ends at this car: the car in front does not wait for it.

If the routes of two cars cross, one also stays off the section ahead of the other
(``CLEARANCE_LENGTH``), so that neither stops in the way of the other: the one that is not inside it
yet, if the other is; if neither is, the later one in the order of the ring.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.control.monitoring.course import Course
from dart_hal.control.stopping import STOP_DECELERATION
from dart_hal.core.types import FloatArray

# Distance from the rear axle to the centre of the body [m], 0.30 x 0.19 m.
CENTRE_OFFSET = 0.0875
# Distance of the centres of two bodies at which they cannot touch [m]: twice the distance to a
# corner.
MIN_BODY_DISTANCE = 0.36
# Largest distance of a car, or of its pose estimate, from the curve [m].
MAX_OFFSET = 0.05
# Smallest distance of the centres on the curve [m].
MIN_DISTANCE = MIN_BODY_DISTANCE + 2.0 * MAX_OFFSET
# Time from a decision to the brake [s]: a State, transport, lag of the motor; time between two
# messages, in which another car may decide [s].
REACTION_TIME = 0.15
MESSAGE_PERIOD = 0.05
# Largest acceleration of a car [m/s2] (``lap.MAX_LONGITUDINAL``).
MAX_ACCELERATION = 2.8
# Length of the section ahead of a stop [m]: over a crossing, two bodies and a reserve.
CLEARANCE_LENGTH = 1.0
# Distance from that section [m], so that a waiting car, which may start (0.16 m), is outside.
WAITING_DISTANCE = MIN_DISTANCE + 0.2
# Distance behind this car on its own branch, beyond which another car is ignored [m].
FOLLOWING_DISTANCE = MIN_DISTANCE + 0.1
# Distance between points of a section [m]: half of it is 5 mm of a distance, within ``MAX_OFFSET``;
# smallest approach that counts [m].
SAMPLE_SPACING = 0.06
MIN_APPROACH = 1e-3


@dataclass(frozen=True, slots=True)
class CurveSection:
    """A section of the curve, in arc length [m]."""

    begin: float
    end: float


def stopping_section(s: float, v: float) -> CurveSection:
    """Return the section of a car at s [m] with a speed v [m/s] until it is at rest."""
    v = max(v, 0.0)
    return CurveSection(
        s, s + v * (REACTION_TIME + MESSAGE_PERIOD) + 0.5 * v * v / STOP_DECELERATION
    )


def reachable_section(s: float, v: float, age: float, fastest: float) -> CurveSection:
    """Return where a car may be that was at s [m] with v [m/s] ``age`` s ago, and its stop from
    there.

    It never drives faster than ``fastest`` [m/s], nor backwards.
    """
    age = age + MESSAGE_PERIOD
    v = min(max(v, 0.0), fastest)
    travel = min(v * age + 0.5 * MAX_ACCELERATION * age * age, fastest * age)
    return replace(stopping_section(s + travel, min(v + MAX_ACCELERATION * age, fastest)), begin=s)


class CollisionGuard:
    """Collision avoidance of the cars on one curve."""

    def __init__(self, course: Course) -> None:
        self._path = course.path

    def may_continue(
        self, s: float, v: float, other: CurveSection, *, yields: bool, is_recent: bool = True
    ) -> bool:
        """Return whether a car at s [m] with v [m/s] may continue, given the section of another
        one.

        other: begins at most a lap behind s; yields: whether this car gives way to it; is_recent:
        whether its message is recent, so that its section is short and is left as a whole or not.

        1. Own stopping section against the section of the other car.
        2. If this car yields, or its section ahead contains the other car: own section against the
        extended
           section of the other car, unless this car is inside it already.
        """
        if other.begin < s:
            other = replace(other, end=min(other.end, s - FOLLOWING_DISTANCE))
        stop = stopping_section(s, v + MAX_ACCELERATION * MESSAGE_PERIOD)
        mine = self._body_centres(stop)
        theirs = self._body_centres(other)
        if self._comes_near(mine, theirs, is_recent):
            return False
        ahead = self._body_centres(replace(stop, end=stop.end + CLEARANCE_LENGTH))
        if not yields and not (_distances(ahead, theirs[:1]) < MIN_DISTANCE).any():
            return True
        extended = replace(
            other,
            end=min(other.end + CLEARANCE_LENGTH, s - FOLLOWING_DISTANCE)
            if other.begin < s
            else other.end + CLEARANCE_LENGTH,
        )
        theirs = self._body_centres(extended)
        is_inside = bool((_distances(mine[:1], theirs) < MIN_DISTANCE).any())
        return is_inside or not self._comes_near(mine, theirs, is_recent, WAITING_DISTANCE)

    def _comes_near(
        self,
        mine: FloatArray,
        theirs: FloatArray,
        is_recent: bool,
        min_distance: float = MIN_DISTANCE,
    ) -> bool:
        """Return whether a point of mine is too near to one of theirs, and nearer than the present
        position.

        The present distance is that to all of theirs if the message is recent, else to each point.
        """
        if not len(theirs):
            return False
        distances = _distances(mine, theirs)
        present = distances[0].min() if is_recent else distances[0]
        return bool(
            ((distances[1:] < min_distance) & (distances[1:] < present - MIN_APPROACH)).any()
        )

    def _body_centres(self, section: CurveSection) -> FloatArray:
        """Return the centres (n, 2) [m] of a body on a section with both ends; none if it is empty.
        """
        path = self._path
        n = (
            int(np.ceil((section.end - section.begin) / SAMPLE_SPACING)) + 2
            if section.end >= section.begin
            else 0
        )
        k = np.rint(np.linspace(section.begin, section.end, n) / path.spacing).astype(int) % len(
            path.x
        )
        return np.stack([path.x[k] + CENTRE_OFFSET * np.cos(path.heading[k]),
                         path.y[k] + CENTRE_OFFSET * np.sin(path.heading[k])], axis=-1)


def _distances(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the distances (n, m) between points (n, 2) and (m, 2)."""
    return np.asarray(np.linalg.norm(a[:, None] - b[None], axis=-1), dtype=np.float64)
