"""A lidar in the virtual world, with the bytes on its line.

At each sample period of its own clock the unit takes one sample from the pose of the car at that
instant, so the scan of a turning car is distorted as a real one. The laser beam of an X4 starts
21.8 mm from the axis of the receiver and crosses it 155.3 mm ahead; the angle correction in the
manual follows from this. LD19 and RPLidar correct their angles themselves. Packets are sent after
their last sample, at the line rate of the model, one after the other.

A revolution is computed as a whole after its last sample. The arrival times of its bytes do not
depend on when it is computed.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from math import atan2, pi, tau

import numpy as np

from dart_hal.core.errors import DartHalError
from dart_hal.core.types import FloatArray, IntArray, Scan
from dart_hal.devices.lidar.models import X4, LidarModel
from dart_hal.devices.lidar.packets import LASER_CROSSING_MM, LASER_OFFSET_MM
from dart_hal.devices.lidar.scan import LidarStream
from dart_hal.estimation.localisation.rays import NO_HIT, LineIndex, fastest_cast
from dart_lab.sim.lidar.encoders import PER_PACKET
from dart_lab.sim.lidar.maps import RoomMap
from dart_lab.sim.lidar.params import LidarParams

# Angle between the laser beam and the axis of the receiver [rad].
LASER_ANGLE = atan2(LASER_OFFSET_MM, LASER_CROSSING_MM)
# Direction of the gap to the left [rad], which upstream saw above 8.25 turns per second.
GAP_ANGLE = pi / 4.0

# x, y [m], yaw [rad] (n, 3) of the rear axle in the world at times (n,) [s].
Poses = Callable[[FloatArray], FloatArray]
# Lines (m, 4) [m] of moving objects in the frame of the room, at a time [s].
Others = Callable[[float], FloatArray]


class LidarUnit:
    """One unit in a room; ``others``: functions that give the lines of moving objects."""

    def __init__(self, poses: Poses, room: RoomMap, params: LidarParams, seed: int) -> None:
        self.others: list[Others] = []
        self._poses = poses
        self._params = params
        self._period = params.model.sample_period
        self._byte_time = 10 / params.model.bauds[0]
        self._encoder = params.make_encoder()
        self._noise = np.random.default_rng([seed, 512])
        self._line = np.random.default_rng([seed, 513])
        self._cast_moving = fastest_cast()
        self.set_room(room)
        self._sample = self._turns = 0
        self._line_free = self._arrived = 0.0
        self._turn_end = 0.0
        self._batch = self._next_turn()
        self._sent: deque[tuple[bytes, float]] = deque()

    def set_room(self, room: RoomMap) -> None:
        """Put the unit into another room."""
        self._room = room
        self._lines = LineIndex(room.lines)
        self._glass = LineIndex(room.glass)

    @property
    def model(self) -> LidarModel:
        """Return which lidar it is."""
        return self._params.model

    def chunks(self, now: float) -> list[tuple[bytes, float]]:
        """Return the packets that have arrived by ``now``, the world's time [s], with arrivals."""
        while self._turn_end <= now:
            self._send(self._batch)
            self._batch = self._next_turn()
        out = []
        while self._sent and self._sent[0][1] <= now:
            out.append(self._sent.popleft())
        return out

    def _times(self, samples: IntArray) -> FloatArray:
        """Return the world times [s] of samples of the unit."""
        return samples.astype(np.float64) * (self._period * (1.0 + self._params.skew))

    def _head_angle(self, t: FloatArray) -> FloatArray:
        """Return the angle of the head since the start of the world [rad], not wrapped."""
        even = t * (tau * self._params.rate)
        angle: FloatArray = even + self._params.ripple * np.sin(even)
        return angle

    def _next_turn(self) -> IntArray:
        """Return the samples of this revolution and the first one of the next."""
        self._turns += 1
        samples = self._sample + np.arange(int(1.5 / (self._params.rate * self._period)))
        t = self._times(samples)
        last = int(np.argmax(self._head_angle(t) >= tau * self._turns))
        self._sample += last + 1
        self._turn_end = float(t[last])
        return samples[:last + 1]

    def _send(self, samples: IntArray) -> None:
        """Send a revolution and the first sample of the next."""
        p = self._params
        t = self._times(samples)
        head = self._head_angle(t)
        for packet, t_last in self._encoder.encode(t, head, self._measure(t, head)):
            raw = bytearray(packet)
            # A packet starts after its last sample, when the line is free.
            lost, place, delay = self._line.uniform(size=3).tolist()
            if lost < p.lost:
                raw[int(place * len(raw))] ^= 0x10
            self._line_free = max(t_last + p.delay, self._line_free) + len(raw) * self._byte_time
            self._arrived = max(self._line_free + delay * p.jitter, self._arrived)
            self._sent.append((bytes(raw), self._arrived))

    def _measure(self, t: FloatArray, head: FloatArray) -> FloatArray:
        """Return the reported distances [m] at times (n,) [s]; 0 = no echo.

        1. Laser of an X4: its origin has an offset from the axis of the receiver, its direction
           crosses it.
        2. Distance along the laser to the first object, then from the axis to that point.
        3. Scale, noise, range, drop-outs and the gap.
        """
        p = self._params
        true = self._in_room(t)
        sense = -1.0 if p.clockwise else 1.0
        c = np.cos(true[:, 2])
        s = np.sin(true[:, 2])
        axis = true[:, :2] + np.column_stack((c * p.x - s * p.y, s * p.x + c * p.y))
        ahead = true[:, 2] + p.yaw + sense * head
        is_x4 = p.model is X4
        offset = sense * 1e-3 * LASER_OFFSET_MM if is_x4 else 0.0
        laser = axis + offset * np.column_stack((-np.sin(ahead), np.cos(ahead)))
        direction = ahead - sense * LASER_ANGLE if is_x4 else ahead
        reach = self._spot_distance(t, laser, direction)
        beam = _directions(direction)
        r = np.linalg.norm(laser + reach[:, None] * beam - axis, axis=1)
        noise = p.noise + p.noise_share * np.minimum(r, p.most)
        distance = r / p.scale + noise * self._noise.normal(size=len(t))
        bearing = np.mod(p.yaw + sense * head - GAP_ANGLE + pi, tau) - pi
        no_echo = (r > p.most) | (r < p.least) | (self._noise.uniform(size=len(t)) < p.dropout)
        no_echo |= (np.abs(bearing) < 0.5 * p.gap) | (distance <= 0.0)
        return np.where(no_echo, 0.0, distance)

    def _spot_distance(self, t: FloatArray, laser: FloatArray, direction: FloatArray) -> FloatArray:
        """Return distances [m] along laser beams at angles ``direction`` (n,) [rad].

        At an edge the two halves of the spot are at different distances. The receiver takes the
        weighted mean of both images, whose position is proportional to 1 / r: a mixed pixel. A half
        without an echo has no weight.
        """
        half = 0.5 * self._params.spot
        if not half:
            return self._cast_rays(t, laser, _directions(direction))
        a, b = (self._cast_rays(t, laser, _directions(direction + side)) for side in (-half, half))
        near = np.minimum(np.minimum(a, b), NO_HIT)
        far = np.maximum(a, b)
        far = np.where(far > self._params.most, near, far)
        share = self._noise.uniform(size=len(t))
        mixed: FloatArray = 1.0 / (share / near + (1.0 - share) / far)
        return mixed

    def _cast_rays(self, t: FloatArray, laser: FloatArray, beam: FloatArray) -> FloatArray:
        """Return distances [m] to the first object on each beam; infinite behind glass."""
        reach = self._lines.cast(laser, beam)
        for a in range(0, len(t), PER_PACKET) if self.others else ():
            part = slice(a, a + PER_PACKET)
            moving = np.vstack([other(float(t[part].mean())) for other in self.others])
            if not len(moving):
                continue
            hit = self._cast_moving(moving, laser[part], beam[part])
            reach[part] = np.minimum(reach[part], hit)
        if len(self._room.glass):
            reach[self._glass.cast(laser, beam) < reach] = np.inf
        return reach

    def _in_room(self, t: FloatArray) -> FloatArray:
        """Return poses (n, 3) of the rear axle in the frame of the room."""
        x, y, yaw = self._room.start
        world = self._poses(t)
        c = np.cos(yaw)
        s = np.sin(yaw)
        return np.column_stack((x + c * world[:, 0] - s * world[:, 1],
                                y + s * world[:, 0] + c * world[:, 1], yaw + world[:, 2]))


def _directions(angles: FloatArray) -> FloatArray:
    """Return unit vectors (n, 2) of angles (n,) [rad]."""
    return np.column_stack((np.cos(angles), np.sin(angles)))


class SimLidar:
    """A unit as ``dart_hal.core.ports.ScanSource``, read by the real decoder."""

    name = "the lidar of sim://"
    trouble: DartHalError | None = None

    def __init__(self, unit: LidarUnit) -> None:
        self.unit = unit
        self.stream = LidarStream(unit.model)

    def poll(self, now: float) -> Sequence[Scan]:
        """Return scans whose last byte has arrived by ``now``, the world's time [s]."""
        return [scan for data, t in self.unit.chunks(now) for scan in self.stream.feed(data, t)]

    def close(self) -> None:
        """Do nothing: there is nothing to release."""
