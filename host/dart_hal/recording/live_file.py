"""Messages of a car that is not recorded, as a recording would get them."""

from __future__ import annotations

import threading
from pathlib import Path

from dart_hal.recording.run_file import RunFile


class LiveFile(RunFile):
    """Passes messages to ``taps`` and writes no file. Its one car has no prefix."""

    def __init__(self) -> None:
        self.path = Path("live")
        self.lock = threading.RLock()
        self._begin()

    def enter(self, name: str) -> str:
        return ""

    def schema(self, kind: str) -> int:
        return 0

    def attach(self, name: str, kind: str, text: str, ns: int) -> None:
        """Do nothing: a live stream has no attachments."""

    def flush(self) -> None:
        """Do nothing: no data are buffered."""

    def close(self) -> None:
        """Do nothing: no file is open."""

    def _register(self, topic: str, kind: str, zero_ns: int) -> int:
        return len(self.channels) + 1

    def _write(self, channel: int, ns: int, rest: int, data: bytes) -> None:
        """Do nothing: no file is written."""
