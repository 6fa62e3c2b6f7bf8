"""Text files that a user gives: UTF-8 or UTF-16, with or without a byte order mark.

Editors and spreadsheets mark the encoding of a file by its first bytes. All text inputs
(TOML, YAML, CSV of paths, poses and recordings) are read by the functions of this module.
"""

from __future__ import annotations

import codecs
import errno
import io
from pathlib import Path

# First bytes and the codec that removes them. UTF-32 precedes UTF-16: its mark is longer.
BYTE_ORDER_MARKS = ((codecs.BOM_UTF8, "utf-8-sig"), (codecs.BOM_UTF32_LE, "utf-32"),
                    (codecs.BOM_UTF32_BE, "utf-32"), (codecs.BOM_UTF16_LE, "utf-16"),
                    (codecs.BOM_UTF16_BE, "utf-16"))
# Largest text file [B]: twice the size of a million rows of poses.
MAX_TEXT_BYTES = 1 << 28
# Fraction of byte pairs with one zero byte, above which a text is mostly ASCII in UTF-16.
MIN_ASCII_PAIRS = 0.9


def decode_text(raw: bytes) -> str:
    """Decode bytes of a text file; line ends become ``\\n``.

    1. A byte order mark determines the encoding.
    2. Without one, a zero byte in nearly each pair of bytes means UTF-16.
    3. Everything else is UTF-8.

    Raises UnicodeDecodeError (a ValueError). Example::

        decode_text("x,y\\n1,2\\n".encode("utf-16"))  # "x,y\\n1,2\\n"
    """
    text = raw.decode(detect_encoding(raw))
    return io.IncrementalNewlineDecoder(None, translate=True).decode(text, final=True)


def detect_encoding(raw: bytes) -> str:
    """Return the codec of a text file, as ``decode_text`` chooses it."""
    for mark, codec in BYTE_ORDER_MARKS:
        if raw.startswith(mark):
            return codec
    sample = raw[:4096]
    pairs = len(sample) // 2
    for codec, zero, letter in (("utf-16-le", 1, 0), ("utf-16-be", 0, 1)):
        ascii_pairs = sum(not sample[i + zero] and sample[i + letter] != 0
                          for i in range(0, 2 * pairs, 2))
        if pairs and ascii_pairs > MIN_ASCII_PAIRS * pairs:
            return codec
    return "utf-8"


def read_text(path: Path) -> str:
    """Read a text file. Raises OSError, also for a device or a longer file, and
    UnicodeDecodeError."""
    if path.is_char_device() or path.is_block_device():
        raise OSError(errno.EINVAL, "a device, not a file", str(path))
    with path.open("rb") as file:
        raw = file.read(MAX_TEXT_BYTES + 1)
    if len(raw) > MAX_TEXT_BYTES:
        raise OSError(errno.EFBIG, f"longer than {MAX_TEXT_BYTES >> 20} MB", str(path))
    return decode_text(raw)
