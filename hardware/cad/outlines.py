"""Closed outlines of straight lines and arcs, as a cutter understands them.

An outline is a tuple of points (x, y, bulge) in mm. `bulge` belongs to the way to the next
point: 0 is a line, else tan(angle / 4) of an arc, positive counterclockwise: the definition of
DXF. The last point leads back to the first.
"""

from __future__ import annotations

import math

Point = tuple[float, float]
Outline = tuple[tuple[float, float, float], ...]


def polygon(points: list[Point]) -> Outline:
    """Straight lines through points."""
    return tuple((x, y, 0.0) for x, y in points)


def rectangle(x: float, y: float, length: float, width: float, angle: float = 0.0,
              radius: float = 0.0) -> Outline:
    """Rectangle about (x, y), `length` along the angle [deg], corners rounded by `radius`."""
    a, b, r = length / 2, width / 2, radius
    cos, sin = math.cos(math.radians(angle)), math.sin(math.radians(angle))
    round_ = math.tan(math.pi / 8)
    if r:
        corners = [(a, -b + r, 0), (a, b - r, round_), (a - r, b, 0), (-a + r, b, round_),
                   (-a, b - r, 0), (-a, -b + r, round_), (-a + r, -b, 0), (a - r, -b, round_)]
    else:
        corners = [(a, -b, 0), (a, b, 0), (-a, b, 0), (-a, -b, 0)]
    return tuple((x + u * cos - v * sin, y + u * sin + v * cos, k) for u, v, k in corners)


def arc(start: Point, end: Point, bulge: float) -> tuple[Point, float, float, float]:
    """Centre, radius, start angle and swept angle [rad, positive counterclockwise]."""
    sweep = 4 * math.atan(bulge)
    chord = math.dist(start, end)
    radius = chord / 2 / abs(math.sin(sweep / 2))
    middle = ((start[0] + end[0]) / 2, (start[1] + end[1]) / 2)
    height = chord / 2 / math.tan(sweep / 2)  # from the chord to the centre, left of the way
    nx, ny = -(end[1] - start[1]) / chord, (end[0] - start[0]) / chord
    centre = (middle[0] + nx * height, middle[1] + ny * height)
    return centre, radius, math.atan2(start[1] - centre[1], start[0] - centre[0]), sweep


def segments(outline: Outline) -> list[tuple[Point, Point, float]]:
    """(start, end, bulge) all around."""
    following = outline[1:] + outline[:1]
    return [((x, y), (nx, ny), b) for (x, y, b), (nx, ny, _) in zip(outline, following,
                                                                    strict=True)]


def middle(start: Point, end: Point, bulge: float) -> Point:
    """Point half way along a segment."""
    if bulge == 0:
        return (start[0] + end[0]) / 2, (start[1] + end[1]) / 2
    centre, radius, begin, sweep = arc(start, end, bulge)
    return (centre[0] + radius * math.cos(begin + sweep / 2),
            centre[1] + radius * math.sin(begin + sweep / 2))


def sampled(outline: Outline, step: float = 0.5) -> list[Point]:
    """Points along the outline, arcs divided into chords of about `step` mm."""
    points: list[Point] = []
    for start, end, bulge in segments(outline):
        points.append(start)
        if bulge:
            centre, radius, begin, sweep = arc(start, end, bulge)
            n = max(4, math.ceil(abs(sweep) * radius / step))
            points += [(centre[0] + radius * math.cos(begin + sweep * i / n),
                        centre[1] + radius * math.sin(begin + sweep * i / n))
                       for i in range(1, n)]
    return points


def inside(point: Point, corners: list[Point]) -> bool:
    """Whether the point lies in the polygon (even-odd rule)."""
    x, y = point
    odd = False
    for (ax, ay), (bx, by) in zip(corners, corners[1:] + corners[:1], strict=True):
        if (ay > y) != (by > y) and x < ax + (y - ay) * (bx - ax) / (by - ay):
            odd = not odd
    return odd


def to_segment(point: Point, a: Point, b: Point) -> float:
    """Distance of a point from the line between a and b, mm."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    length = dx * dx + dy * dy
    t = 0.0 if length == 0 else max(0.0, min(1.0, ((point[0] - a[0]) * dx
                                                   + (point[1] - a[1]) * dy) / length))
    return math.dist(point, (a[0] + t * dx, a[1] + t * dy))


def distance(point: Point, corners: list[Point]) -> float:
    """Distance of a point from the polygon's edge, mm."""
    return min(to_segment(point, a, b)
               for a, b in zip(corners, corners[1:] + corners[:1], strict=True))
