"""Decoder for the bytes of an RPLidar (A1, A2, A3) of SLAMTEC in its express scan. No I/O.

After its descriptor the unit sends packets of 84 bytes for 32 samples, without end (interface
protocol of SLAMTEC and its SDK; words little-endian):

    A | check & 15 | 5 | check >> 4 | S << 15 | start | 16 x (pair of samples)
    u4  u4           u4  u4           u16               5 bytes

    distance << 2 | offset >> 4 | distance << 2 | offset >> 4 | offset & 15, offset & 15
    u16                           u16                           u4 second    u4 first

The check is the exclusive or of the bytes from the third on. S: the first packet after the request.
The start angle of the unit is in 1/64 deg, clockwise from above, distances in mm (0 = no return).
The samples of a packet are equally spaced from its start angle to that of the next packet, so they
are known when that has arrived. Sample k is at

    angle_k = start + (next start - start) k / 32 - offset_k / 8 deg

where the offset is that of the laser at this distance. A packet that contains the zero is returned
as two. Firmware before 1.17 has no express scan, and does not answer.
"""

from __future__ import annotations

from functools import reduce
from math import pi, radians, tau
from operator import xor

import numpy as np

from dart_hal.devices.lidar.packets import Answer, BytesDecoder, Packet
from dart_hal.devices.lidar.rplidar import DESCRIPTORS, NODE_ANGLE_UNIT, read_sample_period

# s between two samples of the express scan of an A1; other models state theirs.
EXPRESS_SAMPLE_PERIOD = 254e-6
# Samples of a packet, and bytes: a header, and five of each pair of samples.
EXPRESS_SAMPLES = 32
EXPRESS_HEADER_SIZE = 4
EXPRESS_PACKET_SIZE = EXPRESS_HEADER_SIZE + 5 * EXPRESS_SAMPLES // 2
EXPRESS_DISTANCE_UNIT = 1e-3
# The head turns at most by this factor further in a packet than in the one before; a lost packet
# would double it.
MAX_TURN_GROWTH = 1.5
EXPRESS_OFFSET_UNIT = radians(1.0 / 8.0)
# The request has five bytes: working mode 0, and reserved ones; then the exclusive or of all.
EXPRESS_REQUEST = b"\xa5\x82\x05\x00\x00\x00\x00\x00\x22"
EXPRESS_DESCRIPTOR = b"\xa5\x5a\x54\x00\x00\x40\x82"
_ANSWERS = {head: size for head, size in DESCRIPTORS.items() if size} | {EXPRESS_DESCRIPTOR: 0}
_DESCRIPTOR_SIZE = 7
_PAIR = np.dtype([("distances", "<u2", 2), ("offsets", "u1")])


class ExpressDecoder(BytesDecoder):
    """Decoder of the express scan of an RPLidar."""

    def __init__(self) -> None:
        super().__init__()
        # The newest valid packet, whose samples wait for the start angle of the next one.
        self._waiting: bytes | None = None
        self._turn = 0.0
        self._last = 0.0
        self._lost = False

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets whose samples ``data`` makes known."""
        buffer = self._rest + data
        position = 0
        out: list[Packet] = []
        while position < len(buffer):
            # 1. An answer begins like a packet, so it is looked for first.
            head = buffer[position:position + _DESCRIPTOR_SIZE]
            if any(known.startswith(head) for known in _ANSWERS):
                size = _DESCRIPTOR_SIZE + _ANSWERS.get(head, 0)
                if len(head) < _DESCRIPTOR_SIZE or position + size > len(buffer):
                    break
                answer = Answer(head[-1], buffer[position + _DESCRIPTOR_SIZE:position + size])
                self.answers[answer.kind] = answer
                self.sample_period = read_sample_period(answer, express=True) or self.sample_period
                position += size
                continue
            # 2. Skip a byte that begins no packet.
            if head[0] >> 4 != 0xA or (len(head) > 1 and head[1] >> 4 != 0x5):
                self.skipped += 1
                position += 1
                continue
            end = position + EXPRESS_PACKET_SIZE
            if end > len(buffer):
                break
            # 3. Take a valid packet; otherwise search on from the next byte.
            raw = buffer[position:end]
            if reduce(xor, raw[2:]) != (raw[0] & 0xF | raw[1] << 4 & 0xF0):
                self.broken += 1
                self.skipped += 1
                position += 1
                continue
            out += self._take(raw, len(buffer) - end)
            position = end
        self._rest = buffer[position:]
        return out

    def _take(self, raw: bytes, remaining: int) -> list[Packet]:
        """Take a valid packet; return the samples of the one before, which it makes known."""
        self.packets += 1
        before = self._waiting
        self._waiting = raw
        damage = self.broken + self.skipped
        if damage > self._damage:
            # This start angle may be that of a later packet.
            self._damage = damage
            self._lost = True
            before = None
        if before is None or raw[3] & 0x80:
            return []
        turn = (_start_of(raw) - _start_of(before)) % tau
        whole = turn < MAX_TURN_GROWTH * (self._turn or turn)
        self._turn = turn
        if turn and not whole:
            # A packet was dropped as a whole between the two.
            self._lost = True
            return []
        lost = self._lost
        self._lost = False
        return self._decode(before, turn, remaining, lost)

    def _decode(self, raw: bytes, turn: float, remaining: int, lost: bool) -> list[Packet]:
        """Decode the samples of a packet: one part, or two where a revolution begins within it.

        turn [rad]: to the start angle of the next packet.
        """
        head = _start_of(raw) + turn * np.arange(EXPRESS_SAMPLES) / EXPRESS_SAMPLES
        pairs = np.frombuffer(raw, _PAIR, EXPRESS_SAMPLES // 2, EXPRESS_HEADER_SIZE)
        words = pairs["distances"].ravel()
        low = np.column_stack([pairs["offsets"] & 0xF, pairs["offsets"] >> 4]).ravel()
        offset = ((words & 3) << 4 | low) * EXPRESS_OFFSET_UNIT
        counts = words >> 2
        distance = np.where(counts == 0, np.nan, counts * EXPRESS_DISTANCE_UNIT)
        # Samples from this one on belong to a new revolution.
        cut = int(np.searchsorted(head, tau))
        starts = pi < self._last - float(head[0])
        self._last = float(head[-1]) % tau
        out = []
        for part, begins in ((slice(0, cut), starts), (slice(cut, None), cut < EXPRESS_SAMPLES)):
            heads = head[part] % tau
            if len(heads):
                out.append(Packet(begins, None, float(heads[0]), float(heads[-1]),
                                  (head[part] - offset[part]) % tau, distance[part],
                                  EXPRESS_PACKET_SIZE, remaining, lost, EXPRESS_SAMPLES))
                lost = False
        return out


def _start_of(raw: bytes) -> float:
    """Return the start angle of a packet [rad]."""
    return float(int.from_bytes(raw[2:4], "little") & 0x7FFF) * NODE_ANGLE_UNIT % tau
