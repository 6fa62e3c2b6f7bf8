"""Decoder for the bytes of an LD19 of LDROBOT. No I/O.

A packet of 47 bytes (LD19 development manual; words little-endian):

    54 | 2C | speed | first | 12 x (distance, intensity) | last | time | check
    u8   u8   u16     u16           u16       u8           u16    u16    u8

The speed is in deg/s, angles in 0.01 deg, distances in mm (0 = no return), the time in ms up to
30000. The samples are equally spaced from ``first`` to ``last``, also across 360 deg. The check is
a CRC of 8 bits with the polynomial 0x4D over all bytes before it. The unit streams by itself, at
4500 samples per second, and takes no commands. Its angles grow clockwise from above.

No packet marks the start of a revolution: it is where the angle falls. A packet that contains this
place is returned as two.
"""

from __future__ import annotations

import struct
from math import pi, radians, tau

import numpy as np

from dart_hal.devices.lidar.packets import BytesDecoder, Packet

# bit/s.
LD19_BAUD = 230_400
# s between two samples.
LD19_SAMPLE_PERIOD = 1.0 / 4500.0
LD19_PACKET_SIZE = 47
LD19_SAMPLES = 12
LD19_HEAD = b"\x54\x2c"
# rad per count of an angle, m per count of a distance.
LD19_ANGLE_UNIT = radians(0.01)
LD19_DISTANCE_UNIT = 1e-3
CRC_POLYNOMIAL = 0x4D
_SAMPLE = np.dtype([("distance", "<u2"), ("intensity", "u1")])


def _crc_table() -> bytes:
    """Return the CRC of each single byte."""
    table = bytearray()
    for value in range(256):
        for _ in range(8):
            value = (value << 1 ^ (CRC_POLYNOMIAL if value & 0x80 else 0)) & 0xFF
        table.append(value)
    return bytes(table)


_CRC = _crc_table()


def crc8(data: bytes) -> int:
    """Return the check of bytes: most significant bit first, initial value 0."""
    crc = 0
    for byte in data:
        crc = _CRC[crc ^ byte]
    return crc


class Ld19Decoder(BytesDecoder):
    """Decoder of an LD19, which answers nothing."""

    def __init__(self) -> None:
        super().__init__()
        self._last = 0.0

    def feed(self, data: bytes) -> list[Packet]:
        """Return the packets that ``data`` completes."""
        buffer = self._rest + data
        position = 0
        out: list[Packet] = []
        while (start := buffer.find(LD19_HEAD, position)) >= 0:
            self.skipped += start - position
            position = start
            end = start + LD19_PACKET_SIZE
            if end > len(buffer):
                break
            raw = buffer[start:end]
            if crc8(raw[:-1]) == raw[-1]:
                self.packets += 1
                out += self._decode(raw, len(buffer) - end)
                position = end
            else:
                self.broken += 1
                self.skipped += len(LD19_HEAD)
                position += len(LD19_HEAD)
        else:
            # The last byte may be the first one of a head.
            keep = len(buffer) - (buffer[-1:] == LD19_HEAD[:1] and position < len(buffer))
            self.skipped += keep - position
            position = keep
        self._rest = buffer[position:]
        return out

    def _decode(self, raw: bytes, remaining: int) -> list[Packet]:
        """Decode a valid packet: one part, or two where a revolution begins within it."""
        speed, start_count = struct.unpack_from("<HH", raw, 2)
        (end_count,) = struct.unpack_from("<H", raw, LD19_PACKET_SIZE - 5)
        first = (start_count * LD19_ANGLE_UNIT) % tau
        turn = (end_count * LD19_ANGLE_UNIT - first) % tau
        samples = np.frombuffer(raw, _SAMPLE, LD19_SAMPLES, 6)["distance"]
        distance = np.where(samples == 0, np.nan, samples * LD19_DISTANCE_UNIT)
        angle = first + turn * np.arange(LD19_SAMPLES) / (LD19_SAMPLES - 1)
        # Samples from this one on belong to a new revolution. A small step back is rounding.
        cut = int(np.searchsorted(angle, tau))
        wraps = cut < LD19_SAMPLES
        starts = pi < self._last - first
        self._last = float(angle[-1]) % tau
        hertz = speed / 360.0 if speed else None
        damage = self.broken + self.skipped
        lost = damage > self._damage
        self._damage = damage
        out = []
        for part, begins in ((slice(0, cut), starts), (slice(cut, None), wraps)):
            angles = angle[part] % tau
            if len(angles):
                out.append(Packet(begins, hertz if begins else None, float(angles[0]),
                                  float(angles[-1]), angles, distance[part], len(raw), remaining,
                                  lost))
                lost = False
        return out
