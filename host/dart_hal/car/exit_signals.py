"""Stop the cars when the program ends: by Ctrl-C, SIGTERM, SIGHUP or an uncaught exception.

An exception ends the ``with`` blocks of the main thread alone. Python then waits for its other
threads, and so does asyncio: a thread that drives would drive on. So the cars are stopped first,
and later commands raise Disarmed, which ends that thread.
"""

from __future__ import annotations

import contextlib
import signal
import sys
import threading
from collections.abc import Callable
from types import FrameType, TracebackType

# Windows has no SIGHUP.
STOPPING_SIGNALS = ("SIGTERM", "SIGHUP")

_stops: set[Callable[[str], None]] = set()
# What reported uncaught exceptions before; None while this module does not.
_next_hook: Callable[..., object] | None = None


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
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _interrupt)


def stop_at_end(stop: Callable[[str], None]) -> None:
    """Call ``stop`` with the reason when the program ends, until ``forget_stop``."""
    global _next_hook
    _stops.add(stop)
    if _next_hook is None:  # once: a hook that the program adds later may call this one
        _next_hook = sys.excepthook
        sys.excepthook = _stop_and_report


def forget_stop(stop: Callable[[str], None]) -> None:
    """Remove a function that was added."""
    _stops.discard(stop)


def _stop_and_report(kind: type[BaseException], error: BaseException,
                     trace: TracebackType | None) -> None:
    """Stop the cars after an uncaught exception of the main thread, then report it."""
    try:
        _stop_cars(f"the program ended by {kind.__name__}")
    finally:
        (_next_hook or sys.__excepthook__)(kind, error, trace)


def _stop_cars(reason: str) -> None:
    with contextlib.ExitStack() as stack:  # each is stopped, also if another one raises
        for stop in tuple(_stops):
            stack.callback(stop, reason)


def _stop_cars_soon(reason: str) -> None:
    """Stop the cars in a thread: the signal may have interrupted a write to the pins."""
    with contextlib.suppress(RuntimeError):  # no thread can start at the end of the interpreter
        if _stops:
            threading.Thread(target=_stop_cars, args=(reason,), name="dart-hal stop").start()


def _exit(number: int, frame: FrameType | None) -> None:
    _stop_cars_soon(f"the program was ended by {signal.Signals(number).name}")
    sys.exit(128 + number)


def _interrupt(number: int, frame: FrameType | None) -> None:
    _stop_cars_soon("Ctrl-C was pressed")
    signal.default_int_handler(number, frame)
