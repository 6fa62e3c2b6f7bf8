"""Several cars in one room: each lidar sees the bodies of the others, contacts are reported.

``sim://?world=NAME&at=X,Y,YAW``: cars of this process with the same world name share one room and
start at the pose ``at``. Each world keeps its own clock. At time t the others see a car where it
was at t by its own clock, or at its latest pose if its clock is behind, which is at most 10 ms for
cars in lockstep. A contact is reported but not simulated: the cars drive through each other.
"""

from __future__ import annotations

import logging
from bisect import bisect_right
from collections import deque
from collections.abc import Callable
from math import atan2, cos, hypot, inf, sin
from zlib import crc32

import numpy as np

from dart_hal.core.errors import UsageError
from dart_hal.core.types import Contact, FloatArray
from dart_hal.core.url import Url
from dart_lab.sim.lidar.maps import box
from dart_lab.sim.light.world import CAR_OUTLINE

# Distance from the centre of a body to its corner [m].
CORNER_RADIUS = 0.5 * hypot(CAR_OUTLINE.length, CAR_OUTLINE.width)
# Range of an X4 lidar with some margin [m].
LIDAR_RANGE = 12.0
# Poses of the trail of a car, 5 ms apart: 2 s, longer than a revolution of the lidar.
TRAIL_POSES = 400
# Poses between two checks for contacts: 20 ms, in which two cars that meet at 1 m/s approach by
# 4 cm.
POSES_PER_CHECK = 4
_NO_LINES = np.empty((0, 4))

log = logging.getLogger("dart_hal")
Pose = tuple[float, float, float]
_arenas: dict[str, Arena] = {}


class ArenaCar:
    """One car of an arena with its recent poses; its world calls ``trail`` with each pose."""

    def __init__(self, arena: Arena, name: str, start: Pose) -> None:
        self.arena = arena
        self.name = name
        self.start = start
        self.touching: set[ArenaCar] = set()
        self._poses: deque[tuple[float, Pose]] = deque(maxlen=TRAIL_POSES)
        self._count = 0
        self._turn = cos(start[2]), sin(start[2])

    def trail(self, t: float, x: float, y: float, yaw: float) -> None:
        """Record the rear axle at t [s], in the frame of the car's start."""
        # Rotate by the yaw of the start, then shift to it: from the frame of the start to the room.
        c, s = self._turn
        x0, y0, yaw0 = self.start
        self._poses.append((t, (x0 + c * x - s * y, y0 + s * x + c * y, yaw0 + yaw)))
        self._count += 1
        if self._count % POSES_PER_CHECK == 0:
            self.arena.update_contacts(self, t)

    def pose(self, t: float) -> Pose:
        """Return x, y [m], yaw [rad] in the room at t [s], linear between two recorded poses."""
        # One atomic copy, because other threads append.
        poses = tuple(self._poses)
        if not poses:
            return self.start
        k = bisect_right(poses, (t, (inf, inf, inf)))
        if k in (0, len(poses)):
            return poses[min(k, len(poses) - 1)][1]
        t0, a = poses[k - 1]
        t1, b = poses[k]
        part = (t - t0) / (t1 - t0)
        return (a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]),
                a[2] + part * (b[2] - a[2]))

    def body_centre(self, t: float = inf) -> Pose:
        """Return the pose of the centre of the body at t [s], default the latest."""
        x, y, yaw = self.pose(t)
        return x + CAR_OUTLINE.ahead * cos(yaw), y + CAR_OUTLINE.ahead * sin(yaw), yaw

    def visible_outlines(self, t: float) -> FloatArray:
        """Return lines (m, 4) [m] of the bodies in range of this car's lidar at t [s]."""
        here = self.pose(t)
        outlines = []
        for place in self.arena.places:
            if place is not self:
                # Beyond the range of the lidar a body has no echo, and costs a ray test for each
                # beam.
                x, y, yaw = place.body_centre(t)
                if hypot(x - here[0], y - here[1]) < LIDAR_RANGE:
                    outlines.append(box(x, y, yaw, CAR_OUTLINE.length, CAR_OUTLINE.width))
        return np.vstack(outlines) if outlines else _NO_LINES

    def leave(self) -> None:
        """Remove the car, which has been closed."""
        self.arena.leave(self)


