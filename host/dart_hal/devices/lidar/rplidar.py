"""Decoder for the bytes of an RPLidar (A1, A2, A3; standard scan) of SLAMTEC. No I/O.

A request is A5 and a command. Its answer begins with a descriptor (interface protocol of SLAMTEC;
words little-endian):

    A5 5A | length of 30 bits, mode of 2 bits | type | content of this length

The scan answers with nodes of five bytes without end, one for each sample:

    quality << 2 | !S << 1 | S | angle << 1 | C | distance
    u8                           u16              u16

S is set in the first node of a revolution, C is always set. Angles are in 1/64 deg, clockwise from
above, distances in 0.25 mm (0 = no return). The unit has corrected the angle of each point for the
offset of its laser, so that angles may go back a little at an edge.

Nodes have no checksum. A node is valid if both pairs of bits are right, its angle is one, and it
lies at most ``MAX_NODE_STEP`` ahead of and ``MAX_NODE_STEP_BACK`` behind the one before. After an
invalid node, ``SYNC_NODES`` valid ones in a row are required.
"""

from __future__ import annotations

import struct
from itertools import pairwise
from math import pi, radians, tau

import numpy as np
from numpy.typing import NDArray

from dart_hal.core.types import FloatArray
from dart_hal.devices.lidar.packets import Answer, BytesDecoder, Packet

# bit/s: A1 and A2M8; A2M12 and A3.
RPLIDAR_BAUD = 115_200
RPLIDAR_FAST_BAUD = 256_000
# s between two samples of the standard scan of an A1; other models state theirs.
RPLIDAR_SAMPLE_PERIOD = 508e-6
# s: periods that are accepted from the unit: 32 kHz to 500 Hz.
MIN_SAMPLE_PERIOD = 31e-6
MAX_SAMPLE_PERIOD = 2e-3
NODE_SIZE = 5
# Nodes in a packet at most: less than a sixth of a revolution.
MAX_PACKET_NODES = 32
NODE_DISTANCE_UNIT = 0.25e-3
NODE_ANGLE_UNIT = radians(1.0 / 64.0)
# Counts of a turn.
TURN_COUNTS = 360 * 64
# Chance 1e-7 per byte that random bytes pass.
SYNC_NODES = 5
# rad: 508 us at ten revolutions per second are 1.8 deg; the correction moves points by up to 8 deg.
MAX_NODE_STEP = radians(20.0)
MAX_NODE_STEP_BACK = radians(10.0)

STOP_REQUEST = b"\xa5\x25"
SCAN_REQUEST = b"\xa5\x20"
INFO_REQUEST = b"\xa5\x50"
HEALTH_REQUEST = b"\xa5\x52"
SAMPLE_RATE_REQUEST = b"\xa5\x59"
# Speed of the motor of an A2 or A3, 660 of 1023 and 0, with the exclusive or of all bytes. An A1
# ignores it: its motor runs while DTR is low.
MOTOR_REQUEST = b"\xa5\xf0\x02\x94\x02\xc1"
MOTOR_STOP_REQUEST = b"\xa5\xf0\x02\x00\x00\x57"

SAMPLE_RATE_TYPE = 0x15
SCAN_TYPE = 0x81
# Descriptors of the requests above, with the bytes of content after each.
DESCRIPTORS = {
    b"\xa5\x5a\x14\x00\x00\x00\x04": 20,
    b"\xa5\x5a\x03\x00\x00\x00\x06": 3,
    b"\xa5\x5a\x04\x00\x00\x00\x15": 4,
    b"\xa5\x5a\x05\x00\x00\x40\x81": 0,
}
_DESCRIPTOR_SIZE = 7
_NODE = np.dtype([("flags", "u1"), ("angle", "<u2"), ("distance", "<u2")])


