"""Decoder for the bytes of a YDLidar X4: packets and answers to commands. No I/O.

A packet (X4 development manual; words little-endian):

    AA 55 | CT | LSN | FSA FSA | LSA LSA | CS CS | S1 S1 | ... | Sn Sn
    head   type  n     angles, first, last  check   n samples

CT: bit 0 is set in the packet that begins a revolution (one sample, its zero). Its bits 7 to 1 are
the revolutions in 0.1 Hz, 0 if the firmware does not measure them. CS is the exclusive or of all
other words: head, FSA, each sample, CT with LSN, LSA. A sample is in 0.25 mm, 0 = no return. An
angle is 1/64 deg in bits 15 to 1, bit 0 is always set. The samples of a packet are equally spaced
from FSA to LSA, also across 360 deg. The laser is mounted 21.8 mm from the receiver, so a point at
d mm lies at an angle of atan(21.8 (155.3 - d) / (155.3 d)) from the direction of the unit.

The X4 begins to stream at ``START_COMMAND`` and answers it. The X4 Pro streams by itself and does
not answer.
"""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from dataclasses import dataclass
from math import radians
from typing import NamedTuple

import numpy as np

from dart_hal.core.types import FloatArray

# bit/s of an X4.
BAUD = 128_000
# s between two samples of the X4 by its own clock: 5 kHz.
SAMPLE_PERIOD = 0.2e-3
# Commands: start and stop the stream.
START_COMMAND = b"\xa5\x60"
STOP_COMMAND = b"\xa5\x65"

# Bytes of a packet before its samples.
HEADER_SIZE = 10
# m per count of a sample.
DISTANCE_UNIT = 0.25e-3
# rad per count of an angle.
ANGLE_UNIT = radians(1.0 / 64.0)
# mm: distance of the laser from the receiver's axis, and distance ahead at which the beam meets it.
LASER_OFFSET_MM = 21.8
LASER_CROSSING_MM = 155.3
_MARK = re.compile(rb"\xaa\x55|\xa5\x5a")
# Bytes of an answer before its content: A5 5A, 30 bits of length with 2 of mode, type.
_ANSWER = 7
# Bytes of content by type: information, health; 0x81: packets follow.
_CONTENT = {0x04: 20, 0x06: 3, 0x81: 0}


class Packet(NamedTuple):
    """n consecutive beams.

    starts: a revolution begins; hertz: revolutions per second measured by the unit, None = not
    sent; first, last [rad]: direction of the unit, 0 to 2 pi; angle (n,) [rad] of the points, in
    the unit's sense of rotation; distance (n,) [m, NaN = no return]; size: bytes sent after the
    last sample was taken; behind: bytes after it in the same read; lost: bytes before it were of no
    valid packet; later: samples that were taken after its last one before those bytes were sent.
    """

    starts: bool
    hertz: float | None
    first: float
    last: float
    angle: FloatArray
    distance: FloatArray
    size: int
    behind: int
    lost: bool
    later: int = 0


@dataclass(frozen=True, slots=True)
class Answer:
    """Answer to a command: 0x04 information, 0x06 health, 0x15 sample rate, 0x81 it streams."""

    kind: int
    content: bytes

    def text(self) -> str:
        """Return the answer as text."""
        c = self.content
        if self.kind == 0x04:
            return (f"model {c[0]}, firmware {c[2]}.{c[1]}, hardware {c[3]}, serial number "
                    + "".join(str(digit) for digit in c[4:]))
        if self.kind == 0x06:
            return "health good" if c[0] == 0 else f"health {c[0]}, error {c[1] | c[2] << 8}"
        if self.kind == 0x15:
            return f"a sample each {c[0] | c[1] << 8} us"
        return "it streams"


