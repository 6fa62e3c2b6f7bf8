"""Bytes of the simulated lidars: what each model sends for its samples, and when.

Each encoder gets one revolution after the other, with the first sample of the next as the last one,
and yields packets with the time of their last sample.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from functools import reduce
from itertools import pairwise
from math import tau
from operator import xor

import numpy as np

from dart_hal.core.types import FloatArray, IntArray
from dart_hal.devices.lidar.ld19 import LD19_HEAD, LD19_SAMPLES, crc8
from dart_hal.devices.lidar.packets import DISTANCE_UNIT, HEADER_SIZE
from dart_hal.devices.lidar.rplidar import NODE_DISTANCE_UNIT, TURN_COUNTS
from dart_hal.devices.lidar.rplidar_express import (
    EXPRESS_DESCRIPTOR,
    EXPRESS_DISTANCE_UNIT,
    EXPRESS_OFFSET_UNIT,
    EXPRESS_SAMPLES,
)

# Samples of a packet of an X4.
PER_PACKET = 40
# Nodes of an RPLidar that leave together: one packet of its USB adapter.
PER_NODE_GROUP = 8
# Quality and intensity of an echo, and of none.
ECHO_QUALITY = 47
ECHO_INTENSITY = 200
# What an RPLidar answers before its nodes: 508 us for a sample, 254 in express mode; the scan.
SCAN_ANSWERS = struct.pack("<2sI B HH", b"\xa5\x5a", 4, 0x15, 508, 254) + bytes.fromhex(
    "a55a0500004081")

EXPRESS_ANSWERS = SCAN_ANSWERS[:-7] + EXPRESS_DESCRIPTOR
# 1/8 deg by which the laser of an express scan is behind the head: 2.5 deg.
EXPRESS_LASER_OFFSET = 20

# Bytes and the world's time [s] of the last sample in them.
Sent = Iterator[tuple[bytes, float]]


class X4Encoder:
    """Packets of an X4: 40 samples each, the first of a revolution by itself."""

    def __init__(self, rate: float, reports_rate: bool) -> None:
        self._decihertz = round(10.0 * rate) if reports_rate else 0

    def encode(self, t: FloatArray, head: FloatArray, distance: FloatArray) -> Sent:
        """Yield the packets of a revolution: times [s], angles [rad], distances [m]; 0 = none."""
        counts = np.round(distance / DISTANCE_UNIT).astype(int)
        angles = np.round(np.degrees(head) * 64.0).astype(int) % TURN_COUNTS
        cuts = [*range(0, len(t) - 1, PER_PACKET), len(t) - 1, len(t)]
        for a, b in pairwise(cuts):
            starts = b == len(t)
            yield encode_packet(starts, self._decihertz if starts else 0, int(angles[a]),
                                int(angles[b - 1]), counts[a:b]), float(t[b - 1])


class _GroupEncoder:
    """Cuts samples into groups of ``size``, across revolutions."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._rest = np.empty((4, 0))

    def encode(self, t: FloatArray, head: FloatArray, distance: FloatArray) -> Sent:
        """Yield the packets of a revolution, as ``X4Encoder.encode``."""
        starts = np.arange(len(t)) == len(t) - 1
        rows = np.hstack((self._rest, np.vstack((t, head, distance, starts))))
        whole = rows.shape[1] // self._size * self._size
        self._rest = rows[:, whole:]
        for a in range(0, whole, self._size):
            group = rows[:, a:a + self._size]
            yield self._encode_group(group), float(group[0, -1])

    def _encode_group(self, group: FloatArray) -> bytes:
        """Return the bytes of rows (t, angle, distance, starts) (4, size)."""
        raise NotImplementedError


class Ld19Encoder(_GroupEncoder):
    """Packets of an LD19."""

    def __init__(self, rate: float) -> None:
        super().__init__(LD19_SAMPLES)
        self._speed = round(360.0 * rate)

    def _encode_group(self, group: FloatArray) -> bytes:
        times, head, distance, _ = group
        first, last = (round(np.degrees(angle) * 100.0) % 36000 for angle in (head[0], head[-1]))
        body = b"".join(struct.pack("<HB", round(1000.0 * d), ECHO_INTENSITY if d else 0)
                        for d in distance)
        stamp = round(1000.0 * times[-1]) % 30000
        raw = (LD19_HEAD + struct.pack("<HH", self._speed, first) + body
               + struct.pack("<HH", last, stamp))
        return raw + bytes((crc8(raw),))


class RplidarEncoder(_GroupEncoder):
    """Nodes of an RPLidar in its standard scan, after its answers to the start."""

    def __init__(self) -> None:
        super().__init__(PER_NODE_GROUP)
        self._answers = SCAN_ANSWERS

    def _encode_group(self, group: FloatArray) -> bytes:
        _, head, distance, starts = group
        raw = self._answers
        self._answers = b""
        for angle, d, start in zip(head, distance, starts, strict=True):
            quality = ECHO_QUALITY if d else 0
            count = round(angle % tau / tau * TURN_COUNTS) % TURN_COUNTS
            raw += struct.pack("<BHH", quality << 2 | (1 if start else 2), count << 1 | 1,
                               round(d / NODE_DISTANCE_UNIT))
        return raw


class ExpressEncoder(_GroupEncoder):
    """Packets of an RPLidar in its express scan, after its answers to the start.

    Its laser points ``EXPRESS_LASER_OFFSET`` behind the head, which the packets state.
    """

    def __init__(self) -> None:
        super().__init__(EXPRESS_SAMPLES)
        self._answers = EXPRESS_ANSWERS
        self._started = False

    def _encode_group(self, group: FloatArray) -> bytes:
        _, head, distance, _ = group
        raw_head = head[0] + EXPRESS_LASER_OFFSET * EXPRESS_OFFSET_UNIT
        start = round(raw_head % tau / tau * TURN_COUNTS) % TURN_COUNTS
        body = struct.pack("<H", start | (0 if self._started else 0x8000))
        self._started = True
        words = np.round(distance / EXPRESS_DISTANCE_UNIT).astype(int) << 2 | (
            EXPRESS_LASER_OFFSET >> 4)
        low = EXPRESS_LASER_OFFSET & 0xF
        for first, second in words.reshape(-1, 2).tolist():
            body += struct.pack("<HHB", first, second, low << 4 | low)
        check = reduce(xor, body)
        raw = self._answers + bytes((0xA0 | check & 0xF, 0x50 | check >> 4)) + body
        self._answers = b""
        return raw


def encode_packet(starts: bool, rate: int, first: int, last: int, counts: IntArray) -> bytes:
    """Encode a packet: rate [0.1 Hz], angles in 1/64 deg, samples in quarters of a mm."""
    head = struct.pack("<4H", 0x55AA, (rate << 1 | starts) | len(counts) << 8, first << 1 | 1,
                       last << 1 | 1)
    body = counts.astype("<u2").tobytes()
    check = np.bitwise_xor.reduce(np.frombuffer(head + body, "<u2"))
    assert len(head) + 2 == HEADER_SIZE
    return head + struct.pack("<H", int(check)) + body
