"""Wheel speed and travel from the edge count and the stamp of the last edge.

Any two frames give the exact mean speed between their newest edges, however
many frames were lost between them:

    v = (P(k2) - P(k1)) / (t2 - t1)        P: ring position, t: edge stamps

The pair reaches from the newest edge back to the newest one that is at least
15 ms older; with a ring table at most a revolution, as it then gains nothing
but age. Between edges the car cannot have moved on by more than one gap, so
|v| <= 1.05 gap / (now - t2), then 0.

One channel has no direction: it is the sign of the command, taken over only
when the wheel has stopped; until then the flag AMBIGUOUS is up. Should the
wheel speed up against the held sign, it did turn round at its slowest point.
What the car feels of it (``direction.py``) tells more, from a stand on or where
the sign is in doubt, the phase of a second ring (``phase.py``) always: see ``feel``.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import hypot, sqrt

from dart_hal.estimation.ring import Aligner, Ring

WINDOW = 15e-3
"""s; stamp noise of 0.5 us is 5e-5 of it, a frame and a half at 100 Hz."""
BOUND_MARGIN = 1.05
ZERO_AFTER = 0.3
"""s of silence after which the speed is 0: below 7 mm/s with 2 mm edges."""
TURN_SPEED = 0.06
"""m/s: a wheel whose bound is below may follow a command of the other sign."""
FRESH = 0.6
"""s after a stand in which what is felt may overrule the command: it takes 0.4 s to tell, and
later a wheel that catches again after a spin looks like a car that goes the other way."""
SLOW = 0.3
"""m/s at the slowest moment of wheels that nobody drives, below which they may have turned round:
at 10 m/s2 a frame and the age of a pair of edges hide 0.25."""
TURNS = 0.6
"""The same of driven wheels, which lock at 2.5 g. Faster ones that gain speed against the command
have lost their grip, and go on forwards."""
ACCELERATION = 2.0
"""m/s2 rms that a pair's age hides; enters the standard deviation only."""
RECENT = 50
"""Frames in whose slowest one a wheel turned round that a second ring sees going the other way: it
takes 0.1 s to tell."""
MAX_ACCELERATION = 100.0
"""m/s2: a lifted wheel at full throttle reaches about half. More is noise."""
EVEN_SPREAD, TABLE_SPREAD = 0.03, 0.003
"""Relative one sigma of a gap without and with a ring table."""
STAMP = 5e-6
"""s, one sigma of an edge stamp: interrupts block it for 10 us at most."""

SQRT2, SQRT3 = sqrt(2.0), sqrt(3.0)

_Edge = tuple[float, float, int]  # travel [m], device time [s], count