class BytesDecoder(ABC):
    """Finds packets and answers in bytes that arrive in any portions; raises nothing.

    packets: valid ones; broken: heads with a wrong check or form; skipped: bytes of neither packet
    nor answer; answers: the newest of each kind; sample_period [s]: as the unit states it, None
    where that of its model holds.
    """

    def __init__(self) -> None:
        self.packets = 0
        self.broken = 0
        self.skipped = 0
        self.answers: dict[int, Answer] = {}
        self.sample_period: float | None = None
        self._rest = b""
        self._damage = 0

    @abstractmethod
    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that ``data`` completes."""


class LidarDecoder(BytesDecoder):
    """Decoder of an X4."""

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that ``data`` completes."""
        buffer = self._rest + data
        position = 0
        out: list[Packet] = []
        while (mark := _MARK.search(buffer, position)) is not None:
            # 1. Skip bytes up to the next start of a packet or an answer.
            self.skipped += mark.start() - position
            position = mark.start()
            # 2. Keep an incomplete one for the next call.
            length = _find_length(buffer, position)
            if length is None or (length and position + length > len(buffer)):
                self._rest = buffer[position:]
                return out
            # 3. Decode a valid one; otherwise skip its two bytes of start and search on.
            if length and buffer[position] == 0xA5:
                answer = Answer(buffer[position + 6], buffer[position + _ANSWER:position + length])
                self.answers[answer.kind] = answer
            elif length and _is_valid(buffer[position:position + length]):
                self.packets += 1
                damage = self.broken + self.skipped
                out.append(_decode_packet(buffer[position:position + length],
                                          len(buffer) - position - length, damage > self._damage))
                self._damage = damage
            else:
                self.broken += 1
                self.skipped += 2
                length = 2
            position += length
        # The last byte may be the first one of a start.
        keep = len(buffer) - (buffer[-1:] in (b"\xaa", b"\xa5") and position < len(buffer))
        self.skipped += keep - position
        self._rest = buffer[keep:]
        return out


def _find_length(buffer: bytes, start: int) -> int | None:
    """Return the size [bytes] of what begins at ``start``: 0 = invalid, None = not received yet."""
    if buffer[start] == 0xAA:
        if start + 4 > len(buffer):
            return None
        samples = buffer[start + 3]
        return HEADER_SIZE + 2 * samples if samples else 0
    if start + _ANSWER > len(buffer):
        return None
    content = _CONTENT.get(buffer[start + 6])
    return 0 if content is None else _ANSWER + content


def _is_valid(raw: bytes) -> bool:
    """Return whether a packet has the right checksum and the bits that are always set."""
    words = np.frombuffer(raw, "<u2")
    return bool(np.bitwise_xor.reduce(words) == 0 and words[2] & words[3] & 1)


def _decode_packet(raw: bytes, remaining: int, lost: bool) -> Packet:
    """Decode a valid packet; remaining: bytes after it in the same read; lost: as in it."""
    words = np.frombuffer(raw, "<u2")
    first = float(words[2] >> 1) * ANGLE_UNIT
    last = float(words[3] >> 1) * ANGLE_UNIT
    counts = words[HEADER_SIZE // 2:]
    turn = (last - first) % (2.0 * np.pi)
    directions = first + turn * np.arange(len(counts)) / max(len(counts) - 1, 1)
    distance = np.where(counts == 0, np.nan, counts * DISTANCE_UNIT)
    decihertz = raw[2] >> 1
    starts = bool(raw[2] & 1)
    return Packet(starts, decihertz / 10.0 if starts and decihertz else None, first, last,
                  directions + parallax(distance), distance, len(raw), remaining, lost)


def parallax(distance: FloatArray) -> FloatArray:
    """Return the angle [rad] of a point from the unit's direction; 0 without a distance [NaN m]."""
    d = 1e3 * distance
    angle: FloatArray = np.arctan(
        LASER_OFFSET_MM * (LASER_CROSSING_MM - d) / (LASER_CROSSING_MM * d))
    return np.where(np.isnan(d), 0.0, angle)
