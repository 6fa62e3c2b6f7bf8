"""A file that grows by whole pieces: what a full disk does not take is not there in half."""

from __future__ import annotations

import os
from contextlib import suppress
from pathlib import Path

from dart_hal.core.process.forks import private


class PieceWriter:
    """A stream as ``mcap.writer`` wants one: what is written is held until ``flush``.

    A flush is one piece. The first that fails is cut off again, and nothing is
    written any more: ``trouble`` says why. Raises OSError only where it is made.
    """

    def __init__(self, path: Path) -> None:
        self._file = private(path.open("wb", buffering=0))
        self._held = bytearray()
        self._end = 0
        self.trouble: OSError | None = None

    def write(self, data: bytes) -> int:
        self._held += data
        return len(data)

    def tell(self) -> int:
        return self._end + len(self._held)

    def flush(self) -> None:
        piece, self._held = self._held, bytearray()
        if self.trouble is not None:
            return
        try:
            rest = memoryview(piece)
            while rest:
                rest = rest[self._file.write(rest):]
        except OSError as why:
            self.trouble = why
            with suppress(OSError):  # a device has no end to be moved
                os.ftruncate(self._file.fileno(), self._end)
            return
        self._end += len(piece)

    def close(self) -> None:
        """What is held is written; idempotent."""
        if not self._file.closed:
            self.flush()
            self._file.close()