class WheelSpeed:
    """Pair estimator; call ``update`` once per frame.

    After a call: ``distance`` signed travel [m], continuous, interpolated
    between edges; ``direction`` +1 or -1; ``ambiguous`` the sign may be wrong;
    ``rejected`` this frame's edges are noise (the speed is held); ``aligned``
    the ring table is in use.
    """

    def __init__(self, metres_per_edge: float, edges_per_rev: int,
                 ring: Sequence[float] | None = None) -> None:
        self._even = Ring(metres_per_edge, edges_per_rev)
        self._table = Ring(metres_per_edge, edges_per_rev, ring) if ring is not None else None
        self.direction = 1
        self.speed = self.distance = 0.0
        self.ambiguous = self.rejected = self.aligned = False
        self._unsigned = False
        self._lowest, self._lowest_interval = 0.0, 0
        self._stand, self._rolled, self._felt = 0, 0.0, 0
        self._driven = self._confirmed = False
        self._hold = self._coasted = 0.0
        self._skipped = 0
        self._pair, self._pair_std = 0.0, 0.0
        self._edges: deque[_Edge] = deque()
        self._newest: deque[tuple[float, int]] = deque(maxlen=RECENT)
        self._started, self._silent = False, True
        self._count, self._now, self._edge_t = 0, 0.0, 0.0
        self._lose_place()

    def update(self, count: int, t_edge: float, dt_prev: float, now: float, rate: float = 1.0,
               hint: int = 0) -> tuple[float, float]:
        """Speed and one sigma [m/s] at device time ``now``.

        count: edges, unwrapped; t_edge [s]: device time of the last one;
        dt_prev [s]: interval before it, 0.0 = unknown; rate: host seconds per
        device second; hint: sign of the command, 0 = none. A count or a time
        that runs backwards is a restart: re-based without a jump.
        """
        if not self._started or count < self._count or now < self._now:
            self._started = True
            self._rebase(count, t_edge, now)
        new = count - self._count
        dt = (now - self._now) * rate
        self._count, self._now = count, now
        self._rolled += dt
        if new > 3 and self._is_noise(new, dt):
            return self._coast(new, dt)
        self.rejected = False
        if self._hold:
            self._resume(new, dt)
        if new:
            self._note_start(hint)
            self._steer(hint, new, (t_edge - self._edge_t) * rate)
            self._step(new, count, t_edge, dt_prev, rate)
        else:
            self._steer(hint, 0, (now - self._edge_t) * rate)
        self._newest.append((abs(self.speed), self._interval))
        return self._publish((now - self._edge_t) * rate)

    @property
    def unsure(self) -> bool:
        """The wheels turn, and neither the command nor what is felt says which way."""
        return self.ambiguous and self.speed != 0.0 and self._felt != self.direction

    def feel(self, direction: int, certain: bool = False) -> None:
        """The way that the acceleration says the wheels turn; 0 = it does not.

        From a stand on, where nobody drives, or where the sign is in doubt, it makes the direction
        sure, or turns it round together with the travel since the stand, or the slowest moment.
        ``certain``: a second ring says so; it does so always.
        """
        self._felt = direction
        if direction == self.direction:
            self._unsigned, self._confirmed = False, True
        elif direction and self._rolled < FRESH:
            self._mirror(self._stand)
        elif direction and certain:
            self._mirror(min(self._newest, default=(0.0, self._interval))[1])
        elif direction and (self.ambiguous or not self._driven):
            self._mirror(self._lowest_interval)

    @property
    def witnessed(self) -> int:
        """The direction where the command vouches for it and what was felt since the stand; else 0.
        """
        sure = self._driven and not self.ambiguous and self._confirmed and not self._silent
        return self.direction if sure else 0

    # -- edges ------------------------------------------------------------

    def _rebase(self, count: int, t_edge: float, now: float) -> None:
        """Go on from the same place with a new count and a new device clock."""
        self._count, self._now = count, now
        self._edge_t = t_edge
        self._silent = True
        self._lose_place()

    def _lose_place(self) -> None:
        """The tooth under the sensor is unknown (again)."""
        self.aligned = False
        self._ring = self._even
        self._aligner = Aligner(self._table) if self._table is not None else None
        self._interval = self._stand = self._lowest_interval = 0
        self._edge_at = self._origin = self.distance
        self._ahead = 0.0
        self._edges.clear()
        self._newest.clear()

    def _is_noise(self, new: int, dt: float) -> bool:
        """More edges in one frame than any acceleration of the car explains."""
        fastest = abs(self.speed) + MAX_ACCELERATION * (self._hold + dt)
        return new > 3 + 1.2 * fastest * dt / self._even.metres

    def _coast(self, new: int, dt: float) -> tuple[float, float]:
        """Noise on the line: hold the speed, let its deviation grow, drop the edges."""
        self.rejected = True
        self._hold += dt
        self._skipped += new
        self._coasted += self.speed * dt
        self.distance += self.speed * dt
        self._edge_t = self._now
        self._lose_place()
        return self.speed, self._pair_std + 2.0 * ACCELERATION * self._hold

    def _resume(self, new: int, dt: float) -> None:
        """The first good frame after noise. Did the wheel only start in a jump?

        Then the dropped edges fit the speed of now, and they were travel.
        """
        travel = self._skipped * self._even.metres
        if dt > 0.0 and travel <= 1.2 * new * self._even.metres / dt * self._hold:
            self.distance += self.direction * travel - self._coasted
            self._edge_at = self._origin = self.distance
        self._hold = self._coasted = 0.0
        self._skipped = 0

    def _step(self, new: int, count: int, t_edge: float, dt_prev: float, rate: float) -> None:
        """Move on by ``new`` edges and estimate the speed of the newest pair.

        Forwards edge j + 1 ends interval j; backwards edge j does, so a
        reversal meets the last edge again and has travelled nothing.
        """
        ring, sign, edges = self._ring, self.direction, self._edges
        self._interval += sign * new
        edge = self._interval if sign > 0 else self._interval + 1
        self._edge_at = self._origin + ring.position(edge)
        single = t_edge - self._edge_t if new == 1 else dt_prev
        self._edge_t = t_edge
        self._ahead = 0.0
        edges.append((self._edge_at, t_edge, count))
        limit = t_edge - WINDOW
        while len(edges) > 2 and (edges[1][1] <= limit
                                  or (self.aligned and count - edges[0][2] > ring.n)):
            edges.popleft()
        at, t, k = edges[0]
        pair = (t_edge - t) * rate
        if 0.0 < pair < ZERO_AFTER:
            self._silent = False
            self.speed = (self._edge_at - at) / pair
            self._pair = pair
            self._pair_std = self._deviation(pair, count - k)
            if self._aligner is not None and single > 0.0:
                self._align(edge, t_edge, single)
        else:
            self._begin(ring.gap(edge - 1 if sign > 0 else edge), dt_prev * rate)

    def _begin(self, gap: float, interval: float) -> None:
        """First edge after a silence or a turn: its own interval, or next to nothing."""
        self._silent = False
        newest = self._edges[-1]
        self._edges.clear()
        self._edges.append(newest)
        if self._aligner is not None:
            self._aligner.clear()
        self._pair = interval
        self.speed = self.direction * gap / interval if interval > 0.0 else 0.0
        self._pair_std = 0.3 * abs(self.speed) if interval > 0.0 else 2.0 * gap / ZERO_AFTER

    def _deviation(self, pair: float, edges: int) -> float:
        """One sigma of a pair: uneven gaps (none after whole turns) and stamps."""
        spread = 0.0
        if edges % self._ring.n:
            spread = (TABLE_SPREAD if self.aligned else EVEN_SPREAD) * self._ring.metres
        return (spread + STAMP * abs(self.speed)) * SQRT2 / pair

    def _align(self, edge: int, t_edge: float, seconds: float) -> None:
        """Look for the table's shift; once found, go on from the same place."""
        assert self._aligner is not None
        assert self._table is not None
        interval = edge - 1 if self.direction > 0 else edge
        shift = self._aligner.offer(edge, t_edge, interval, seconds)
        if shift is None:
            return
        self._aligner, self._ring, self.aligned = None, self._table, True
        self._interval += shift
        self._stand += shift
        self._lowest_interval += shift
        self._origin = self._edge_at - self._table.position(edge + shift)
        self._newest.clear()
        newest = self._edges[-1]
        self._edges.clear()
        self._edges.append(newest)

    # -- direction --------------------------------------------------------

    def _note_start(self, hint: int) -> None:
        if self._silent:
            self._unsigned, self._confirmed = hint == 0, False
            self._stand, self._rolled = self._interval, 0.0
            self._lowest, self._lowest_interval = 0.0, self._interval
        elif hint == self.direction:
            self._unsigned = False

    def _steer(self, hint: int, new: int, silence: float) -> None:
        """Take over the command's sign once the wheel has stood; see the module."""
        speed, self._driven = abs(self.speed), hint != 0
        if hint == 0 or hint == self.direction:
            if hint or self._felt == self.direction or speed <= self._lowest:
                self._lowest, self._lowest_interval = speed, self._interval
            self.ambiguous = self._unsigned or (self._lowest < SLOW and self._gathers(speed))
            return
        self.ambiguous = True
        if self._silent or (new < 2 and silence * TURN_SPEED > self._ring.gap(self._interval)):
            self._turn_round()
        elif speed <= self._lowest or self._felt == self.direction:
            self._lowest, self._lowest_interval = speed, self._interval
        elif self._lowest < TURNS and self._gathers(speed):
            self._mirror(self._lowest_interval)

    def _gathers(self, speed: float) -> bool:
        """The wheels are clearly faster than at their slowest moment."""
        return speed > 1.5 * self._lowest + 0.1

    def _mirror(self, interval: int) -> None:
        """It has gone the other way since it was in this interval."""
        self._interval = 2 * interval - self._interval
        self.distance = self._origin + self._ring.position(self._interval + (
            0 if self.direction < 0 else 1))
        self._turn_round()

    def _turn_round(self) -> None:
        self.direction = -self.direction
        self.speed = -self.speed
        self._lowest = abs(self.speed)
        self._lowest_interval = self._interval
        self._edge_at, self._ahead = self.distance, 0.0
        self._edges.clear()
        self._newest.clear()
        self.ambiguous = self._unsigned = self._confirmed = False

    # -- between edges ----------------------------------------------------

    def _publish(self, age: float) -> tuple[float, float]:
        """Bound the speed by the silence since the last edge, place the car in its gap."""
        gap = self._ring.gap(self._interval)
        if self._silent or age > ZERO_AFTER:
            self._silent = True
            self.speed = 0.0
            return 0.0, gap / (max(age, WINDOW) * SQRT3)
        speed = abs(self.speed)
        std = hypot(self._pair_std, ACCELERATION * (0.5 * self._pair + age))
        if speed * age > BOUND_MARGIN * gap:
            speed = BOUND_MARGIN * gap / age
            self.speed = self.direction * speed
            std = max(std, 0.5 * speed)
        self._ahead = max(self._ahead, min(speed * age, gap))
        self.distance = self._edge_at + self.direction * self._ahead
        return self.speed, std
