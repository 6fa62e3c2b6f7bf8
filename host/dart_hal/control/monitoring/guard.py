"""A car stands rather than come too near to another one on the same curve.

    mine    the way on which it stops from now      [s, s + v T + v^2 / 2b]
    its     where the other may be, and its stop    [s_j, s_j + way in its age + its stop]

Both are pieces of the curve. A car goes on only where that brings no place of ``mine`` within
``APART`` of a place of ``its``: two cars that both do so never have pieces that meet. A message
that is late or lost makes the other's piece longer, never shorter. What comes behind on the same
branch ends at this car: who is in front does not wait for it.

Of two, the later one in the ring's order also keeps off the way that the other has before it
(``CLEAR``), so that neither stands in the other's; unless it is in that way already.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from dart_hal.control.monitoring.course import Course
from dart_hal.control.stopping import SLOWS
from dart_hal.types import BoolArray, FloatArray

AHEAD = 0.0875
"""m from the rear axle to the middle of the body, 0.30 x 0.19 m."""
BODIES = 0.36
"""m between the middles of two bodies, at which they cannot touch: twice the way to a corner."""
LANE = 0.05
"""m that a car, or its belief of its place, is beside the curve."""
APART = BODIES + 2.0 * LANE
REACTS, TELLS = 0.15, 0.05
"""s from a decision to the brake: a State, transport, the lag of the motor; s from one message to
the next, what another car may decide meanwhile."""
PULLS = 2.8
"""m/s2 at most of a car that speeds up (``lap.ALONG``)."""
CLEAR = 0.8
"""m beyond the other's stop that who gives way keeps off: two bodies and a little."""
GRAIN, NEARER = 0.06, 1e-3
"""m between the places of a piece (half of it is 5 mm of a distance, within ``LANE``); m."""


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
    age, v = age + TELLS, min(max(v, 0.0), fastest)
    way = min(v * age + 0.5 * PULLS * age * age, fastest * age)
    return replace(stopping(s + way, min(v + PULLS * age, fastest)), begin=s)


class Guard:
    """Of the cars on one curve."""

    def __init__(self, course: Course) -> None:
        self._path = course.path

    def free(self, s: float, v: float, other: Stretch, *, yields: bool) -> bool:
        """Whether a car at s [m] with v [m/s] may go on, beside one on a stretch (at most a lap
        behind s); yields: it gives way to that one."""
        mine = self._middles(stopping(s, v + PULLS * TELLS))
        end = min(other.end, s) if other.begin < s else other.end
        if self._comes_near(mine, self._middles(Stretch(other.begin, end))).any():
            return False
        if not yields:
            return True
        way = self._middles(Stretch(other.begin, min(end + CLEAR, max(s, end))))
        stands_in_it = bool((_to(mine[:1], way) < APART).any())
        return stands_in_it or not self._comes_near(mine, way).any()

    def _comes_near(self, mine: FloatArray, its: FloatArray) -> BoolArray:
        """Which places of mine are too near to one of its, and nearer than where I am."""
        to = _to(mine, its)
        return np.asarray((to[1:] < APART) & (to[1:] < to[0] - NEARER), dtype=np.bool_)

    def _middles(self, piece: Stretch) -> FloatArray:
        """Middles (n, 2) [m] of a body on a piece, both ends included."""
        path = self._path
        n = int(np.ceil(max(piece.end - piece.begin, 0.0) / GRAIN)) + 2
        k = np.rint(np.linspace(piece.begin, piece.end, n) / path.spacing).astype(int) % len(path.x)
        return np.stack([path.x[k] + AHEAD * np.cos(path.heading[k]),
                         path.y[k] + AHEAD * np.sin(path.heading[k])], axis=-1)


def _to(a: FloatArray, b: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.norm(a[:, None] - b[None], axis=-1), dtype=np.float64)
