"""A car stands rather than come too near to another one on the same curve.

    mine    the way on which it stops from now      [s, s + v T + v^2 / 2b]
    its     where the other may be, and its stop    [s_j, s_j + way in its age + its stop]

Both are pieces of the curve. A car goes on only where that brings no place of ``mine`` within
``APART`` of a place of ``its``: two cars that both do so never have pieces that meet. A message
that is late or lost makes the other's piece longer, never shorter. What comes behind on the same
branch ends at this car: who is in front does not wait for it.

Of two whose ways cross, one also keeps off the way that the other has before it (``CLEAR``), so
that neither stands in the other's: the one that is not in it yet, if the other is; if none is, the
later one in the ring's order.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.control.monitoring.course import Course
from dart_hal.control.stopping import SLOWS
from dart_hal.core.types import FloatArray

# m from the rear axle to the middle of the body, 0.30 x 0.19 m.
AHEAD = 0.0875
# m between the middles of two bodies, at which they cannot touch: twice the way to a corner.
BODIES = 0.36
# m that a car, or its belief of its place, is beside the curve.
LANE = 0.05
APART = BODIES + 2.0 * LANE
# s from a decision to the brake: a State, transport, the lag of the motor; s from one message to
# the next, what another car may decide meanwhile.
REACTS = 0.15
TELLS = 0.05
# m/s2 at most of a car that speeds up (``lap.ALONG``).
PULLS = 2.8
# m beyond a stop that is the way before a car: over a crossing, two bodies and a little.
CLEAR = 1.0
# m from that way, so that a car that waits, and might start (0.16 m), is not in it.
KEEPS_OFF = APART + 0.2
# m behind this car on its own branch, where another one is no concern of it.
BEHIND = APART + 0.1
# m between the places of a piece (half of it is 5 mm of a distance, within ``LANE``); m.
GRAIN = 0.06
NEARER = 1e-3


@dataclass(frozen=True, slots=True)
class Stretch:
    """A piece of the curve, in arc length [m]."""

    begin: float
    end: float


def stopping(s: float, v: float) -> Stretch:
    """The way of a car at s [m] with a speed v [m/s] until it stands."""
    v = max(v, 0.0)
    return Stretch(s, s + v * (REACTS + TELLS) + 0.5 * v * v / SLOWS)


def reachable(s: float, v: float, age: float, fastest: float) -> Stretch:
    """Where a car may be that was at s [m] with v [m/s] so long [s] ago, and its stop from there;
    it never drives faster than ``fastest`` [m/s], nor backwards."""
    age = age + TELLS
    v = min(max(v, 0.0), fastest)
    way = min(v * age + 0.5 * PULLS * age * age, fastest * age)
    return replace(stopping(s + way, min(v + PULLS * age, fastest)), begin=s)


class Guard:
    """Of the cars on one curve."""

    def __init__(self, course: Course) -> None:
        self._path = course.path

    def free(self, s: float, v: float, other: Stretch, *, yields: bool, sure: bool = True) -> bool:
        """Whether a car at s [m] with v [m/s] may go on, beside one on a stretch (that begins at
        most a lap behind s); yields: it gives way to that one; sure: that was heard lately, so
        that its stretch is one short piece, which is left as a whole or not."""
        if other.begin < s:
            other = replace(other, end=min(other.end, s - BEHIND))
        stop = stopping(s, v + PULLS * TELLS)
        mine = self._middles(stop)
        its = self._middles(other)
        if self._comes_near(mine, its, sure):
            return False
        ahead = self._middles(replace(stop, end=stop.end + CLEAR))
        if not yields and not (_to(ahead, its[:1]) < APART).any():
            return True
        way = replace(other, end=min(other.end + CLEAR, s - BEHIND) if other.begin < s
                      else other.end + CLEAR)
        its = self._middles(way)
        in_it = bool((_to(mine[:1], its) < APART).any())
        return in_it or not self._comes_near(mine, its, sure, KEEPS_OFF)

    def _comes_near(self, mine: FloatArray, its: FloatArray, sure: bool, apart: float = APART
                    ) -> bool:
        """Whether a place of mine is too near to one of its, and nearer than where I am: than I am
        to any of its if that is sure, else to that one."""
        if not len(its):
            return False
        to = _to(mine, its)
        here = to[0].min() if sure else to[0]
        return bool(((to[1:] < apart) & (to[1:] < here - NEARER)).any())

    def _middles(self, piece: Stretch) -> FloatArray:
        """Middles (n, 2) [m] of a body on a piece, both ends included; none of one that ends before
        it begins."""
        path = self._path
        n = int(np.ceil((piece.end - piece.begin) / GRAIN)) + 2 if piece.end >= piece.begin else 0
        k = np.rint(np.linspace(piece.begin, piece.end, n) / path.spacing).astype(int) % len(path.x)
        return np.stack([path.x[k] + AHEAD * np.cos(path.heading[k]),
                         path.y[k] + AHEAD * np.sin(path.heading[k])], axis=-1)


def _to(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(a[:, None] - b[None], axis=-1), dtype=np.float64)
