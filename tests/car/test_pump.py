"""The thread of a real link: any exception of a program's callback gives neutral first, then a
report."""

from __future__ import annotations

import asyncio
import threading
import time
from types import SimpleNamespace

import pytest

from dart_hal.car import pump as pumps
from dart_hal.car.pump import MAX_READ_TIME, ThreadPump
from dart_hal.car.reconnect import FoundBoard
from dart_hal.core.errors import LinkLost
from dart_hal.devices.links.serial_port import SerialLink

RAISED = [ZeroDivisionError("listener"), SystemExit(3), KeyboardInterrupt(), GeneratorExit(),
          asyncio.CancelledError(), MemoryError(), RecursionError(), StopIteration()]


class Engine:
    """Steps until ``raised`` is set, and counts what the pins are written."""

    def __init__(self, again=None):
        self.lock = threading.RLock()
        self.now = 0.0
        self.raised = None
        self.again = again
        self.lost = self.frames = 0
        self.driver = SimpleNamespace(frame=self._frame)
        self.receiver = SimpleNamespace(counters=SimpleNamespace(ok=0))
        self.backend = SimpleNamespace(url=SimpleNamespace(text="test://"))

    def refuse_in_listener(self):
        pass

    def step(self, timeout):
        if self.raised is not None:
            raise self.raised
        time.sleep(0.001)
        return []

    def hold_neutral(self):
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
        frames = engine.frames
        end = time.monotonic() + 5.0
        while engine.frames < frames + 2 and time.monotonic() < end:
            time.sleep(0.01)
        assert engine.frames >= frames + 2, "neutral is repeated"
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
                self._engine.step(MAX_READ_TIME)
        except Exception as error:  # noqa: BLE001
            self._hold(error, None)
        except SystemExit:
            return


@pytest.mark.slow
def test_a_thread_that_ends_unnoticed_is_detected():
    """Control: the pins are not written any more, and the loop waits."""
    engine = Engine()
    pump = NarrowPump(engine)
    engine.raised = SystemExit(3)
    with pytest.raises(LinkLost):
        pump.next(0.2)
    assert (engine.lost, engine.frames) == (0, 0)
    assert not pump._thread.is_alive()


class Batches(Engine):
    """Steps that bring these States, then none."""

    def __init__(self, *batches):
        super().__init__()
        self.batches = list(batches)
        self.taken = threading.Event()

    def step(self, timeout):
        if self.batches:
            return self.batches.pop(0)
        self.taken.set()
        return super().step(timeout)


def test_next_is_the_newest_state_and_counts_those_that_were_skipped():
    engine = Batches(["first"])
    pump = ThreadPump(engine)
    try:
        assert pump.next(10.0) == ("first", 0)
        engine.taken.clear()
        engine.batches += [["second"], ["third", "fourth"]]
        while engine.batches:
            time.sleep(0.001)
        engine.taken.clear()
        assert engine.taken.wait(10.0), "the last of them is delivered"
        assert pump.next(10.0) == ("fourth", 2)
        with pytest.raises(LinkLost, match="no frame"):
            pump.next(0.01)
    finally:
        pump.stop()


class PumpPort(SerialLink):
    """A port that can only be closed."""

    def __init__(self, engine=None):
        self.engine = engine
        self.closed = False

    @property
    def baud(self):
        return 115_200

    def close(self):
        self.closed = True
        self.neutral_before = self.engine.lost == 1 if self.engine is not None else None


@pytest.mark.slow_except("True")
@pytest.mark.parametrize("known", [True, False])
def test_a_lost_board_is_looked_for_by_its_number(monkeypatch, known):
    """One that never sent HELLO has no number: neutral is repeated, and nothing is opened."""
    engine = Engine()
    lost = PumpPort(engine)
    back = FoundBoard(PumpPort(), b"HELLO")
    searches: list[tuple[int, int]] = []
    resumed = threading.Event()

    class Search:
        def __init__(self, backend, board_id, baud):
            assert lost.closed, "the name of the port is free"
            searches.append((board_id, baud))

        def look(self, now):
            return back

        def close(self):
            pass

    engine.backend.link = lost
    engine.receiver.hello = SimpleNamespace(board_id=77) if known else None
    engine.raised = LinkLost("the port vanished")

    def resume(link, data):
        assert (link, data) == back
        engine.raised = None
        resumed.set()
        return ["state"]

    engine.resume = resume
    monkeypatch.setattr(pumps, "BoardSearch", Search)
    pump = ThreadPump(engine)
    try:
        with pytest.raises(LinkLost, match="vanished"):
            pump.next(10.0)
        assert resumed.wait(10.0 if known else 0.2) == known
        assert lost.neutral_before, "the close of a port that vanished may wait"
        assert searches == ([(77, 115_200)] if known else [])
        if known:
            assert pump.next(10.0) == ("state", 0)
    finally:
        pump.stop()
