"""A message of the order as bytes: what the fleet's transport carries for this room.

    version u8 | key u32 | id u8 | cars u8 | path u8 | phase u8 | boot u32 | seq u32 | ts u64 [us]
    | s_minus f64 [m] | cars x (grant u64 [us], heard u32)

What is sent is a car's own message, and behind it one of another car's where both find room.
``key``: of layout and roster. Whatever else comes is named, and never raises.
"""

from __future__ import annotations

from enum import Enum
from math import isfinite
from struct import Struct

from dart_hal.control.crossing.order import Message, Phase
from dart_hal.core.errors import UsageError

VERSION = 2
HEAD = Struct("<BIBBBBIIQd")
CAR = Struct("<QI")
# The most: 225 bytes.
CARS = 16
# bytes of what is sent, at most: 7 cars pass on what they heard, more have no room for it.
ROOM = 255
# us of a stamp: whoever tells a later one would leave no stamp above it.
LATEST = 1 << 62
# m of a path.
LONGEST = 1e4


class Fault(str, Enum):
    """What is wrong with bytes. VERSION: of another; KEY: of another layout or roster; LENGTH:
    cut or too long; NUMBER: one that cannot be."""

    VERSION = "VERSION"
    KEY = "KEY"
    LENGTH = "LENGTH"
    NUMBER = "NUMBER"


def encode(m: Message, key: int) -> bytes:
    """The bytes of a message. Raises UsageError for more than ``CARS``."""
    if len(m.grants) > CARS:
        raise UsageError(
            "too many cars for a crossing", found=f"{len(m.grants)}", expected=f"at most {CARS}"
        )
    head = HEAD.pack(
        VERSION,
        key,
        m.id,
        len(m.grants),
        m.path,
        m.phase,
        m.boot,
        m.seq & 0xFFFFFFFF,
        m.ts,
        m.s_minus,
    )
    return head + b"".join(map(CAR.pack, m.grants, m.heard))


def parts(data: bytes) -> tuple[bytes, bytes]:
    """A car's own message, and that which it passes on, b"" = none."""
    size = HEAD.size + HEAD.unpack_from(data)[3] * CAR.size if len(data) >= HEAD.size else 0
    return (data[:size], data[size:]) if size and len(data) == 2 * size else (data, b"")


def decode(data: bytes, key: int) -> Message | Fault:
    """The message in bytes, or what is wrong with them."""
    if len(data) < HEAD.size:
        return Fault.LENGTH
    version, told, id_, n, path, phase, boot, seq, ts, s_minus = HEAD.unpack_from(data)
    if version != VERSION:
        return Fault.VERSION
    if told != key:
        return Fault.KEY
    if len(data) != HEAD.size + n * CAR.size:
        return Fault.LENGTH
    rows = list(CAR.iter_unpack(data[HEAD.size :]))
    grants = tuple(g for g, _ in rows)
    heard = tuple(b for _, b in rows)
    if (
        phase > max(Phase)
        or not boot
        or max((ts, *grants)) > LATEST
        or not (isfinite(s_minus) and -LONGEST < s_minus < LONGEST)
        or (phase == Phase.WANT) > (ts > 0)
    ):
        return Fault.NUMBER
    return Message(id_, boot, seq, path, Phase(phase), ts, s_minus, grants, heard)
