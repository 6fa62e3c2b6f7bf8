"""A YDLidar X4 in the virtual world, down to the bytes on its line.

Every 0.2 ms of the unit's own clock it takes one sample, from the pose that the car has at
that instant, so a scan of a car that turns is bent as a real one. The laser is the real
line: it starts 21.8 mm beside the receiver's axis and crosses it 155.3 mm ahead, which is
where the correction of the angles in the manual comes from. Packets leave when their last
sample is there, at 128000 baud, one behind the other.

A revolution is computed as a whole once its last sample's time has passed; the times at which
its bytes arrive do not depend on it.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable, Sequence
from itertools import pairwise
from math import atan2, pi, tau

import numpy as np

from dart_hal.core.errors import DartHalError
from dart_hal.core.types import FloatArray, IntArray, Scan
from dart_hal.devices.lidar.packets import (
    DISTANCE_UNIT,
    HEADER_SIZE,
    LASER_CROSSING_MM,
    LASER_OFFSET_MM,
    SAMPLE_PERIOD,
)
from dart_hal.devices.lidar.scan import BYTE_TIME, Stream
from dart_hal.estimation.localisation.rays import NO_HIT, fastest_cast
from dart_lab.sim.lidar.maps import Room
from dart_lab.sim.lidar.params import LidarParams

PER_PACKET = 40
"""Samples of a packet of an X4."""
TILT = atan2(LASER_OFFSET_MM, LASER_CROSSING_MM)
"""rad by which the laser points back to the receiver's axis."""
GAP_AT = pi / 4.0
"""rad to the left: where upstream saw a gap open above 8.25 turns a second."""
COUNTS = 23040
"""Angles of a turn, 64 to the degree."""

Poses = Callable[[FloatArray], FloatArray]
"""x, y [m], yaw [rad] (n, 3) of the rear axle in the world at times (n,) [s]."""
Others = Callable[[float], FloatArray]
"""Lines (m, 4) [m] in the room's frame, of what moves there, at a time [s]."""


