"""Assembly of lidar packets to whole revolutions with a time for every beam.

The unit sends no times, but its samples are equally spaced in its clock: sample k is at
``SAMPLE_PERIOD`` k. Packets arrive with a delay (USB, scheduler) that is never negative. The lower
hull of (sample counter, arrival minus time on the wire) therefore gives offset and rate, as for the
clock of the Nano. The delay inside the unit, from a sample to the first byte on the wire, is
unknown and remains in the times. Samples of lost packets are counted by the missing angle. Where
that may be a revolution or more, the count starts again.
"""

from __future__ import annotations

from math import pi, tau

import numpy as np

from dart_hal.core.clock_fit import ClockFit
from dart_hal.core.types import Scan
from dart_hal.devices.lidar.packets import BAUD, SAMPLE_PERIOD, LidarDecoder, Packet

# s of a byte on the line.
BYTE_TIME = 10 / BAUD
# s without a packet after which the count of samples is unknown.
MAX_PACKET_GAP = 1.0
# Steps between two packets; with more, whole packets were dropped although no byte is damaged.
MAX_ANGLE_GAP = 3.0
# rad between two samples at 8 revolutions per second, until it is measured.
DEFAULT_STEP = tau * 8.0 * SAMPLE_PERIOD
# rad: a unit that turns slower than once a second is at rest.
MIN_ANGLE_STEP = tau * 1.0 * SAMPLE_PERIOD
# rad: a scan that ends earlier is not a revolution.
MIN_SCAN_ANGLE = pi


class Assembler:
    """Assembles packets of one unit to scans.

    ``missing``: lost samples; rate: revolutions per second of the last scan, None before it.
    """

    def __init__(self) -> None:
        self.missing = 0
        self.rate: float | None = None
        self._clock = ClockFit(byte_time=BYTE_TIME, latch_delay=0.0)
        self._step = DEFAULT_STEP
        self._restart()

    def _restart(self) -> None:
        """Forget counts, times and beams; keep the rate of the unit."""
        self._clock.restart()
        self._count = 0
        self._last_angle = 0.0
        self._last_arrival = -np.inf
        self._open = False
        self._parts: list[tuple[int, Packet]] = []
        self._turned = 0.0

    def add(self, packet: Packet, arrival: float, lost: bool) -> Scan | None:
        """Add a packet; return the revolution that it ends, if any.

        arrival [s]: of the read that contained it; lost: bytes before it were no valid packet.
        """
        # 1. Count the samples since the last packet, or start again where this is ambiguous.
        elapsed_samples = (arrival - self._last_arrival) / SAMPLE_PERIOD - len(packet.angle)
        if elapsed_samples > (pi / self._step if lost else MAX_PACKET_GAP / SAMPLE_PERIOD):
            self._restart()
        else:
            self._bridge(packet, lost)
        # 2. Close the revolution at its start mark, or after a full turn if the mark was lost.
        min_angle = MIN_SCAN_ANGLE if packet.starts else tau - 0.5 * self._step
        complete = self._open and self._turned >= min_angle
        scan = self._close(arrival) if complete else None
        if packet.starts or complete:
            self._parts = []
            self._turned = 0.0
            self._open = True
        # 3. Add the packet to the open revolution.
        self._append(packet, arrival)
        return scan

    def _bridge(self, packet: Packet, lost: bool) -> None:
        """Count the samples that are missing before this packet."""
        gap = (packet.first - self._last_angle) % tau
        if gap > tau - self._step:  # a step back by rounding, not a revolution
            gap -= tau
        if lost or gap > MAX_ANGLE_GAP * self._step:
            missing = max(round(gap / self._step) - 1, 0)
            self.missing += missing
            self._count += missing
        self._turned += gap

    def _append(self, packet: Packet, arrival: float) -> None:
        """Add the beams of a packet, and update the angle step and the clock fit."""
        n = len(packet.angle)
        turn = (packet.last - packet.first) % tau
        if self._open:
            self._parts.append((self._count, packet))
        self._count += n
        self._turned += turn
        self._last_angle = packet.last
        self._last_arrival = arrival
        if n > 1 and turn < pi:
            self._step += (max(turn / (n - 1), MIN_ANGLE_STEP) - self._step) * min(0.01 * n, 1.0)
        self._clock.add_frame((self._count - 1) * SAMPLE_PERIOD, arrival, packet.size * BYTE_TIME,
                              packet.behind)

    def _close(self, arrival: float) -> Scan:
        """Return the beams of the open revolution; the gap after it is already counted."""
        parts = self._parts
        counts = np.concatenate([first + np.arange(len(p.angle)) for first, p in parts])
        last, std = self._clock.to_host(float(counts[-1]) * SAMPLE_PERIOD)
        after = (counts - counts[0]) * (SAMPLE_PERIOD * self._clock.rate)
        samples = self._count - int(counts[0])  # up to the first of the next revolution
        self.rate = self._turned / tau / (samples * SAMPLE_PERIOD * self._clock.rate)
        return Scan(arrival, last - float(after[-1]), self.rate, after,
                    np.concatenate([p.angle for _, p in parts]),
                    np.concatenate([p.distance for _, p in parts]), std)


class LidarStream:
    """Converts bytes with their times of arrival to scans; counts what was invalid."""

    def __init__(self) -> None:
        self.decoder = LidarDecoder()
        self.assembler = Assembler()
        self._damage = 0

    def feed(self, data: bytes, arrival: float) -> list[Scan]:
        """Return the scans that ``data`` completes; its last byte arrived at ``arrival`` [s]."""
        scans = []
        for packet in self.decoder.feed(data):
            damage = self.decoder.broken + self.decoder.skipped
            scan = self.assembler.add(packet, arrival, damage > self._damage)
            self._damage = damage
            if scan is not None:
                scans.append(scan)
        return scans
