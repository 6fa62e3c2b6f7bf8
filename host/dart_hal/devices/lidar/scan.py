"""From bytes of a lidar to whole revolutions with a time for every beam.

The unit counts no time, but its samples are equally far apart in its own: sample k is
``PERIOD`` k. Packets arrive late (USB, scheduler), never early, so the lower hull of
(sample counter, arrival less the time on the wire) gives offset and rate, as for the
clock of the Nano. What no packet tells is the unit's own delay from a sample to the
first byte on the wire: it stays in the times. Samples of lost packets are counted by
the angle that is missing; where that may be a revolution or more, the count begins anew.
"""

from __future__ import annotations

from math import pi, tau

import numpy as np

from dart_hal.core.clock_fit import ClockFit
from dart_hal.core.types import Scan
from dart_hal.devices.lidar.packets import BAUD, PERIOD, Decoder, Packet

BYTE = 10 / BAUD
"""s of a byte on the line."""
SILENCE = 1.0
"""s without a packet after which the count of samples is unknown."""
JUMP = 3.0
"""Steps from one packet to the next from which on samples are missing, though no byte is:
whole packets were dropped."""
STEP = tau * 8.0 * PERIOD
"""rad between two samples, until two packets have told it."""
LEAST_STEP = tau * 1.0 * PERIOD
"""rad: a unit that turns slower than once a second stands."""
LEAST = pi
"""rad: what ends before it has turned that far is no revolution."""


class Assembler:
    """Packets of one unit into scans. ``missing``: samples that never came.

    rate: revolutions per second of the last whole scan, None before it.
    """

    def __init__(self) -> None:
        self.missing = 0
        self.rate: float | None = None
        self._clock = ClockFit(byte_time=BYTE, latch_delay=0.0)
        self._step = STEP
        self._forget()

    def _forget(self) -> None:
        """Nothing is known of what comes next but the unit's rate."""
        self._clock.restart()
        self._count, self._pointed, self._seen = 0, 0.0, -np.inf
        self._open = False
        self._parts: list[tuple[int, Packet]] = []
        self._turned = 0.0

    def add(self, packet: Packet, arrival: float, lost: bool) -> Scan | None:
        """One packet; the revolution that it ends, if any.

        arrival [s]: of the read that it came in; lost: bytes before it were no packet.
        """
        came = (arrival - self._seen) / PERIOD - len(packet.angle)
        if came > (pi / self._step if lost else SILENCE / PERIOD):
            self._forget()
        else:
            self._bridge(packet, lost)
        least = LEAST if packet.starts else tau - 0.5 * self._step
        over = self._open and self._turned >= least
        scan = self._close(arrival) if over else None
        if packet.starts or over:
            self._parts, self._turned, self._open = [], 0.0, True
        self._take(packet, arrival)
        return scan

    def _bridge(self, packet: Packet, lost: bool) -> None:
        """Count the samples that are missing before this packet."""
        gap = (packet.first - self._pointed) % tau
        if gap > tau - self._step:  # a step back by rounding, no revolution
            gap -= tau
        if lost or gap > JUMP * self._step:
            between = max(round(gap / self._step) - 1, 0)
            self.missing += between
            self._count += between
        self._turned += gap

    def _take(self, packet: Packet, arrival: float) -> None:
        n, turn = len(packet.angle), (packet.last - packet.first) % tau
        if self._open:
            self._parts.append((self._count, packet))
        self._count += n
        self._turned += turn
        self._pointed, self._seen = packet.last, arrival
        if n > 1 and turn < pi:
            self._step += (max(turn / (n - 1), LEAST_STEP) - self._step) * min(0.01 * n, 1.0)
        self._clock.add_frame((self._count - 1) * PERIOD, arrival, packet.size * BYTE,
                              packet.behind)

    def _close(self, arrival: float) -> Scan:
        """The beams since its beginning; the packet behind them is bridged already."""
        parts = self._parts
        counts = np.concatenate([first + np.arange(len(p.angle)) for first, p in parts])
        last, std = self._clock.to_host(float(counts[-1]) * PERIOD)
        after = (counts - counts[0]) * (PERIOD * self._clock.rate)
        samples = self._count - int(counts[0])  # up to the first of the next revolution
        self.rate = self._turned / tau / (samples * PERIOD * self._clock.rate)
        return Scan(arrival, last - float(after[-1]), self.rate, after,
                    np.concatenate([p.angle for _, p in parts]),
                    np.concatenate([p.distance for _, p in parts]), std)


class Stream:
    """Bytes with their arrivals into scans, and what was wrong with them."""

    def __init__(self) -> None:
        self.decoder, self.assembler = Decoder(), Assembler()
        self._damage = 0

    def feed(self, data: bytes, arrival: float) -> list[Scan]:
        """Bytes whose last one arrived at ``arrival`` [s]."""
        scans = []
        for packet in self.decoder.feed(data):
            damage = self.decoder.broken + self.decoder.skipped
            scan = self.assembler.add(packet, arrival, damage > self._damage)
            self._damage = damage
            if scan is not None:
                scans.append(scan)
        return scans
