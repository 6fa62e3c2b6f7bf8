"""CRC-16 CCITT as the frames use it: polynomial 0x1021, not reflected, no final xor.

The start value is the seed of the message, so a frame of another definition
fails its check. ``binascii`` computes it in C; ``columns`` is the same for
many frames at once.
"""

from __future__ import annotations

from binascii import crc_hqx

import numpy as np
from numpy.typing import NDArray

from dart_hal.wire.messages import SEED_FOREVER


def crc16(data: bytes, seed: int = SEED_FOREVER) -> int:
    """CRC of ``data``; ``crc16(b"123456789") == 0x29B1``."""
    return crc_hqx(data, seed)


def columns(data: NDArray[np.uint8], seed: int) -> NDArray[np.uint16]:
    """CRCs (N,) of N byte strings of equal length, given as columns: data (L, N)."""
    crc = np.full(data.shape[1], seed, np.uint16)
    x, y = np.empty_like(crc), np.empty_like(crc)
    for byte in data:
        # One byte per step by shifts: x ^ (x >> 4) folds the polynomial
        # x^16 + x^12 + x^5 + 1 without a table, which SIMD likes better.
        np.right_shift(crc, 8, out=x)
        np.bitwise_xor(x, byte, out=x)
        np.right_shift(x, 4, out=y)
        np.bitwise_xor(x, y, out=x)
        np.left_shift(crc, 8, out=crc)
        np.bitwise_xor(crc, x, out=crc)
        np.left_shift(x, 5, out=x)
        np.bitwise_xor(crc, x, out=crc)
        np.left_shift(x, 7, out=x)
        np.bitwise_xor(crc, x, out=crc)
    return crc
