"""Consistent overhead byte stuffing: a block without any 0x00.

Every zero is replaced by the distance to the next one; a code byte 0xFF means
254 bytes that no zero follows. S. Cheshire and M. Baker, "Consistent overhead
byte stuffing", IEEE/ACM Trans. Networking 7(2), 1999.
"""

from __future__ import annotations

_FULL = 254


class CobsError(ValueError):
    """A block that no encoder produces."""


def encode(raw: bytes) -> bytes:
    """Encoded block of any length, without the delimiter."""
    out = bytearray()
    groups = raw.split(b"\0")
    last = len(groups) - 1
    for number, group in enumerate(groups):
        full = len(group) // _FULL
        for i in range(full):
            out.append(_FULL + 1)
            out += group[i * _FULL:(i + 1) * _FULL]
        rest = group[full * _FULL:]
        # A full block at the very end stands for itself: a further empty
        # block would decode to the same bytes, but cost one more.
        if rest or not full or number < last:
            out.append(len(rest) + 1)
            out += rest
    return bytes(out)


def decode(block: bytes) -> bytes:
    """Bytes of an encoded block without its delimiter. Raises CobsError."""
    out = bytearray()
    i, n = 0, len(block)
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
        if code <= _FULL and end < n:
            out.append(0)
        i = end
    return bytes(out)
