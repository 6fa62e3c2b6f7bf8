"""EEPROM of a simulated Nano: its identity and parameters, as the firmware stores them.

A record is stored in one of two slots: magic u16, layout u8, flags u8, counter u16, data,
crc16 u16. A board without an identity needs half a second of its first boot to make one.
"""

from __future__ import annotations

import struct
from collections.abc import Mapping

from dart_hal.wire.crc import crc16
from dart_hal.wire.messages import PARAM_BY_NAME, PARAMS

EEPROM_SIZE = 1024
# Address and magic of the first slot of the identity, and of the parameters.
IDENTITY_ADDRESS = 0xE0
IDENTITY_MAGIC = 0x4944
PARAMS_ADDRESS = 0xA0
PARAMS_MAGIC = 0x5044
RECORD_LAYOUT = 1


def encode_record(magic: int, data: bytes) -> bytes:
    """Return one slot with the counter 1."""
    body = struct.pack("<HBBH", magic, RECORD_LAYOUT, 0, 1) + data
    return body + struct.pack("<H", crc16(body))


def encode_params(values: Mapping[int, int]) -> bytes:
    """Encode parameters by id as the firmware does: u16 each, the baud rate in hundreds."""
    words = (values[p.id] // (100 if p.name == "baud" else 1) for p in PARAMS)
    return struct.pack(f"<{len(PARAMS)}H", *words)


def make_eeprom(board_id: int, params: Mapping[str, int] | None = None) -> bytes:
    """Return the EEPROM of a board with an id and, if given, other than default parameters."""
    # An erased EEPROM, in which the second slots remain empty.
    image = bytearray(b"\xff" * EEPROM_SIZE)
    identity = encode_record(IDENTITY_MAGIC, struct.pack("<IH", board_id, 0))
    image[IDENTITY_ADDRESS:IDENTITY_ADDRESS + len(identity)] = identity
    if params:
        values = {p.id: p.default for p in PARAMS}
        values |= {PARAM_BY_NAME[name].id: value for name, value in params.items()}
        block = encode_record(PARAMS_MAGIC, encode_params(values))
        image[PARAMS_ADDRESS:PARAMS_ADDRESS + len(block)] = block
    return bytes(image)


def parse_eeprom(image: bytes) -> tuple[int | None, dict[int, int]]:
    """Return the board id and the parameters by id of an image; None and {} where absent."""
    identity = image[IDENTITY_ADDRESS:IDENTITY_ADDRESS + 14]
    block = image[PARAMS_ADDRESS:PARAMS_ADDRESS + 8 + 2 * len(PARAMS)]
    words = struct.unpack_from(f"<{len(PARAMS)}H", block, 6)
    params = {p.id: w * (100 if p.name == "baud" else 1)
              for p, w in zip(PARAMS, words, strict=True)}
    board = struct.unpack_from("<I", identity, 6)[0]
    return (board if _is_valid(identity, IDENTITY_MAGIC) else None,
            params if _is_valid(block, PARAMS_MAGIC) else {})


def _is_valid(slot: bytes, magic: int) -> bool:
    body = slot[:-2]
    (crc,) = struct.unpack("<H", slot[-2:])
    return body[:2] == struct.pack("<H", magic) and crc == crc16(body)
