"""Bytes of an LD19, built without the decoder: struct and a bitwise CRC, by the manual's table."""

from __future__ import annotations

import struct


def crc_of(data: bytes) -> int:
    """CRC of 8 bits, polynomial 0x4D, by long division of one bit after the other."""
    register = 0
    for byte in data:
        for bit in range(7, -1, -1):
            carry = (register >> 7) ^ (byte >> bit & 1)
            register = (register << 1) & 0xFF
            if carry:
                register ^= 0x4D
    return register


def packet(first_deg: float, last_deg: float, distances_mm: list[int], *, speed: int = 3600,
           stamp: int = 0) -> bytes:
    """One packet: angles in deg, twelve distances in mm (0 = nothing came back)."""
    raw = struct.pack("<BBHH", 0x54, 0x2C, speed, round(100.0 * first_deg) % 36000)
    for distance in distances_mm:
        raw += struct.pack("<HB", distance, 180)
    raw += struct.pack("<HH", round(100.0 * last_deg) % 36000, stamp)
    return raw + bytes([crc_of(raw)])


def stream(turns: int, beams: int = 450, *, distance: int = 2000, shift: float = 0.2) -> bytes:
    """Packets of some revolutions; their cuts do not agree with the zero."""
    step = 360.0 / beams
    out = b""
    for k in range(0, turns * beams // 12 * 12, 12):
        out += packet((shift + k * step) % 360.0, (shift + (k + 11) * step) % 360.0,
                      [distance] * 12, stamp=round(k / 4.5) % 30000)
    return out
