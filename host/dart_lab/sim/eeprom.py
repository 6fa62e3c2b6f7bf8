"""EEPROM of a simulated Nano: its identity and parameters, as the firmware stores them.

A record is kept in one of two slots: magic u16, layout u8, flags u8, counter
u16, data, crc16 u16. Without a preset a new board spends half a second of
its first boot on making an id.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping

from dart_hal.wire.crc import crc16
from dart_hal.wire.messages import PARAM_BY_NAME, PARAMS

SIZE = 1024
IDENTITY_AT, IDENTITY_MAGIC = 0xE0, 0x4944
PARAMS_AT, PARAMS_MAGIC = 0xA0, 0x5044
LAYOUT = 1


def record(magic: int, data: bytes) -> bytes:
    """One slot with the counter 1."""
    body = struct.pack("<HBBH", magic, LAYOUT, 0, 1) + data
    return body + struct.pack("<H", crc16(body))


def packed_params(values: Mapping[int, int]) -> bytes:
    """Parameters by id as the firmware keeps them: u16 each, the baud rate in hundreds."""
    words = (values[p.id] // (100 if p.name == "baud" else 1) for p in PARAMS)
    return struct.pack(f"<{len(PARAMS)}H", *words)


def preset(board_id: int, params: Mapping[str, int] | None = None) -> bytes:
    """A board that has its id and, if named, parameters other than the defaults."""
    image = bytearray(b"\xff" * SIZE)
    identity = record(IDENTITY_MAGIC, struct.pack("<IH", board_id, 0))
    image[IDENTITY_AT:IDENTITY_AT + len(identity)] = identity
    if params:
        values = {p.id: p.default for p in PARAMS}
        values |= {PARAM_BY_NAME[name].id: value for name, value in params.items()}
        block = record(PARAMS_MAGIC, packed_params(values))
        image[PARAMS_AT:PARAMS_AT + len(block)] = block
    return bytes(image)


def stored(image: bytes) -> tuple[int | None, dict[int, int]]:
    """``(board_id, parameters by id)`` of a preset image; None and {} where absent."""
    identity = image[IDENTITY_AT:IDENTITY_AT + 14]
    block = image[PARAMS_AT:PARAMS_AT + 8 + 2 * len(PARAMS)]
    words = struct.unpack_from(f"<{len(PARAMS)}H", block, 6)
    params = {p.id: w * (100 if p.name == "baud" else 1)
              for p, w in zip(PARAMS, words, strict=True)}
    board = struct.unpack_from("<I", identity, 6)[0]
    return (board if _good(identity, IDENTITY_MAGIC) else None,
            params if _good(block, PARAMS_MAGIC) else {})


def _good(slot: bytes, magic: int) -> bool:
    body, (crc,) = slot[:-2], struct.unpack("<H", slot[-2:])
    return body[:2] == struct.pack("<H", magic) and crc == crc16(body)
