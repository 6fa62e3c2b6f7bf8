"""The thread of a real link: whatever a program's callback raises, neutral first, then told."""

from __future__ import annotations

import asyncio
import threading
import time
from types import SimpleNamespace

import pytest

from dart_hal.car.pump import SLICE, ThreadPump
from dart_hal.errors import LinkLost

RAISED = [ZeroDivisionError("listener"), SystemExit(3), KeyboardInterrupt(), GeneratorExit(),
          asyncio.CancelledError(), MemoryError(), RecursionError(), StopIteration()]


class Engine:
    """Steps until ``raised`` is set, and counts what the pins are written."""

    def __init__(self, again=None):
        self.lock = threading.RLock()
        self.now, self.raised, self.again = 0.0, None, again
        self.lost = self.frames = 0
        self.driver = SimpleNamespace(lost=self._lost, frame=self._frame)
        self.receiver = SimpleNamespace(counters=SimpleNamespace(ok=0))
        self.backend = SimpleNamespace(url=SimpleNamespace(text="test://"))

    def step(self, timeout):
        if self.raised is not None:
            raise self.raised
        time.sleep(0.001)
        return []

    def _lost(self, now):
        self.lost += 1
        if self.again is not None:
            raise self.again

    def _frame(self, now):
        self.frames += 1
        if self.again is not None:
            raise self.again


@pytest.mark.parametrize("again", [None, SystemExit(1)], ids=["once", "hooks raise again"])
@pytest.mark.parametrize("raised", RAISED, ids=lambda error: type(error).__name__)
def test_what_a_callback_raises_is_raised_by_next_at_neutral(raised, again):
    engine = Engine(again)
    pump = ThreadPump(engine)
    try:
        engine.raised = raised
        begin = time.monotonic()
        with pytest.raises(type(raised)):
            pump.next(10.0)
        assert time.monotonic() - begin < 5.0
        assert engine.lost == 1
        seen = engine.frames
        end = time.monotonic() + 5.0
        while engine.frames < seen + 2 and time.monotonic() < end:
            time.sleep(0.01)
        assert engine.frames >= seen + 2, "neutral is repeated"
        assert pump._thread.is_alive()
        with pytest.raises(type(raised)):
            pump.next(10.0)
    finally:
        pump.stop()
    assert not pump._thread.is_alive()


class NarrowPump(ThreadPump):
    """Holds for an Exception alone."""

    def _run(self):
        try:
            while not self._ended.is_set():
                self._engine.step(SLICE)
        except Exception as error:  # noqa: BLE001
            self._hold(error, None)
        except SystemExit:
            return


def test_a_thread_that_ends_unnoticed_is_seen():
    """Control: the pins are not written any more, and the loop waits."""
    engine = Engine()
    pump = NarrowPump(engine)
    engine.raised = SystemExit(3)
    with pytest.raises(LinkLost):
        pump.next(0.2)
    assert (engine.lost, engine.frames) == (0, 0)
    assert not pump._thread.is_alive()
