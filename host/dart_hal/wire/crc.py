"""CRC-16 CCITT as the frames use it: polynomial 0x1021, not reflected, no final xor.

The start value is the seed of the message, so a frame of another definition
fails its check.
"""

from __future__ import annotations

from binascii import crc_hqx

from dart_hal.wire.messages import SEED_FOREVER


def crc16(data: bytes, seed: int = SEED_FOREVER) -> int:
    """CRC of ``data``; ``crc16(b"123456789") == 0x29B1``."""
    return crc_hqx(data, seed)
