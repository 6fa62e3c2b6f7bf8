"""Bytes of an RPLidar, built without the decoder, by the tables of its protocol document."""

from __future__ import annotations

SCAN_DESCRIPTOR = bytes.fromhex("A5 5A 05 00 00 40 81")
INFO_ANSWER = bytes.fromhex("A5 5A 14 00 00 00 04") + bytes([0x18, 29, 1, 7, *range(16)])
HEALTH_ANSWER = bytes.fromhex("A5 5A 03 00 00 00 06") + bytes([2, 0x34, 0x12])
RATE_ANSWER = bytes.fromhex("A5 5A 04 00 00 00 15") + bytes([0xFC, 0x01, 0xFE, 0x00])


def node(angle_deg: float, distance_mm: float, *, start: bool = False) -> bytes:
    """One node: byte 0 has quality, inverse of the start and start; byte 1 the check bit."""
    quality = 15 if distance_mm else 0
    angle = round(64.0 * angle_deg) % (360 * 64)
    distance = round(4.0 * distance_mm)
    return bytes([quality * 4 + (1 if start else 2), angle % 128 * 2 + 1, angle // 128,
                  distance % 256, distance // 256])


def stream(turns: int, beams: int = 360, *, distance: float = 2000.0) -> bytes:
    """Nodes of some revolutions and the first one of the next."""
    out = b""
    for k in range(turns * beams + 1):
        out += node(k % beams * 360.0 / beams, distance, start=k % beams == 0)
    return out
