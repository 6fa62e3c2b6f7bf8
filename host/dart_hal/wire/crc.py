"""CRC-16 CCITT of the frames: polynomial 0x1021, not reflected, no final xor.

The initial value is the seed of the message, so the CRC of a frame with another definition is
wrong.
"""

from __future__ import annotations

from binascii import crc_hqx

from dart_hal.wire.messages import SEED_FOREVER


def crc16(data: bytes, seed: int = SEED_FOREVER) -> int:
    """Return the CRC of ``data``; ``crc16(b"123456789") == 0x29B1``."""
    return crc_hqx(data, seed)
