"""Device time -> host time: the lower convex hull of the arrivals.

Every frame gives a pair x = device time, y = arrival less the time on the
wire. y is late (USB, scheduler), never early, so the truth lies under the
cloud of pairs. Once per second the hull edge under the middle of the last 20 s
gives offset and rate; half the smallest round trip of the pings removes the
delay that even the luckiest frame has.

      y - x ^   .      .         .      late arrivals
            |  .  . .    . .  .    .
            | .________.___________.    lower hull; the edge under the middle
            +----------------------> x

The asymmetry of the two smallest one-way delays cannot be observed; it biases
the result by at most rtt_min / 2, which the uncertainty holds.
"""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from math import hypot, inf, sqrt

WINDOW = 20.0
"""s of arrivals that count: 3 ppm of rate from 1 ms of jitter."""
BIN = 0.25
"""s: one pair, the earliest, is kept of each bin, so a refit sees 80 pairs."""
SETTLED = 3.0
"""s of data from which on the hull alone decides."""
FIRST_FIT = 0.5
RATE_PRIOR = 0.005
"""Tolerance of the Nano's ceramic resonator."""
RATE_LIMIT = 0.006
"""A steeper hull edge is noise of the first second, not the resonator."""
PING_WINDOW = 20.0
UNKNOWN_DELAY = 0.5e-3
"""s: mean one-way delay of full-speed USB, while no ping has been answered."""
LATCH_DELAY = 0.255e-3
"""s from the encoder latch to the first byte of STATE in the UART: the least of
the firmware in simavr; a test measures it."""
STAMP = 0.25e-6
"""s: half a tick of the device clock, the floor of the uncertainty."""
SLOWEST = 0.1
"""Published time advances at least at this share of the device's."""

Pair = tuple[float, float]


class ClockFit:
    """Maps device seconds to host seconds, causally and monotone.

    byte_time [s]: ten bits of the line; latch_delay [s]: encoder latch to the
    first byte in the UART, a constant of the firmware.
    """

    def __init__(self, *, byte_time: float = 10 / 500_000,
                 latch_delay: float = LATCH_DELAY) -> None:
        self.byte_time = byte_time
        self.latch_delay = latch_delay
        self.rate = 1.0
        self._rate_known = False
        self._published = -inf
        self.restart()

    def restart(self) -> None:
        """The device clock began anew: forget the pairs, keep the rate (same resonator)."""
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
        self._slope_std = 10e-6 if self._rate_known else RATE_PRIOR
        self._rtts: deque[Pair] = deque()
        self._half_rtt = 0.0
        self._delay_std = UNKNOWN_DELAY
        self._last_dev = -inf

    def add_frame(self, t_dev: float, t_arrival: float, wire_time: float,
                  bytes_behind: int = 0) -> None:
        """One frame: device time of its latch, host time of its chunk [s].

        wire_time [s]: duration of the frame on the line; bytes_behind: bytes
        that follow its delimiter in the same chunk.
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
        """One answered ping.

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
        """Host time of a device time, with one sigma [s].

        Never decreases with ``t_dev``; times before the newest one asked for
        (an edge, an IMU read) do not pass it.
        """
        t = self._offset + self.rate * t_dev - self._half_rtt
        std = hypot(self._fit_std + self._slope_std * abs(t_dev - self._middle),
                    self._delay_std) + STAMP
        if t_dev >= self._last_dev:
            floor = self._published
            if self._last_dev > -inf:
                floor += SLOWEST * (t_dev - self._last_dev)
            if t < floor:
                std += floor - t
                t = floor
            self._published = t
            self._last_dev = t_dev
        elif t > self._published:
            t = self._published
        return t, std

    def _close_bin(self, t_dev: float) -> None:
        if self._best is None:
            self._first = self._middle = t_dev
            self._next_fit = t_dev + FIRST_FIT
            self._offset = inf
        else:
            self._bins.append(self._best)
            while self._bins[0][0] < t_dev - WINDOW:
                self._bins.popleft()
        self._bin_end = t_dev + BIN
        self._best_residual = inf

    def _refit(self, t_dev: float) -> None:
        """Hull of the kept pairs; the edge under the window's middle is the clock."""
        age = t_dev - self._first
        self._next_fit = t_dev + (1.0 if age >= SETTLED else BIN)
        pairs = list(self._bins)
        if self._best is not None and (not pairs or pairs[-1][0] < self._best[0]):
            pairs.append(self._best)
        if len(pairs) < 2:
            return
        if age >= SETTLED or not self._rate_known:
            (xa, ya), (xb, yb) = edge_under_middle(lower_hull(pairs))
            slope = (yb - ya) / (xb - xa)
            self.rate = min(max(slope, 1.0 - RATE_LIMIT), 1.0 + RATE_LIMIT)
        slope = self.rate
        residuals = sorted(y - slope * x for x, y in pairs)
        self._offset = residuals[0]
        self._fit_std = residuals[len(residuals) // 2] - residuals[0]
        self._slope_std = self._fit_std / (pairs[-1][0] - pairs[0][0])
        self._middle = 0.5 * (pairs[0][0] + pairs[-1][0])
        self._fitted = True
        self._rate_known = self._rate_known or age >= SETTLED
        if self._best is not None:
            self._best_residual = self._best[1] - slope * self._best[0]


def lower_hull(pairs: list[Pair]) -> list[Pair]:
    """Lower convex hull of pairs in increasing order of x (monotone chain)."""
    hull: list[Pair] = []
    for x, y in pairs:
        while len(hull) > 1:
            (xa, ya), (xb, yb) = hull[-2], hull[-1]
            if (yb - ya) * (x - xa) < (y - ya) * (xb - xa):
                break
            hull.pop()
        hull.append((x, y))
    return hull


def edge_under_middle(hull: list[Pair]) -> tuple[Pair, Pair]:
    """The hull edge that spans the middle of the hull's x range."""
    middle = 0.5 * (hull[0][0] + hull[-1][0])
    for a, b in pairwise(hull):
        if b[0] >= middle:
            return a, b
    return hull[-2], hull[-1]
