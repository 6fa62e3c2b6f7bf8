"""Three layouts with lanes on the right: a four-way intersection, a merge, a roundabout.

The ground is around (0, 0); cars come from the arms S, E, N, W. No bend is tighter than
``MIN_RADIUS``.
"""

from __future__ import annotations

from math import atan2, cos, pi, sin, sqrt

from dart_hal.control.crossing.layout import MIN_CAR_DISTANCE, CrossingLayout, Route
from dart_hal.control.paths import Path, Segment

# Distance from the middle of a road to that of a lane [m]: two lanes have a distance of 0.5 m.
LANE_OFFSET = 0.25
# Smallest radius [m]: DART turns within 0.41 to 0.55 m.
MIN_RADIUS = 0.6
# Length of a lane before and after the bends [m]: two cars of one lane start and end in them.
APPROACH_LENGTH = 2.6
EXIT_LENGTH = 3.0
# Radius of the roundabout [m]: the distance to the first exit is still 0.3 m.
RING_RADIUS = 0.9
# Angle of the ramp [rad], and radius of the bend by which it joins [m].
RAMP_ANGLE = pi / 6
RAMP_RADIUS = 1.2
# Speed of the cars [m/s].
DEFAULT_SPEED = 1.0
ARMS = ("S", "E", "N", "W")


def intersection(
    speed: float = DEFAULT_SPEED,
    lane_offset: float = LANE_OFFSET,
    min_distance: float = MIN_CAR_DISTANCE,
) -> CrossingLayout:
    """Return four arms, each with routes left, straight on and right: "S-N" comes from S, leaves to
    N.

    lane_offset [m]: from the middle of the road to that of a lane. Raises UsageError for lanes that
    are too close.
    """
    box = MIN_RADIUS + lane_offset
    left_radius = box + lane_offset
    turns: tuple[tuple[Segment, ...], ...] = (
        ((0.5 * pi * MIN_RADIUS, -1.0 / MIN_RADIUS),),
        ((2.0 * box, 0.0),),
        ((0.5 * pi * left_radius, 1.0 / left_radius),),
    )
    return CrossingLayout(
        "intersection", _make_routes(turns, box, lane_offset), speed, min_distance
    )


def roundabout(
    speed: float = DEFAULT_SPEED,
    lane_offset: float = LANE_OFFSET,
    min_distance: float = MIN_CAR_DISTANCE,
) -> CrossingLayout:
    """Return four arms around a ring that is driven to the left. Raises as ``intersection``."""
    lateral = lane_offset + MIN_RADIUS
    radius = RING_RADIUS + MIN_RADIUS
    box = sqrt(radius**2 - lateral**2)
    turn = atan2(box, lateral)
    bend: Segment = (MIN_RADIUS * turn, -1.0 / MIN_RADIUS)
    turns = tuple(
        (bend, (RING_RADIUS * (2.0 * turn + more), 1.0 / RING_RADIUS), bend)
        for more in (-0.5 * pi, 0.0, 0.5 * pi)
    )
    return CrossingLayout("roundabout", _make_routes(turns, box, lane_offset), speed, min_distance)


def merge(speed: float = DEFAULT_SPEED, min_distance: float = MIN_CAR_DISTANCE) -> CrossingLayout:
    """Return a lane, and a ramp from its right that joins it at (0, 0): routes "lane" and "ramp".
    """
    bend = RAMP_RADIUS * RAMP_ANGLE
    x = -RAMP_RADIUS * sin(RAMP_ANGLE)
    y = -RAMP_RADIUS * (1.0 - cos(RAMP_ANGLE))
    start = (
        x - 2.0 * APPROACH_LENGTH * cos(RAMP_ANGLE),
        y - 2.0 * APPROACH_LENGTH * sin(RAMP_ANGLE),
        RAMP_ANGLE,
    )
    length = 2.0 * APPROACH_LENGTH + bend
    routes = (
        Route(
            "lane",
            "lane",
            Path([(length + EXIT_LENGTH, 0.0)], closed=False, start=(-length, 0.0, 0.0)),
        ),
        Route(
            "ramp",
            "ramp",
            Path(
                [(2.0 * APPROACH_LENGTH, 0.0), (bend, -1.0 / RAMP_RADIUS), (EXIT_LENGTH, 0.0)],
                closed=False,
                start=start,
            ),
        ),
    )
    return CrossingLayout("merge", routes, speed, min_distance)


def _make_routes(
    turns: tuple[tuple[Segment, ...], ...], box: float, lane_offset: float
) -> tuple[Route, ...]:
    """Return the routes of four arms.

    turns: segments from ``box`` m before the centre to ``box`` m behind it, to the right, straight
    on, to the left.
    """
    routes = []
    for k, arm in enumerate(ARMS):
        heading = 0.5 * pi * (k + 1)
        c = cos(heading)
        s = sin(heading)
        start_distance = box + APPROACH_LENGTH
        start = (
            -start_distance * c + lane_offset * s,
            -start_distance * s - lane_offset * c,
            heading,
        )
        for arm_step, turn in enumerate(turns, start=1):
            path = Path(
                [(APPROACH_LENGTH, 0.0), *turn, (EXIT_LENGTH, 0.0)], closed=False, start=start
            )
            routes.append(Route(f"{arm}-{ARMS[(k + arm_step) % 4]}", arm, path))
    return tuple(routes)


LAYOUTS = {"intersection": intersection, "merge": merge, "roundabout": roundabout}