class Arena:
    """The cars of one room; ``contacts`` in the order in which they began."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.places: tuple[ArenaCar, ...] = ()
        self.contacts: list[Contact] = []

    def enter(self, name: str, start: Pose) -> ArenaCar:
        """Add a car; the second one of a name is called NAME-2."""
        names = {place.name for place in self.places}
        number = 1
        while (unique := name if number == 1 else f"{name}-{number}") in names:
            number += 1
        place = ArenaCar(self, unique, start)
        self.places = (*self.places, place)
        return place

    def leave(self, place: ArenaCar) -> None:
        """Remove a car, and the arena with its last one."""
        self.places = tuple(one for one in self.places if one is not place)
        if not self.places:
            _arenas.pop(self.name, None)

    def update_contacts(self, place: ArenaCar, t: float) -> None:
        """Find the cars that touch this one at t [s]; record a contact when it begins."""
        mine = place.body_centre()
        for other in self.places:
            if other is place:
                continue
            its = other.body_centre()
            near = hypot(its[0] - mine[0], its[1] - mine[1]) < 2.0 * CORNER_RADIUS
            if not (near and bodies_overlap(mine, its)):
                place.touching.discard(other)
                other.touching.discard(place)
            elif other not in place.touching:
                place.touching.add(other)
                other.touching.add(place)
                contact = Contact(t, (place.name, other.name), 0.5 * (mine[0] + its[0]),
                                  0.5 * (mine[1] + its[1]))
                self.contacts.append(contact)
                log.warning("%s and %s touch at t = %.2f s, x %.2f m, y %.2f m of world=%s",
                            *contact.cars, t, contact.x, contact.y, self.name)


def bodies_overlap(a: Pose, b: Pose) -> bool:
    """Return whether two bodies with these centre poses overlap.

    Separating axes: two rectangles overlap unless they are separate along a side of one of them.
    Their centres are a vector (dx, dy) apart; its part along a side is compared with the sum of the
    half extents of both bodies in that direction.
    """
    dx = b[0] - a[0]
    dy = b[1] - a[1]
    c = abs(cos(b[2] - a[2]))
    s = abs(sin(b[2] - a[2]))
    half_l = 0.5 * CAR_OUTLINE.length
    half_w = 0.5 * CAR_OUTLINE.width
    long = half_l * (1.0 + c) + half_w * s
    wide = half_w * (1.0 + c) + half_l * s
    distance = hypot(dx, dy)
    bearing = atan2(dy, dx)
    return all(distance * abs(cos(bearing - yaw)) < long
               and distance * abs(sin(bearing - yaw)) < wide for yaw in (a[2], b[2]))


def room_seed(url: Url, seed: int) -> int:
    """Return the seed of the room of a URL: the cars of one world share a room."""
    name = url.options.get("world")
    return seed if name is None else crc32(name.encode())


def parse_start(url: Url) -> Pose | None:
    """Return the start x, y [m], yaw [rad] of ``at=X,Y,YAW``, or None. Raises UsageError."""
    text = url.options.get("at")
    if text is None:
        return None
    try:
        x, y, yaw = (float(part) for part in text.split(","))
        if not all(abs(v) < 1e4 for v in (x, y, yaw)):
            raise ValueError
    except ValueError as why:
        raise UsageError(f"at={text} is no pose", found=url.text,
                         expected="at=X,Y,YAW [m, m, rad] of the rear axle in the room") from why
    return x, y, yaw


def enter_arena(url: Url, name: str) -> ArenaCar | None:
    """Add a car to the world that its URL names; None without one. Raises UsageError."""
    world = url.options.get("world")
    start = parse_start(url)
    if world is None:
        return None
    if not world or start is None:
        raise UsageError("a car in a shared world needs a name of the world and a start pose",
                         found=url.text,
                         expected="world=lab&at=X,Y,YAW [m, m, rad]")
    return _arenas.setdefault(world, Arena(world)).enter(name, start)


def contacts_with(place: ArenaCar) -> Callable[[], tuple[Contact, ...]]:
    """Return a function that lists the contacts of a car so far."""
    return lambda: tuple(c for c in place.arena.contacts if place.name in c.cars)
