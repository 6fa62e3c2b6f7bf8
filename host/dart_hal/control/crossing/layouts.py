"""Three layouts with lanes on the right: a four-way intersection, a merge, a roundabout.

The ground is about (0, 0); cars come from the arms S, E, N, W. Bends have at least ``BEND``.
"""

from __future__ import annotations

from math import atan2, cos, pi, sin, sqrt

from dart_hal.control.crossing.layout import APART, Layout, Route
from dart_hal.control.paths import Path, Segment

# m from the middle of a road to that of a lane: two lanes are 0.5 m apart.
BESIDE = 0.25
# m, the tightest: DART turns within 0.41 to 0.55 m.
BEND = 0.6
# m of a lane before and behind the bends: two cars of one lane start and end in them.
APPROACH = 2.6
AWAY = 3.0
# m, radius of the roundabout: its way to the first exit is still 0.3 m.
RING = 0.9
# rad of the ramp, and m of the bend by which it joins.
SLANT = pi / 6
JOIN = 1.2
# m/s.
SPEED = 1.0
ARMS = ("S", "E", "N", "W")


def intersection(speed: float = SPEED, beside: float = BESIDE, apart: float = APART) -> Layout:
    """Four arms, each with the ways left, straight on and right: "S-N" comes from S, leaves to N.

    Raises UsageError where the lanes, ``beside`` m off the middle, are too near to each other.
    """
    box = BEND + beside
    wide = box + beside
    ways: tuple[tuple[Segment, ...], ...] = (
        ((0.5 * pi * BEND, -1.0 / BEND),),
        ((2.0 * box, 0.0),),
        ((0.5 * pi * wide, 1.0 / wide),),
    )
    return Layout("intersection", _arms(ways, box, beside), speed, apart)


def roundabout(speed: float = SPEED, beside: float = BESIDE, apart: float = APART) -> Layout:
    """Four arms about a ring that is driven to the left. Raises UsageError as ``intersection``."""
    across = beside + BEND
    reach = RING + BEND
    box = sqrt(reach**2 - across**2)
    turn = atan2(box, across)
    bend: Segment = (BEND * turn, -1.0 / BEND)
    ways = tuple(
        (bend, (RING * (2.0 * turn + more), 1.0 / RING), bend)
        for more in (-0.5 * pi, 0.0, 0.5 * pi)
    )
    return Layout("roundabout", _arms(ways, box, beside), speed, apart)


def merge(speed: float = SPEED, apart: float = APART) -> Layout:
    """A lane, and a ramp from its right that joins it at (0, 0): routes "lane" and "ramp"."""
    bend = JOIN * SLANT
    x = -JOIN * sin(SLANT)
    y = -JOIN * (1.0 - cos(SLANT))
    start = x - 2.0 * APPROACH * cos(SLANT), y - 2.0 * APPROACH * sin(SLANT), SLANT
    way = 2.0 * APPROACH + bend
    routes = (
        Route("lane", "lane", Path([(way + AWAY, 0.0)], closed=False, start=(-way, 0.0, 0.0))),
        Route(
            "ramp",
            "ramp",
            Path(
                [(2.0 * APPROACH, 0.0), (bend, -1.0 / JOIN), (AWAY, 0.0)], closed=False, start=start
            ),
        ),
    )
    return Layout("merge", routes, speed, apart)


def _arms(ways: tuple[tuple[Segment, ...], ...], box: float, beside: float) -> tuple[Route, ...]:
    """Routes of four arms; ways: from ``box`` m before the middle to ``box`` m behind it, to the
    right, straight on, to the left."""
    routes = []
    for k, arm in enumerate(ARMS):
        heading = 0.5 * pi * (k + 1)
        c = cos(heading)
        s = sin(heading)
        back = box + APPROACH
        start = -back * c + beside * s, -back * s - beside * c, heading
        for turned, way in enumerate(ways, start=1):
            path = Path([(APPROACH, 0.0), *way, (AWAY, 0.0)], closed=False, start=start)
            routes.append(Route(f"{arm}-{ARMS[(k + turned) % 4]}", arm, path))
    return tuple(routes)


LAYOUTS = {"intersection": intersection, "merge": merge, "roundabout": roundabout}
