"""Consistent overhead byte stuffing: a block without any 0x00.

Every zero is replaced by the distance to the next one; a code byte 0xFF means
254 bytes that no zero follows. S. Cheshire and M. Baker, "Consistent overhead
byte stuffing", IEEE/ACM Trans. Networking 7(2), 1999.
"""

from __future__ import annotations

_FULL = 254


class CobsError(ValueError):
    """A block that is no valid COBS encoding."""


def encode(raw: bytes) -> bytes:
    """Encode bytes of any length, without the delimiter."""
    out = bytearray()
    groups = raw.split(b"\0")
    last = len(groups) - 1
    for number, group in enumerate(groups):
        full = len(group) // _FULL
        for i in range(full):
            out.append(_FULL + 1)
            out += group[i * _FULL:(i + 1) * _FULL]
        rest = group[full * _FULL:]
        # After a full block at the end of the data no further block is necessary: an empty one
        # would decode to the same bytes, but add one byte.
        if rest or not full or number < last:
            out.append(len(rest) + 1)
            out += rest
    return bytes(out)


def decode(block: bytes) -> bytes:
    """Decode a block without its delimiter. Raises CobsError."""
    out = bytearray()
    i = 0
    n = len(block)
    if not n:
        raise CobsError("empty block")
    while i < n:
        code = block[i]
        end = i + code
        if code == 0 or end > n:
            raise CobsError(f"code {code} at {i} points outside a block of {n} B")
        group = block[i + 1:end]
        if 0 in group:
            raise CobsError("0x00 inside a block")
        out += group
        # A code below 255 includes the zero after its group, except at the end of the block.
        if code <= _FULL and end < n:
            out.append(0)
        i = end
    return bytes(out)
