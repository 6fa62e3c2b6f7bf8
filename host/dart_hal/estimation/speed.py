"""Wheel speed and travel from the edge count and the time stamp of the last edge.

Any two frames give the exact mean speed between their newest edges, however
many frames were lost between them:

    v = (P(k2) - P(k1)) / (t2 - t1)        P: ring position, t: edge stamps

The pair reaches from the newest edge back to the newest one that is at least
15 ms older. With a ring table it spans at most one revolution: a longer pair is
not more accurate, only older. Between edges the car has moved by less than one
gap, so |v| <= 1.05 gap / (now - t2), and 0 after a long silence.

One channel has no direction. The sign of the command is used; a new sign is
taken over only when the wheel has stopped, and until then the direction is
marked AMBIGUOUS. If the wheel speeds up against the old sign, it has reversed at
its slowest point. ``correct_direction`` takes two better sources: the
acceleration (``direction.py``), used after a standstill or where the sign is
ambiguous, and the phase of a second ring (``phase.py``), always used.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import hypot, sqrt

from dart_hal.estimation.ring import Aligner, Ring

# s, one and a half frames at 100 Hz. Two stamps with STAMP_STD make a relative error of 5e-4 at the
# most, their resolution of 0.5 us one of 3e-5.
MIN_PAIR_TIME = 15e-3
# Factor of the largest speed that the silence since the last edge allows, see the module.
BOUND_MARGIN = 1.05
# s of silence after which the speed is 0: below 7 mm/s with 2 mm edges.
ZERO_AFTER = 0.3
# m/s. A wheel whose upper bound is below may follow a command of the other sign.
MAX_SIGN_CHANGE_SPEED = 0.06
# s after a standstill in which the acceleration may overrule the command. Its estimate takes
# 0.4 s; later, a wheel that regains grip after a spin looks like a car in reverse.
MAX_START_TIME = 0.6
# m/s. Coasting wheels that were slower than this may have reversed. A reversal passes through 0,
# but at 10 m/s2 one frame and the age of a pair of edges hide 0.25 m/s of it.
MAX_COASTING_REVERSAL_SPEED = 0.3
# m/s, the same for driven wheels, which lock at 2.5 g. Faster ones that gain speed against the
# command have lost their grip and still turn forwards.
MAX_DRIVEN_REVERSAL_SPEED = 0.6
# m/s2 rms hidden by the age of a pair; enters the standard deviation only.
PAIR_ACCELERATION_STD = 2.0
# m/s2: of a start without accelerometer, and error of the accelerometer: tilt and offset.
START_ACCELERATION = 5.0
ACCEL_ERROR = 0.5
# Number of frames, 0.5 s, searched for the slowest moment before a reversal that the second ring
# reports 0.1 to 0.2 s later.
REVERSAL_FRAMES = 50
# m/s2: a lifted wheel at full throttle reaches about half. More is noise.
MAX_ACCELERATION = 100.0
# Standard deviation of a gap, relative, without and with a ring table.
EVEN_GAP_STD = 0.03
TABLE_GAP_STD = 0.003
# s, one sigma of an edge stamp: other interrupts delay it by at most 10 us. Not that of
# ``clock_fit``, which is the resolution of the device clock.
STAMP_STD = 5e-6

SQRT2 = sqrt(2.0)
SQRT3 = sqrt(3.0)

_Edge = tuple[float, float, int]  # travel [m], device time [s], count


class WheelSpeed:
    """Estimates speed and travel from pairs of edges; call ``update`` once per frame.

    After a call: ``distance`` signed travel [m], continuous, interpolated
    between edges; ``direction`` +1 or -1; ``ambiguous`` the sign may be wrong;
    ``rejected`` this frame's edges are noise (the last speed is kept); ``aligned``
    the ring table is in use.
    """

    def __init__(self, metres_per_edge: float, edges_per_rev: int,
                 ring: Sequence[float] | None = None) -> None:
        self._even_ring = Ring(metres_per_edge, edges_per_rev)
        self._table_ring = Ring(metres_per_edge, edges_per_rev, ring) if ring is not None else None
        self.direction = 1
        self.speed = self.distance = 0.0
        self.ambiguous = self.rejected = self.aligned = False
        self._start_unsigned = False
        self._slowest_speed = 0.0
        self._slowest_interval = 0
        self._start_interval = 0
        self._time_since_start = 0.0
        self._inertial_direction = 0
        self._driven = self._confirmed = False
        self._noise_time = self._extrapolated = 0.0
        self._noise_edges = 0
        # s: since the wheel has been driven without a pause; since the last edge.
        self._driven_time = self._age = 0.0
        self._pair_time = 0.0
        self._pair_std = 0.0
        self._edges: deque[_Edge] = deque()
        self._recent_speeds: deque[tuple[float, int]] = deque(maxlen=REVERSAL_FRAMES)
        self._has_frame = False
        self._silent = True
        self._count = 0
        self._now = 0.0
        self._edge_t = 0.0
        self._reset_position()

    def update(self, count: int, t_edge: float, dt_prev: float, now: float, rate: float = 1.0,
               hint: int = 0) -> tuple[float, float]:
        """Return the speed and its standard deviation [m/s] at device time ``now``.

        count: edges, unwrapped; t_edge [s]: device time of the last one;
        dt_prev [s]: interval before it, 0.0 = unknown; rate: host seconds per
        device second; hint: sign of the command, 0 = none. A count or a time
        that runs backwards is a restart of the Nano: the travel goes on without a jump.
        """
        if not self._has_frame or count < self._count or now < self._now:
            self._has_frame = True
            self._rebase(count, t_edge, now)
        new = count - self._count
        dt = (now - self._now) * rate
        self._count = count
        self._now = now
        self._time_since_start += dt
        self._driven_time = self._driven_time + dt if hint else 0.0
        if new > 3 and self._is_noise(new, dt):
            return self._extrapolate(new, dt)
        self.rejected = False
        if self._noise_time:
            self._resume(new, dt)
        if new:
            self._note_start(hint)
            self._update_direction(hint, new, (t_edge - self._edge_t) * rate)
            self._add_edges(new, count, t_edge, dt_prev, rate)
        else:
            self._update_direction(hint, 0, (now - self._edge_t) * rate)
        self._recent_speeds.append((abs(self.speed), self._interval))
        return self._interpolate((now - self._edge_t) * rate)

    @property
    def is_direction_uncertain(self) -> bool:
        """Whether the wheels turn, and neither command nor acceleration gives the direction."""
        return self.ambiguous and self.speed != 0.0 and self._inertial_direction != self.direction

    @property
    def may_have_reversed(self) -> bool:
        """Whether the wheels turn, and may turn the other way: they were slow against a command."""
        confirmed = self._inertial_direction == self.direction
        limit = MAX_COASTING_REVERSAL_SPEED if confirmed else MAX_DRIVEN_REVERSAL_SPEED
        return self.ambiguous and self.speed != 0.0 and self._slowest_speed < limit

    def add_undetected_motion(self, std: float, accel: float | None) -> float:
        """Return a standard deviation of ``update`` [m/s] with what the edges cannot show yet.

        1. The acceleration, accel [m/s2] (None: not measured), acts since the middle of the pair.
        2. A wheel that is driven may turn, with less than one gap since then.
        3. A wheel that was slow against the command may turn the other way.
        """
        if self._silent:
            seconds = self._driven_time
            gap = self._ring.gap(self._interval)
            if seconds > 0.0:
                a = START_ACCELERATION if accel is None else abs(accel) + ACCEL_ERROR
                # Constant acceleration: the last speed is twice the mean.
                fastest = min(a * seconds, sqrt(2.0 * a * gap), 2.0 * gap / seconds)
                std = max(std, fastest / SQRT3)
        elif accel is not None and abs(accel) > PAIR_ACCELERATION_STD:
            std = hypot(std, accel * (0.5 * self._pair_time + self._age))
        return max(std, abs(self.speed)) if self.may_have_reversed else std

    def correct_direction(self, direction: int, certain: bool = False) -> None:
        """Take in a measured direction; 0 = not known.

        After a standstill, while coasting, or where the sign is ambiguous, it confirms the
        direction, or reverses it together with the travel since the standstill or the slowest
        moment. ``certain``: it comes from a second ring and always counts.
        """
        self._inertial_direction = direction
        if direction == self.direction:
            self._start_unsigned = False
            self._confirmed = True
        elif direction and self._time_since_start < MAX_START_TIME:
            self._reverse_since(self._start_interval)
        elif direction and certain:
            self._reverse_since(min(self._recent_speeds, default=(0.0, self._interval))[1])
        elif direction and (self.ambiguous or not self._driven):
            self._reverse_since(self._slowest_interval)

    @property
    def confirmed_direction(self) -> int:
        """Direction on which command and acceleration agree since the last standstill; else 0."""
        confirmed = self._driven and not self.ambiguous and self._confirmed and not self._silent
        return self.direction if confirmed else 0

    # -- edges ------------------------------------------------------------

    def _rebase(self, count: int, t_edge: float, now: float) -> None:
        """Keep the travel and continue with a new count and a new device clock."""
        self._count = count
        self._now = now
        self._edge_t = t_edge
        self._silent = True
        self._reset_position()

    def _reset_position(self) -> None:
        """Forget which interval of the ring is under the sensor."""
        self.aligned = False
        self._ring = self._even_ring
        self._aligner = Aligner(self._table_ring) if self._table_ring is not None else None
        self._interval = self._start_interval = self._slowest_interval = 0
        self._edge_position = self._origin = self.distance
        self._in_gap = 0.0
        self._edges.clear()
        self._recent_speeds.clear()

    def _is_noise(self, new: int, dt: float) -> bool:
        """Whether one frame has more edges than any acceleration of the car explains."""
        fastest = abs(self.speed) + MAX_ACCELERATION * (self._noise_time + dt)
        return new > 3 + 1.2 * fastest * dt / self._even_ring.metres

    def _extrapolate(self, new: int, dt: float) -> tuple[float, float]:
        """Noise on the line: keep the speed, let its deviation grow, drop the edges."""
        self.rejected = True
        self._noise_time += dt
        self._noise_edges += new
        self._extrapolated += self.speed * dt
        self.distance += self.speed * dt
        self._edge_t = self._now
        self._reset_position()
        return self.speed, self._pair_std + 2.0 * PAIR_ACCELERATION_STD * self._noise_time

    def _resume(self, new: int, dt: float) -> None:
        """Decide at the first good frame after noise whether the dropped edges were travel.

        A wheel that starts abruptly looks like noise: then the dropped edges fit the speed of
        this frame, and their travel is added.
        """
        travel = self._noise_edges * self._even_ring.metres
        if dt > 0.0 and travel <= 1.2 * new * self._even_ring.metres / dt * self._noise_time:
            self.distance += self.direction * travel - self._extrapolated
            self._edge_position = self._origin = self.distance
        self._noise_time = self._extrapolated = 0.0
        self._noise_edges = 0

    def _add_edges(self, new: int, count: int, t_edge: float, dt_prev: float, rate: float) -> None:
        """Move on by ``new`` edges and estimate the speed of the newest pair.

        Forwards, edge j + 1 ends interval j; backwards, edge j does. So a
        reversal passes the last edge again with no travel between.
        """
        # 1. Position of the newest edge on the ring.
        ring = self._ring
        sign = self.direction
        edges = self._edges
        self._interval += sign * new
        edge = self._interval if sign > 0 else self._interval + 1
        self._edge_position = self._origin + ring.position(edge)
        single = t_edge - self._edge_t if new == 1 else dt_prev
        self._edge_t = t_edge
        self._in_gap = 0.0
        edges.append((self._edge_position, t_edge, count))
        # 2. Drop old edges until the pair is the shortest one of at least MIN_PAIR_TIME.
        limit = t_edge - MIN_PAIR_TIME
        while len(edges) > 2 and (edges[1][1] <= limit
                                  or (self.aligned and count - edges[0][2] > ring.n)):
            edges.popleft()
        # 3. Speed of the pair; after a silence there is none.
        at, t, k = edges[0]
        pair = (t_edge - t) * rate
        if 0.0 < pair < ZERO_AFTER:
            self._silent = False
            self.speed = (self._edge_position - at) / pair
            self._pair_time = pair
            self._pair_std = self._deviation(pair, count - k)
            if self._aligner is not None and single > 0.0:
                self._align_table(edge, t_edge, single)
        else:
            self._restart_pair(ring.gap(edge - 1 if sign > 0 else edge), dt_prev * rate)

    def _restart_pair(self, gap: float, interval: float) -> None:
        """Start a new pair at the first edge after a silence; its own interval gives the speed."""
        self._silent = False
        newest = self._edges[-1]
        self._edges.clear()
        self._edges.append(newest)
        if self._aligner is not None:
            self._aligner.clear()
        self._pair_time = interval
        self.speed = self.direction * gap / interval if interval > 0.0 else 0.0
        self._pair_std = 0.3 * abs(self.speed) if interval > 0.0 else 2.0 * gap / ZERO_AFTER

    def _deviation(self, pair: float, edges: int) -> float:
        """Standard deviation of a pair [m/s]: uneven gaps (none after whole turns) and stamps."""
        spread = 0.0
        if edges % self._ring.n:
            spread = (TABLE_GAP_STD if self.aligned else EVEN_GAP_STD) * self._ring.metres
        return (spread + STAMP_STD * abs(self.speed)) * SQRT2 / pair

    def _align_table(self, edge: int, t_edge: float, seconds: float) -> None:
        """Look for the shift of the ring table; once found, keep the travel and use the table."""
        assert self._aligner is not None
        assert self._table_ring is not None
        interval = edge - 1 if self.direction > 0 else edge
        shift = self._aligner.offer(edge, t_edge, interval, seconds)
        if shift is None:
            return
        self._aligner = None
        self._ring = self._table_ring
        self.aligned = True
        self._interval += shift
        self._start_interval += shift
        self._slowest_interval += shift
        self._origin = self._edge_position - self._table_ring.position(edge + shift)
        self._recent_speeds.clear()
        newest = self._edges[-1]
        self._edges.clear()
        self._edges.append(newest)

    # -- direction --------------------------------------------------------

    def _note_start(self, hint: int) -> None:
        """Remember where the wheel started to turn, and whether a command gave its sign."""
        if self._silent:
            self._start_unsigned = hint == 0
            self._confirmed = False
            self._start_interval = self._interval
            self._time_since_start = 0.0
            self._slowest_speed = 0.0
            self._slowest_interval = self._interval
        elif hint == self.direction:
            self._start_unsigned = False

    def _update_direction(self, hint: int, new: int, silence: float) -> None:
        """Take over the sign of the command once the wheel has stopped; see the module."""
        speed = abs(self.speed)
        self._driven = hint != 0
        if hint == 0 or hint == self.direction:
            if hint or self._inertial_direction == self.direction or speed <= self._slowest_speed:
                self._slowest_speed = speed
                self._slowest_interval = self._interval
            self.ambiguous = self._start_unsigned or (
                self._slowest_speed < MAX_COASTING_REVERSAL_SPEED and self._is_accelerating(speed))
            return
        self.ambiguous = True
        if self._silent or (
                new < 2 and silence * MAX_SIGN_CHANGE_SPEED > self._ring.gap(self._interval)):
            self._reverse()
        elif speed <= self._slowest_speed or (
                # The acceleration looks back by 0.4 s: at low speed it confirms the old sign.
                self._inertial_direction == self.direction
                and self._slowest_speed > MAX_COASTING_REVERSAL_SPEED):
            self._slowest_speed = speed
            self._slowest_interval = self._interval
        elif self._slowest_speed < MAX_DRIVEN_REVERSAL_SPEED and self._is_accelerating(speed):
            self._reverse_since(self._slowest_interval)

    def _is_accelerating(self, speed: float) -> bool:
        """Whether the wheels are clearly faster than at their slowest moment."""
        return speed > 1.5 * self._slowest_speed + 0.1

    def _reverse_since(self, interval: int) -> None:
        """Mirror the travel since the wheel was in this interval, and reverse the direction."""
        self._interval = 2 * interval - self._interval
        self.distance = self._origin + self._ring.position(self._interval + (
            0 if self.direction < 0 else 1))
        self._reverse()

    def _reverse(self) -> None:
        """Change the sign of the direction and the speed, and start a new pair."""
        self.direction = -self.direction
        self.speed = -self.speed
        self._slowest_speed = abs(self.speed)
        self._slowest_interval = self._interval
        self._edge_position = self.distance
        self._in_gap = 0.0
        self._edges.clear()
        self._recent_speeds.clear()
        self.ambiguous = self._start_unsigned = self._confirmed = False

    # -- between edges ----------------------------------------------------

    def _interpolate(self, age: float) -> tuple[float, float]:
        """Bound the speed by the silence since the last edge, and place the car in its gap."""
        gap = self._ring.gap(self._interval)
        self._age = age
        if self._silent or age > ZERO_AFTER:
            self._silent = True
            self.speed = 0.0
            return 0.0, gap / (max(age, MIN_PAIR_TIME) * SQRT3)
        speed = abs(self.speed)
        std = hypot(self._pair_std, PAIR_ACCELERATION_STD * (0.5 * self._pair_time + age))
        if speed * age > BOUND_MARGIN * gap:
            speed = BOUND_MARGIN * gap / age
            self.speed = self.direction * speed
            std = max(std, 0.5 * speed)
        self._in_gap = max(self._in_gap, min(speed * age, gap))
        self.distance = self._edge_position + self.direction * self._in_gap
        return self.speed, std
