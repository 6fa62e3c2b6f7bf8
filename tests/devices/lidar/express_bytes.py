"""Packets of an RPLidar's express scan, by the tables of its protocol, without the decoder."""

from __future__ import annotations

EXPRESS_ANSWER = bytes.fromhex("A5 5A 54 00 00 40 82")
EXPRESS_PERIOD = 254e-6
EXPRESS_BYTE_TIME = 10 / 115_200


def packet(start_deg: float, samples: list[tuple[float, int]], *, new: bool = False) -> bytes:
    """One packet: start angle, 32 samples (mm, offset in 1/8 deg); new: first after the request."""
    start = round(64.0 * start_deg) % (360 * 64)
    body = [start % 256, start // 256 + 128 * new]
    for (first, offset), (second, other) in zip(samples[::2], samples[1::2], strict=True):
        for distance, turned in ((round(first), offset), (round(second), other)):
            body += [distance % 64 * 4 + turned // 16, distance // 64]
        body.append(other % 16 * 16 + offset % 16)
    check = 0
    for byte in body:
        check ^= byte
    return bytes([0xA0 + check % 16, 0x50 + check // 16, *body])


def stream(turns: int, beams: int = 704, *, distance: float = 2000.0, offset: int = 0,
           shift: float = 0.0) -> list[bytes]:
    """Packets of some revolutions; shift [deg]: of their first sample."""
    step = 360.0 / beams
    return [packet((shift + k * step) % 360.0, [(distance, offset)] * 32, new=k == 0)
            for k in range(0, turns * beams, 32)]


def arrival(k: int) -> float:
    """Time [s] at which packet k has arrived: it is sent after its last sample."""
    return 5.0 + (32 * k + 31) * EXPRESS_PERIOD + 84 * EXPRESS_BYTE_TIME