class RplidarDecoder(BytesDecoder):
    """Decoder of the standard scan of an RPLidar.

    packets: valid nodes; broken: losses of the beat of the nodes.
    """

    def __init__(self) -> None:
        super().__init__()
        self._synchronised = False
        self._last: float | None = None

    def feed(self, data: bytes) -> list[Packet]:
        """Return the nodes that ``data`` completes, in packets of consecutive ones."""
        buffer = self._rest + data
        position = 0
        out: list[Packet] = []
        while True:
            if self._synchronised:
                taken = self._take_nodes(buffer, position, out)
                position += taken
                if len(buffer) - position < NODE_SIZE:
                    break
                self._synchronised = False
                self.broken += 1
            found = self._find_start(buffer, position)
            self.skipped += found - position
            position = found
            if not self._synchronised:
                taken = self._take_answer(buffer, position)
                position += taken
                if not taken:
                    break
        self._rest = buffer[position:]
        return out

    def _find_start(self, buffer: bytes, position: int) -> int:
        """Return where an answer or a chain of nodes begins, or may begin with further bytes.

        A complete chain sets ``_synchronised``.
        """
        while position < len(buffer):
            head = buffer[position:position + _DESCRIPTOR_SIZE]
            if any(d.startswith(head) for d in DESCRIPTORS):
                return position
            chain = _check_chain(buffer, position)
            if chain is None:
                return position
            if chain:
                self._synchronised = True
                self._last = None
                return position
            position += 1
        return position

    def _take_answer(self, buffer: bytes, position: int) -> int:
        """Take the answer at ``position``; return its size [bytes], 0 if it is incomplete."""
        head = buffer[position:position + _DESCRIPTOR_SIZE]
        length = DESCRIPTORS.get(head)
        if length is None or position + _DESCRIPTOR_SIZE + length > len(buffer):
            return 0
        size = _DESCRIPTOR_SIZE + length
        answer = Answer(head[-1], buffer[position + _DESCRIPTOR_SIZE:position + size])
        self.answers[answer.kind] = answer
        if answer.kind == SCAN_TYPE:
            self._synchronised = True
            self._last = None
        self.sample_period = read_sample_period(answer) or self.sample_period
        return size

    def _take_nodes(self, buffer: bytes, position: int, out: list[Packet]) -> int:
        """Append the valid nodes at ``position`` to ``out``; return their size [bytes]."""
        nodes = _nodes_of(buffer[position:])
        if not len(nodes):
            return 0
        angle = (nodes["angle"] >> 1).astype(np.float64) * NODE_ANGLE_UNIT
        valid = _are_valid(nodes)
        valid[1:] &= _are_near(np.diff(angle))
        if self._last is not None:
            valid[0] &= bool(_are_near(angle[:1] - self._last)[0])
        count = len(nodes) if valid.all() else int(np.argmin(valid))
        if not count:
            return 0
        self.packets += count
        self._last = float(angle[count - 1])
        starts = (nodes["flags"][:count] & 1).astype(bool)
        # A packet begins with a revolution, and has at most MAX_PACKET_NODES nodes.
        cuts = {0, count, *range(0, count, MAX_PACKET_NODES), *np.flatnonzero(starts).tolist()}
        edges = sorted(cuts)
        damage = self.broken + self.skipped
        lost = damage > self._damage
        self._damage = damage
        for a, b in pairwise(edges):
            counts = nodes["distance"][a:b]
            distance = np.where(counts == 0, np.nan, counts * NODE_DISTANCE_UNIT)
            behind = len(buffer) - position - b * NODE_SIZE
            out.append(Packet(bool(starts[a]), None, float(angle[a]), float(angle[b - 1]),
                              angle[a:b] % tau, distance, NODE_SIZE, behind, lost))
            lost = False
        return count * NODE_SIZE


def read_sample_period(answer: Answer, express: bool = False) -> float | None:
    """Return the sample period [s] of a scan in an answer; None if it has none, or no likely one.
    """
    if answer.kind != SAMPLE_RATE_TYPE:
        return None
    period = 1e-6 * struct.unpack("<HH", answer.content)[express]
    return period if MIN_SAMPLE_PERIOD <= period <= MAX_SAMPLE_PERIOD else None


def _nodes_of(raw: bytes) -> NDArray[np.void]:
    """Return the complete nodes of bytes."""
    return np.frombuffer(raw, _NODE, len(raw) // NODE_SIZE)


def _are_valid(nodes: NDArray[np.void]) -> NDArray[np.bool_]:
    """Return which nodes have the right bits and an angle below 360 deg."""
    flags = nodes["flags"]
    valid: NDArray[np.bool_] = ((flags ^ flags >> 1) & nodes["angle"] & 1).astype(bool)
    return valid & (nodes["angle"] >> 1 < TURN_COUNTS)


def _are_near(steps: FloatArray) -> NDArray[np.bool_]:
    """Return which steps [rad] from node to node are possible."""
    wrapped = (steps + pi) % tau - pi
    return (wrapped >= -MAX_NODE_STEP_BACK) & (wrapped <= MAX_NODE_STEP)


def _check_chain(buffer: bytes, position: int) -> bool | None:
    """Return whether a chain of ``SYNC_NODES`` begins at ``position``; None = bytes are missing.

    The nodes are valid and near each other, the head turns, at most one node is a start.
    """
    last: int | None = None
    moved = False
    starts = 0
    for place in range(position, position + SYNC_NODES * NODE_SIZE, NODE_SIZE):
        node = buffer[place:place + NODE_SIZE]
        if node and not (node[0] ^ node[0] >> 1) & 1:
            return False
        if len(node) > 1 and not node[1] & 1:
            return False
        if len(node) < NODE_SIZE:
            return None
        angle = (node[1] | node[2] << 8) >> 1
        if angle >= TURN_COUNTS:
            return False
        if last is not None:
            step = (angle - last + TURN_COUNTS // 2) % TURN_COUNTS - TURN_COUNTS // 2
            if not -MAX_NODE_STEP_BACK <= step * NODE_ANGLE_UNIT <= MAX_NODE_STEP:
                return False
            moved = moved or step != 0
        last = angle
        starts += node[0] & 1
    return moved and starts <= 1
