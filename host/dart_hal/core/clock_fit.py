"""Map device time to host time by the lower convex hull of the arrivals.

1. Each frame gives a pair (x, y): x = device time, y = arrival minus the time on the wire.
2. USB and scheduler can only delay y, so the true line lies on the lower hull of the pairs.
3. Once per second, the hull edge below the middle of the last 20 s gives the rate, limited to
   max_rate_error. The line of that rate below all pairs gives the offset.
4. Half of the smallest round trip of the pings is subtracted: the smallest delay of a frame.

      y - x ^   .      .         .      delayed arrivals
            |  .  . .    . .  .    .
            | .________.___________.    lower hull; the edge below the middle
            +----------------------> x

The asymmetry of the two smallest one-way delays cannot be observed. It biases the result by at
most rtt_min / 2, which the stated uncertainty includes.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from math import hypot, inf, sqrt

# s of arrivals in a fit: 1 ms of jitter gives 3 ppm of rate.
FIT_WINDOW = 20.0
# s. Only the least delayed pair of each bin is stored, so a fit has 80 pairs.
BIN_WIDTH = 0.25
# s of data; before that, a known rate is kept and only the offset is fitted.
MIN_FIT_AGE = 3.0
# s from the first frame to the first fit.
FIRST_FIT_DELAY = 0.5
# Relative tolerance of the Nano's ceramic resonator.
RATE_PRIOR_STD = 0.005
# Relative. A steeper hull edge is noise of the first second, not the resonator.
MAX_RATE_ERROR = 0.006
# s of pings whose smallest round trip is used.
PING_WINDOW = 20.0
# s: mean one-way delay of full-speed USB, used until a ping is answered.
UNKNOWN_DELAY_STD = 0.5e-3
# s from the encoder latch to the first byte of STATE in the UART: the smallest value of the
# firmware in simavr. A test measures it.
LATCH_DELAY = 0.255e-3
# s: half of a tick of the device clock (0.5 us), the smallest uncertainty.
STAMP_STD = 0.25e-6
# Lowest rate of the returned host time, relative to device time.
MIN_PUBLISHED_RATE = 0.1

Pair = tuple[float, float]


class ClockFit:
    """Maps device seconds to host seconds, causally and monotonically.

    byte_time [s]: ten bits of the line; latch_delay [s]: from the encoder latch to the first byte
    in the UART, a constant of the firmware; max_rate_error: largest relative error of the device's
    clock.
    """

    def __init__(self, *, byte_time: float = 10 / 500_000, latch_delay: float = LATCH_DELAY,
                 max_rate_error: float = MAX_RATE_ERROR) -> None:
        self.byte_time = byte_time
        self.latch_delay = latch_delay
        self.max_rate_error = max_rate_error
        self.rate = 1.0
        self._rate_known = False
        self._published = -inf
        self.restart()

    def restart(self) -> None:
        """Restart after a reset of the device clock: keep the rate of the resonator only."""
        self._bins: deque[Pair] = deque()
        self._best: Pair | None = None
        self._best_residual = inf
        self._bin_end = -inf
        self._first = -inf
        self._next_fit = inf
        self._fitted = False
        self._offset = 0.0
        self._fit_std = 0.0
        self._middle = 0.0
        self._slope_std = 10e-6 if self._rate_known else RATE_PRIOR_STD
        self._rtts: deque[Pair] = deque()
        self._half_rtt = 0.0
        self._delay_std = UNKNOWN_DELAY_STD
        self._last_dev = -inf

    def add_frame(self, t_dev: float, t_arrival: float, wire_time: float,
                  bytes_behind: int = 0) -> None:
        """Add a frame: device time of its latch and host time of its chunk [s].

        wire_time [s]: duration of the frame on the line; bytes_behind: number of bytes that follow
        its delimiter in the same chunk.
        """
        y = t_arrival - wire_time - bytes_behind * self.byte_time - self.latch_delay
        residual = y - self.rate * t_dev
        if t_dev >= self._bin_end:
            self._close_bin(t_dev)
        if residual < self._best_residual:
            self._best_residual = residual
            self._best = (t_dev, y)
            if not self._fitted:
                self._offset = min(self._offset, residual)
        if t_dev >= self._next_fit:
            self._refit(t_dev)

    def add_ping(self, t_sent: float, rx_dev: float, tx_dev: float, t_arrival: float,
                 wire_time: float) -> None:
        """Add an answered ping.

        t_sent, t_arrival [s]: host; rx_dev, tx_dev [s]: device, unwrapped or
        not (only their difference counts); wire_time [s]: ping plus pong.
        """
        rest = (t_arrival - t_sent) - (tx_dev - rx_dev) * self.rate - wire_time
        self._rtts.append((t_arrival, max(rest, 0.0)))
        while self._rtts[0][0] < t_arrival - PING_WINDOW:
            self._rtts.popleft()
        self._half_rtt = 0.5 * min(r for _, r in self._rtts)
        self._delay_std = self._half_rtt / sqrt(3.0)

    def to_host(self, t_dev: float) -> tuple[float, float]:
        """Return the host time of a device time and its standard deviation [s].

        The result never decreases with ``t_dev``. A time before the newest requested one (an edge,
        an IMU read) is limited to the newest result.
        """
        # The line of the fit, minus the smallest one-way delay. Its uncertainty grows with the
        # distance from the middle of the window.
        t = self._offset + self.rate * t_dev - self._half_rtt
        std = hypot(self._fit_std + self._slope_std * abs(t_dev - self._middle),
                    self._delay_std) + STAMP_STD
        if t_dev >= self._last_dev:
            # A new fit may lie below the previous one: follow it slowly and state the difference.
            floor = self._published
            if self._last_dev > -inf:
                floor += MIN_PUBLISHED_RATE * (t_dev - self._last_dev)
            if t < floor:
                std += floor - t
                t = floor
            self._published = t
            self._last_dev = t_dev
        elif t > self._published:
            t = self._published
        return t, std

    def _close_bin(self, t_dev: float) -> None:
        """Store the least delayed pair of the bin and begin the next bin."""
        if self._best is None:
            self._first = self._middle = t_dev
            self._next_fit = t_dev + FIRST_FIT_DELAY
            self._offset = inf
        else:
            self._bins.append(self._best)
            while self._bins and self._bins[0][0] < t_dev - FIT_WINDOW:
                self._bins.popleft()
            if not self._bins:  # after a silence: the best pair is as old
                self._best = None
        self._bin_end = t_dev + BIN_WIDTH
        self._best_residual = inf

    def _refit(self, t_dev: float) -> None:
        """Fit offset and rate to the stored pairs."""
        age = t_dev - self._first
        self._next_fit = t_dev + (1.0 if age >= MIN_FIT_AGE else BIN_WIDTH)
        pairs = list(self._bins)
        if self._best is not None and (not pairs or pairs[-1][0] < self._best[0]):
            pairs.append(self._best)
        if len(pairs) < 2:
            return
        # 1. The rate is the slope of the hull edge below the middle of the window.
        if age >= MIN_FIT_AGE or not self._rate_known:
            start, end = find_middle_edge(lower_hull(pairs))
            slope = (end[1] - start[1]) / (end[0] - start[0])
            limit = self.max_rate_error
            self.rate = min(max(slope, 1.0 - limit), 1.0 + limit)
        # 2. The offset is that of the line below all pairs; its spread is the median residual.
        slope = self.rate
        residuals = sorted(y - slope * x for x, y in pairs)
        self._offset = residuals[0]
        self._fit_std = residuals[len(residuals) // 2] - residuals[0]
        self._slope_std = self._fit_std / (pairs[-1][0] - pairs[0][0])
        self._middle = 0.5 * (pairs[0][0] + pairs[-1][0])
        self._fitted = True
        self._rate_known = self._rate_known or age >= MIN_FIT_AGE
        if self._best is not None:
            self._best_residual = self._best[1] - slope * self._best[0]


def lower_hull(pairs: list[Pair]) -> list[Pair]:
    """Return the lower convex hull of pairs in increasing order of x (monotone chain)."""
    hull: list[Pair] = []
    for x, y in pairs:
        while len(hull) > 1:
            (xa, ya), (xb, yb) = hull[-2:]
            # The last point is on the hull if the new point turns counter-clockwise around it.
            if (yb - ya) * (x - xa) < (y - ya) * (xb - xa):
                break
            hull.pop()
        hull.append((x, y))
    return hull


def find_middle_edge(hull: list[Pair]) -> tuple[Pair, Pair]:
    """Return the hull edge that spans the middle of the hull's x range."""
    middle = 0.5 * (hull[0][0] + hull[-1][0])
    for a, b in pairwise(hull):
        if b[0] >= middle:
            return a, b
    return hull[-2], hull[-1]
