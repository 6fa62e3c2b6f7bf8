"""SIGTERM ends a program like Ctrl-C does: through its ``with`` blocks, to neutral."""

from __future__ import annotations

import signal
import sys
import threading
from types import FrameType


def stop_on_sigterm() -> None:
    """Turn SIGTERM into SystemExit, unless the program has a handler of its own."""
    if threading.current_thread() is not threading.main_thread():
        return
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, _leave)


def _leave(number: int, frame: FrameType | None) -> None:
    sys.exit(128 + number)
