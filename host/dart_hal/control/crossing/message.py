"""A message of the order as bytes: payload of the fleet's transport.

    version u8 | key u32 | id u8 | cars u8 | path u8 | phase u8 | boot u32 | seq u32 | ts u64 [us]
    | s_minus f64 [m] | cars x (grant u64 [us], heard u32)

A datagram contains the message of its sender, followed by one of another car if both fit.
``key``: checksum of layout and roster. Invalid bytes are classified, and never raise.
"""

from __future__ import annotations

from enum import Enum
from math import isfinite
from struct import Struct

from dart_hal.control.crossing.order import CrossingPhase, OrderMessage
from dart_hal.core.errors import UsageError

# Version of this format; layout of the header and of the part for each car.
FORMAT_VERSION = 2
HEADER = Struct("<BIBBBBIIQd")
CAR_RECORD = Struct("<QI")
# Largest number of cars: 225 bytes.
MAX_CARS = 16
# Largest datagram [bytes]: up to 7 cars relay messages, more do not fit.
MAX_DATAGRAM_BYTES = 255
# Largest stamp [us]: a later one would leave no stamp above it.
MAX_STAMP = 1 << 62
# Largest absolute arc length [m].
MAX_ARC_LENGTH = 1e4


class MessageFault(str, Enum):
    """Fault of received bytes.

    VERSION: another format; KEY: another layout or roster; LENGTH: truncated or too long; NUMBER:
    an impossible value.
    """

    VERSION = "VERSION"
    KEY = "KEY"
    LENGTH = "LENGTH"
    NUMBER = "NUMBER"


def encode(m: OrderMessage, key: int) -> bytes:
    """Return the bytes of a message. Raises UsageError for more than ``MAX_CARS``."""
    if len(m.grants) > MAX_CARS:
        raise UsageError(
            "too many cars for a crossing", found=f"{len(m.grants)}", expected=f"at most {MAX_CARS}"
        )
    head = HEADER.pack(
        FORMAT_VERSION,
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
    return head + b"".join(map(CAR_RECORD.pack, m.grants, m.heard))


def split_datagram(data: bytes) -> tuple[bytes, bytes]:
    """Split a datagram into the message of its sender and the relayed one, b"" = none."""
    size = (
        HEADER.size + HEADER.unpack_from(data)[3] * CAR_RECORD.size
        if len(data) >= HEADER.size
        else 0
    )
    return (data[:size], data[size:]) if size and len(data) == 2 * size else (data, b"")


def decode(data: bytes, key: int) -> OrderMessage | MessageFault:
    """Return the message in bytes, or their fault."""
    if len(data) < HEADER.size:
        return MessageFault.LENGTH
    version, key_received, id_, n, path, phase, boot, seq, ts, s_minus = HEADER.unpack_from(data)
    if version != FORMAT_VERSION:
        return MessageFault.VERSION
    if key_received != key:
        return MessageFault.KEY
    if len(data) != HEADER.size + n * CAR_RECORD.size:
        return MessageFault.LENGTH
    rows = list(CAR_RECORD.iter_unpack(data[HEADER.size :]))
    grants = tuple(g for g, _ in rows)
    heard = tuple(b for _, b in rows)
    if (
        phase > max(CrossingPhase)
        or not boot
        or max((ts, *grants)) > MAX_STAMP
        or not (isfinite(s_minus) and -MAX_ARC_LENGTH < s_minus < MAX_ARC_LENGTH)
        or (phase == CrossingPhase.WANT) > (ts > 0)
    ):
        return MessageFault.NUMBER
    return OrderMessage(id_, boot, seq, path, CrossingPhase(phase), ts, s_minus, grants, heard)
