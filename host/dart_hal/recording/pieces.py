"""A file that grows by complete pieces: a full disk leaves no partial piece."""

from __future__ import annotations

import errno
import os
from contextlib import suppress
from pathlib import Path

from dart_hal.core.process.forks import private


class PieceWriter:
    """A stream for ``mcap.writer`` that buffers all data until ``flush``.

    A flush writes one piece. If it fails, or the file has been deleted, the piece is cut off again
    and no more data are written; ``trouble`` is the reason. Only the constructor raises OSError.
    """

    def __init__(self, path: Path) -> None:
        # A recording is never overwritten, also by a program that starts at the same time.
        mode = "wb" if path.exists() and not path.is_file() else "xb"
        self._file = private(path.open(mode, buffering=0))
        # Some file systems always count 0 names.
        self._names = min(1, os.fstat(self._file.fileno()).st_nlink)
        self._buffer = bytearray()
        self._end = 0
        self.trouble: OSError | None = None

    def write(self, data: bytes) -> int:
        self._buffer += data
        return len(data)

    def tell(self) -> int:
        return self._end + len(self._buffer)

    def flush(self) -> None:
        piece = self._buffer
        self._buffer = bytearray()
        if self.trouble is not None:
            return
        try:
            # An unbuffered write may take a part of the data only.
            rest = memoryview(piece)
            while rest:
                rest = rest[self._file.write(rest):]
            if os.fstat(self._file.fileno()).st_nlink < self._names:
                raise FileNotFoundError(errno.ENOENT, "the file was deleted while it was written")
        except OSError as why:
            self.trouble = why
            with suppress(OSError):  # a device cannot be truncated
                os.ftruncate(self._file.fileno(), self._end)
            return
        self._end += len(piece)

    def close(self) -> None:
        """Write the buffer and close the file; idempotent."""
        if not self._file.closed:
            self.flush()
            self._file.close()
