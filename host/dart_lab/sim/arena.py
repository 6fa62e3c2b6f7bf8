"""Cars in one world: each lidar sees the bodies of the others, and who touches whom is noted.

``sim://?world=NAME&at=X,Y,YAW``: the cars of this process that name the same world stand in one
room, each where ``at`` says. Every world still moves by itself; what the others see of it is where
it was by its own clock at that time, or where it is by now if it is behind: of cars in lockstep at
most 10 ms. Who touches does not bounce: the contact is told, and both drive on.
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
from dart_lab.sim.light.world import Outline

BODY = Outline()
CORNER = 0.5 * hypot(BODY.length, BODY.width)
"""m from the middle of a body to its corner."""
REACH = 12.0
"""m; nothing farther is in range of an X4."""
KEPT = 400
"""Poses of the trail of a car, 5 ms apart: 2 s, longer than a revolution of the lidar."""
EVERY = 4
"""Poses from one look for contacts to the next, 20 ms: 4 cm of two cars that meet at 1 m/s."""
_NOWHERE = np.empty((0, 4))

log = logging.getLogger("dart_hal")
Pose = tuple[float, float, float]
_arenas: dict[str, Arena] = {}


class Place:
    """One car's place in an arena; ``trail`` is what its world calls with each pose."""

    def __init__(self, arena: Arena, name: str, start: Pose) -> None:
        self.arena, self.name, self.start = arena, name, start
        self.touching: set[Place] = set()
        self._poses: deque[tuple[float, Pose]] = deque(maxlen=KEPT)
        self._count = 0
        self._turn = cos(start[2]), sin(start[2])

    def trail(self, t: float, x: float, y: float, yaw: float) -> None:
        """The rear axle at t [s] in the car's own world, in which it began at 0, 0, 0."""
        c, s = self._turn
        at_x, at_y, at_yaw = self.start
        self._poses.append((t, (at_x + c * x - s * y, at_y + s * x + c * y, at_yaw + yaw)))
        self._count += 1
        if self._count % EVERY == 0:
            self.arena.look(self, t)

    def pose(self, t: float) -> Pose:
        """x, y [m], yaw [rad] in the room at t [s], on a line between two of the trail."""
        poses = tuple(self._poses)  # one step for other threads
        if not poses:
            return self.start
        k = bisect_right(poses, (t, (inf, inf, inf)))
        if k in (0, len(poses)):
            return poses[min(k, len(poses) - 1)][1]
        (t0, a), (t1, b) = poses[k - 1], poses[k]
        part = (t - t0) / (t1 - t0)
        return (a[0] + part * (b[0] - a[0]), a[1] + part * (b[1] - a[1]),
                a[2] + part * (b[2] - a[2]))

    def middle(self, t: float = inf) -> Pose:
        """Of the body."""
        x, y, yaw = self.pose(t)
        return x + BODY.ahead * cos(yaw), y + BODY.ahead * sin(yaw), yaw

    def others(self, t: float) -> FloatArray:
        """Lines (m, 4) [m] of the bodies that its lidar may see at t [s]."""
        here = self.pose(t)
        seen = []
        for place in self.arena.places:
            if place is not self:
                x, y, yaw = place.middle(t)
                if hypot(x - here[0], y - here[1]) < REACH:
                    seen.append(box(x, y, yaw, BODY.length, BODY.width))
        return np.vstack(seen) if seen else _NOWHERE

    def leave(self) -> None:
        """Its car is closed."""
        self.arena.leave(self)


class Arena:
    """Places of the cars of one world; ``contacts`` in the order in which they began."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.places: tuple[Place, ...] = ()
        self.contacts: list[Contact] = []

    def enter(self, name: str, start: Pose) -> Place:
        """One car more; the second of a name is NAME-2."""
        names, number = {place.name for place in self.places}, 1
        while (unique := name if number == 1 else f"{name}-{number}") in names:
            number += 1
        place = Place(self, unique, start)
        self.places = (*self.places, place)
        return place

    def leave(self, place: Place) -> None:
        """One car less; the last one takes the arena with it."""
        self.places = tuple(one for one in self.places if one is not place)
        if not self.places:
            _arenas.pop(self.name, None)

    def look(self, place: Place, t: float) -> None:
        """Whom a car touches at t [s]; a contact that begins is noted once."""
        mine = place.middle()
        for other in self.places:
            if other is place:
                continue
            its = other.middle()
            near = hypot(its[0] - mine[0], its[1] - mine[1]) < 2.0 * CORNER
            if not (near and overlap(mine, its)):
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


def overlap(a: Pose, b: Pose) -> bool:
    """Whether two bodies about their middles overlap: no side of either has the other beyond it."""
    dx, dy = b[0] - a[0], b[1] - a[1]
    c, s = abs(cos(b[2] - a[2])), abs(sin(b[2] - a[2]))
    half_l, half_w = 0.5 * BODY.length, 0.5 * BODY.width
    long, wide = half_l * (1.0 + c) + half_w * s, half_w * (1.0 + c) + half_l * s
    away, bearing = hypot(dx, dy), atan2(dy, dx)
    return all(away * abs(cos(bearing - yaw)) < long and away * abs(sin(bearing - yaw)) < wide
               for yaw in (a[2], b[2]))


def room_seed(url: Url, seed: int) -> int:
    """By what the room of a URL is drawn: the cars of one world are in one room."""
    name = url.options.get("world")
    return seed if name is None else crc32(name.encode())


def start_of(url: Url) -> Pose | None:
    """``at=X,Y,YAW``, None without it. Raises UsageError."""
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


def enter(url: Url, name: str) -> Place | None:
    """The place of a car in the world that its URL names, None without. Raises UsageError."""
    world, start = url.options.get("world"), start_of(url)
    if world is None:
        return None
    if not world or start is None:
        raise UsageError("a car in a world of several has a place of its own", found=url.text,
                         expected="world=lab&at=X,Y,YAW [m, m, rad]")
    return _arenas.setdefault(world, Arena(world)).enter(name, start)


def contacts_of(place: Place) -> Callable[[], tuple[Contact, ...]]:
    """Those in which a car had part, so far."""
    return lambda: tuple(c for c in place.arena.contacts if place.name in c.cars)
