"""Limit of the expansion of compressed input.

A few kilobytes of zeros expand to gigabytes. So every compressed input is read up to a limit that
follows from its length, and is refused above it.
"""

from __future__ import annotations

import gzip
import io
from typing import IO

import lz4.frame
import zstandard

from dart_hal.core.errors import RecordingError

# Expanded bytes per compressed byte. Recordings reach 3 to 10 (text of numbers, bytes of the
# Nano), a log that repeats one row about 40; an attack has 1000 and more.
MAX_RATIO = 50
# Bytes that any input may expand to: a short file of equal rows has a high ratio too.
ALWAYS_ALLOWED = 1 << 24


class ExpandsTooFar(ValueError):
    """A compressed input whose content is larger than its length allows."""

    def __init__(self, packed: int, limit: int) -> None:
        super().__init__(f"{packed} bytes expand to more than {limit} bytes")


def refusal(path: str, found: str) -> RecordingError:
    """Return the error for a recording that expands too far."""
    return RecordingError(f"{path}: the file expands too far", found=found, read=path,
                          expected=f"at most {MAX_RATIO} bytes for each byte of the file",
                          likely="a file that was made to fill the memory, or a damaged one",
                          remedy="copy the file again; a .csv.gz that you trust: gunzip it")


def expansion_limit(packed: int) -> int:
    """Return the bytes that an input of ``packed`` bytes may expand to."""
    return max(ALWAYS_ALLOWED, MAX_RATIO * packed)


def expand_gzip(packed: bytes, limit: int | None = None) -> bytes:
    """Expand a gzip file; limit [bytes] of its content, None: ``expansion_limit``.

    Raises ExpandsTooFar, EOFError, gzip.BadGzipFile, zlib.error.
    """
    limit = expansion_limit(len(packed)) if limit is None else limit
    with gzip.GzipFile(fileobj=io.BytesIO(packed)) as stream:
        data = stream.read(limit + 1)
    if len(data) > limit:
        raise ExpandsTooFar(len(packed), limit)
    return data


def expand_chunk(compression: str, packed: bytes, size: int, limit: int) -> bytes:
    """Expand a chunk of an MCAP file, which states ``size`` bytes; limit [bytes].

    Raises ExpandsTooFar, ValueError for another compression, and the errors of the decompressors.
    """
    if not compression:
        return packed
    if size > limit:
        raise ExpandsTooFar(len(packed), limit)
    if compression == "zstd":
        with zstandard.ZstdDecompressor().stream_reader(packed) as stream:
            return stream.read(size)
    if compression == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(packed, max_length=size))
    raise ValueError(f"compression {compression!r}")


class LimitedStream(io.RawIOBase):
    """A stream that expands ``packed`` bytes, read in pieces. ``read`` raises ExpandsTooFar."""

    def __init__(self, stream: IO[bytes], packed: int) -> None:
        super().__init__()
        self._stream = stream
        self._packed = packed
        self._rest = expansion_limit(packed)

    def readable(self) -> bool:
        return True

    def read(self, size: int = -1) -> bytes:
        requested = self._rest + 1 if size is None or size < 0 else min(size, self._rest + 1)
        data = self._stream.read(requested)
        self._rest -= len(data)
        if self._rest < 0:
            raise ExpandsTooFar(self._packed, expansion_limit(self._packed))
        return data