class Unit:
    """The bytes of one unit in a room: ``chunks``. others: what moves in that room."""

    def __init__(self, poses: Poses, room: Room, params: LidarParams, seed: int) -> None:
        self.others: list[Others] = []
        self._poses, self._room, self._params = poses, room, params
        self._noise = np.random.default_rng([seed, 512])
        self._line = np.random.default_rng([seed, 513])
        self._cast = fastest_cast()
        self._sample = self._turns = 0
        self._free = self._arrived = 0.0
        self._over = 0.0
        self._batch = self._next_turn()
        self._sent: deque[tuple[bytes, float]] = deque()

    def chunks(self, now: float) -> list[tuple[bytes, float]]:
        """(packet, arrival [s]) of those that have arrived at ``now``, the world's time [s]."""
        while self._over <= now:
            self._send(self._batch)
            self._batch = self._next_turn()
        out = []
        while self._sent and self._sent[0][1] <= now:
            out.append(self._sent.popleft())
        return out

    def _times(self, samples: IntArray) -> FloatArray:
        """World times [s] of samples of the unit."""
        return samples.astype(np.float64) * (SAMPLE_PERIOD * (1.0 + self._params.skew))

    def _turned(self, t: FloatArray) -> FloatArray:
        """Angle that the head has turned through since the world began [rad]."""
        even = t * (tau * self._params.rate)
        turned: FloatArray = even + self._params.ripple * np.sin(even)
        return turned

    def _next_turn(self) -> IntArray:
        """Samples up to the first of the next revolution, which begins it and is in it."""
        self._turns += 1
        samples = self._sample + np.arange(int(1.5 / (self._params.rate * SAMPLE_PERIOD)))
        t = self._times(samples)
        last = int(np.argmax(self._turned(t) >= tau * self._turns))
        self._sample += last + 1
        self._over = float(t[last])
        return samples[:last + 1]

    def _send(self, samples: IntArray) -> None:
        """A batch onto the line: packets of 40, the last sample by itself."""
        p, t = self._params, self._times(samples)
        turned = self._turned(t)
        counts = np.round(self._measured(t, turned) / DISTANCE_UNIT).astype(int)
        angles = np.round(np.degrees(turned) * 64.0).astype(int) % COUNTS
        cuts = [*range(0, len(samples) - 1, PER_PACKET), len(samples) - 1, len(samples)]
        for a, b in pairwise(cuts):
            starts = b == len(samples)
            told = round(10.0 * p.rate) if starts and p.hertz else 0
            raw = bytearray(encode(starts, told, int(angles[a]), int(angles[b - 1]),
                                   counts[a:b]))
            lost, place, late = self._line.uniform(size=3).tolist()
            if lost < p.lost:
                raw[int(place * len(raw))] ^= 0x10
            self._free = max(float(t[b - 1]) + p.delay, self._free) + len(raw) * BYTE_TIME
            self._arrived = max(self._free + late * p.jitter, self._arrived)
            self._sent.append((bytes(raw), self._arrived))

    def _measured(self, t: FloatArray, turned: FloatArray) -> FloatArray:
        """What the unit tells as distance [m] at times (n,) [s]; 0 = nothing came back."""
        p, true = self._params, self._in_room(t)
        sense = -1.0 if p.clockwise else 1.0
        c, s = np.cos(true[:, 2]), np.sin(true[:, 2])
        axis = true[:, :2] + np.column_stack((c * p.x - s * p.y, s * p.x + c * p.y))
        ahead = true[:, 2] + p.yaw + sense * turned
        offset = sense * 1e-3 * LASER_OFFSET_MM
        laser = axis + offset * np.column_stack((-np.sin(ahead), np.cos(ahead)))
        way = ahead - sense * TILT
        reach, line = self._spotted(t, laser, way), _ahead(way)
        r = np.linalg.norm(laser + reach[:, None] * line - axis, axis=1)
        told = r / p.scale + p.noise * self._noise.normal(size=len(t))
        bearing = np.mod(p.yaw + sense * turned - GAP_AT + pi, tau) - pi
        nothing = (r > p.most) | (r < p.least) | (self._noise.uniform(size=len(t)) < p.dropout)
        nothing |= (np.abs(bearing) < 0.5 * p.gap) | (told <= 0.0)
        return np.where(nothing, 0.0, told)

    def _spotted(self, t: FloatArray, laser: FloatArray, way: FloatArray) -> FloatArray:
        """Distances [m] along laser lines at angles ``way`` (n,) [rad], by the middle of the spot.

        Where an edge parts a spot the receiver sees the middle of both images, in which a distance
        r stands at 1 / r: a mixed pixel. What does not come back from a half counts for nothing.
        """
        half = 0.5 * self._params.spot
        if not half:
            return self._reach(t, laser, _ahead(way))
        a, b = (self._reach(t, laser, _ahead(way + side)) for side in (-half, half))
        near, far = np.minimum(np.minimum(a, b), NO_HIT), np.maximum(a, b)
        far = np.where(far > self._params.most, near, far)
        share = self._noise.uniform(size=len(t))
        mixed: FloatArray = 1.0 / (share / near + (1.0 - share) / far)
        return mixed

    def _reach(self, t: FloatArray, laser: FloatArray, line: FloatArray) -> FloatArray:
        """Distances [m] to the first thing on each laser line; ``FAR`` behind glass."""
        reach = self._cast(self._room.lines, laser, line)
        for a in range(0, len(t), PER_PACKET) if self.others else ():
            part = slice(a, a + PER_PACKET)
            moving = np.vstack([other(float(t[part].mean())) for other in self.others])
            if not len(moving):
                continue
            reach[part] = np.minimum(reach[part], self._cast(moving, laser[part], line[part]))
        if len(self._room.glass):
            reach[self._cast(self._room.glass, laser, line) < reach] = np.inf
        return reach

    def _in_room(self, t: FloatArray) -> FloatArray:
        """Poses (n, 3) of the rear axle in the room's frame."""
        x, y, yaw = self._room.start
        world = self._poses(t)
        c, s = np.cos(yaw), np.sin(yaw)
        return np.column_stack((x + c * world[:, 0] - s * world[:, 1],
                                y + s * world[:, 0] + c * world[:, 1], yaw + world[:, 2]))


def _ahead(way: FloatArray) -> FloatArray:
    """Directions (n, 2) of angles (n,) [rad]."""
    return np.column_stack((np.cos(way), np.sin(way)))


class SimLidar:
    """That unit as a source of scans (``dart_hal.core.ports.ScanSource``), by the real decoder."""

    name = "the lidar of sim://"
    trouble: DartHalError | None = None

    def __init__(self, unit: Unit) -> None:
        self.unit, self.stream = unit, Stream()

    def poll(self, now: float) -> Sequence[Scan]:
        """Scans whose last byte came before ``now``, the world's time [s]."""
        return [scan for data, t in self.unit.chunks(now) for scan in self.stream.feed(data, t)]

    def close(self) -> None:
        """Nothing is held."""


def encode(starts: bool, told: int, first: int, last: int, counts: IntArray) -> bytes:
    """A packet: told [0.1 Hz], angles in 1/64 deg, samples in quarters of a mm."""
    head = struct.pack("<4H", 0x55AA, (told << 1 | starts) | len(counts) << 8, first << 1 | 1,
                       last << 1 | 1)
    body = counts.astype("<u2").tobytes()
    check = np.bitwise_xor.reduce(np.frombuffer(head + body, "<u2"))
    assert len(head) + 2 == HEADER_SIZE
    return head + struct.pack("<H", int(check)) + body
