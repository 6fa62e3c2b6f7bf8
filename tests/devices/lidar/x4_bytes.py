"""Bytes of an X4, built without the decoder: struct and plain loops, by the manual's table."""

from __future__ import annotations

import struct


def packet(first_deg: float, last_deg: float, distances_mm: list[float], *,
           starts: bool = False, hertz: float = 0.0) -> bytes:
    """One packet: angles in deg (0 to 360), distances in mm (0 = nothing came back)."""
    samples = [round(4.0 * d) for d in distances_mm]
    kind = round(10.0 * hertz) << 1 | starts
    fsa, lsa = (round(64.0 * a) << 1 | 1 for a in (first_deg, last_deg))
    check = 0x55AA ^ fsa
    for sample in samples:
        check ^= sample
    check ^= kind | len(samples) << 8
    check ^= lsa
    return struct.pack(f"<HBBHHH{len(samples)}H", 0x55AA, kind, len(samples), fsa, lsa, check,
                       *samples)


def revolution(beams: int = 606, per: int = 40, *, hertz: float = 0.0, shift: float = 0.0,
               far: float = 2000.0) -> list[bytes]:
    """Packets of one revolution: the zero by itself, then ``per`` samples each."""
    step = 360.0 / beams
    out = [packet(shift, shift, [far], starts=True, hertz=hertz)]
    k = 1
    while k < beams:
        n = min(per, beams - k)
        out.append(packet((shift + k * step) % 360.0, (shift + (k + n - 1) * step) % 360.0,
                          [far] * n))
        k += n
    return out
