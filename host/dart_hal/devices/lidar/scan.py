"""Assembly of lidar packets to whole revolutions with a time for every beam.

The samples of a unit are equally spaced in its clock: sample k is at k times the sample period of
its model. Packets arrive with a delay (USB, scheduler) that is never negative. The lower
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
from dart_hal.devices.lidar.models import X4, LidarModel
from dart_hal.devices.lidar.packets import Packet

# s without a packet after which the count of samples is unknown.
MAX_PACKET_GAP = 1.0
# Steps between two packets; with more, whole packets were dropped although no byte is damaged.
MAX_ANGLE_GAP = 3.0
# 1/s: a unit that turns slower is at rest.
MIN_RATE = 1.0
# rad of angle after a full turn at which a revolution ends without its mark.
MARK_TOLERANCE = 0.2
# rad: a scan that ends earlier is not a revolution.
MIN_SCAN_ANGLE = pi


class Assembler:
    """Assembles packets of one unit to scans; byte_time [s]: of a byte on its line.

    ``missing``: lost samples; rate: revolutions per second of the last scan, None before it.
    """

    def __init__(self, model: LidarModel = X4, byte_time: float = 10 / X4.bauds[0]) -> None:
        self.missing = 0
        self.rate: float | None = None
        self._model = model
        self._byte_time = byte_time
        self.set_period(model.sample_period)

    def set_period(self, period: float) -> None:
        """Set the time [s] between two samples, and begin again."""
        self.period = period
        # rad between two samples, until it is measured.
        self._step = tau * self._model.rate * period
        self._clock = ClockFit(byte_time=self._byte_time, latch_delay=0.0,
                               max_rate_error=self._model.period_error)
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

    def add(self, packet: Packet, arrival: float) -> Scan | None:
        """Add a packet that arrived at ``arrival`` [s]; return the revolution that it ends."""
        # 1. Count the samples since the last packet, or start again where this is ambiguous.
        elapsed_samples = (arrival - self._last_arrival) / self.period - len(packet.angle)
        if elapsed_samples > (pi / self._step if packet.lost else MAX_PACKET_GAP / self.period):
            self._restart()
        else:
            self._bridge(packet)
        # 2. Close the revolution at its start mark, or after a full turn if the mark was lost.
        # Where angles may go back, the mark may follow a full turn.
        full = tau + (MARK_TOLERANCE if self._model.step_back else -0.5 * self._step)
        min_angle = MIN_SCAN_ANGLE if packet.starts else full
        complete = self._open and self._turned >= min_angle
        scan = self._close(arrival) if complete else None
        if packet.starts or complete:
            self._parts = []
            self._turned = 0.0
            self._open = True
        # 3. Add the packet to the open revolution.
        self._append(packet, arrival)
        return scan

    def _bridge(self, packet: Packet) -> None:
        """Count the samples that are missing before this packet."""
        # A step back is rounding or the correction of a point, not a revolution.
        back = self._model.step_back or self._step
        gap = wrap_forward(packet.first - self._last_angle, back)
        if packet.lost or gap > MAX_ANGLE_GAP * self._step:
            missing = max(round(gap / self._step) - 1, 0)
            self.missing += missing
            self._count += missing
        self._turned += gap

    def _append(self, packet: Packet, arrival: float) -> None:
        """Add the beams of a packet, and update the angle step and the clock fit."""
        n = len(packet.angle)
        turn = wrap_forward(packet.last - packet.first, self._model.step_back or 0.0)
        if self._open:
            self._parts.append((self._count, packet))
        self._count += n
        self._turned += turn
        self._last_angle = packet.last
        self._last_arrival = arrival
        if n > 1 and turn < pi:
            step = max(turn / (n - 1), tau * MIN_RATE * self.period)
            self._step += (step - self._step) * min(0.01 * n, 1.0)
        self._clock.add_frame((self._count - 1 + packet.later) * self.period, arrival,
                              packet.size * self._byte_time, packet.behind)

    def _close(self, arrival: float) -> Scan:
        """Return the beams of the open revolution; the gap after it is already counted."""
        parts = self._parts
        counts = np.concatenate([first + np.arange(len(p.angle)) for first, p in parts])
        last, std = self._clock.to_host(float(counts[-1]) * self.period)
        after = (counts - counts[0]) * (self.period * self._clock.rate)
        samples = self._count - int(counts[0])  # up to the first of the next revolution
        self.rate = self._turned / tau / (samples * self.period * self._clock.rate)
        return Scan(arrival, last - float(after[-1]), self.rate, after,
                    np.concatenate([p.angle for _, p in parts]),
                    np.concatenate([p.distance for _, p in parts]), std)


def wrap_forward(angle: float, back: float) -> float:
    """Return the angle [rad] plus whole turns, within -back to 2 pi - back."""
    return (angle + back) % tau - back


class LidarStream:
    """Converts bytes with their times of arrival to scans; counts what was invalid.

    baud [bit/s]: of the line; default: the usual one of the model.
    """

    def __init__(self, model: LidarModel = X4, baud: int | None = None) -> None:
        self.model = model
        self.decoder = model.make_decoder()
        self.assembler = Assembler(model, 10 / (baud or model.bauds[0]))

    def feed(self, data: bytes, arrival: float) -> list[Scan]:
        """Return the scans that ``data`` completes; its last byte arrived at ``arrival`` [s]."""
        packets = self.decoder.feed(data)
        period = self.decoder.sample_period
        if period is not None and period != self.assembler.period:
            self.assembler.set_period(period)
        scans = []
        for packet in packets:
            scan = self.assembler.add(packet, arrival)
            if scan is not None:
                scans.append(scan)
        return scans
