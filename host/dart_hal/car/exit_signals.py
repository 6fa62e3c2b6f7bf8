"""SIGTERM and SIGHUP end a program as Ctrl-C does: through its ``with`` blocks, to neutral."""

from __future__ import annotations

import signal
import sys
import threading
from types import FrameType

# Windows has no SIGHUP.
STOPPING_SIGNALS = ("SIGTERM", "SIGHUP")


def stop_on_signals() -> None:
    """Turn SIGTERM and SIGHUP (a closed terminal) into SystemExit.

    A handler that the program has installed itself is kept.
    """
    if threading.current_thread() is not threading.main_thread():
        return
    for number in signal.Signals:
        if (number.name in STOPPING_SIGNALS
                and signal.getsignal(number) is signal.SIG_DFL):
            signal.signal(number, _exit)


def _exit(number: int, frame: FrameType | None) -> None:
    sys.exit(128 + number)
