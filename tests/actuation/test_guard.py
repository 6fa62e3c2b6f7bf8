"""The guard: its decisions in virtual time, and real processes that are killed.

The real ones assert what is written and in which order, never how fast.
"""

from __future__ import annotations

import os
import queue
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import pytest

from dart_hal.actuation.guard import LAST_WORDS, Watch
from dart_hal.actuation.guarded import Guard
from dart_hal.errors import BusError
from dart_hal.links.i2c import REQUEST, receive

NEUTRAL = bytes([0x0A, 0, 0, 307 & 0xFF, 307 >> 8])
PATIENCE = 20.0


def test_silence_counts_from_the_first_beat_and_trips_after_100_ms() -> None:
    watch = Watch()
    assert not watch.due(5.0)
    watch.heard(b"b", 5.0)
    assert not watch.due(5.099)
    assert watch.due(5.101)
    watch.heard(b"b", 5.102)
    assert watch.due(5.102), "a beat does not undo a trip"
    watch.heard(b"a", 5.110)
    assert not watch.due(5.2)
    assert watch.due(5.22)


def test_an_orderly_end_writes_nothing() -> None:
    watch = Watch()
    watch.heard(b"bq", 1.0)
    watch.heard(b"", 1.001)
    assert not watch.due(2.0)
    assert watch.done


def test_end_of_file_trips_at_once_and_ends_after_a_second_of_good_writes() -> None:
    watch = Watch()
    watch.heard(b"b", 1.0)
    watch.heard(b"", 1.001)
    for k in range(LAST_WORDS):
        assert watch.due(1.001 + 0.02 * k)
        watch.wrote(False, 1.001 + 0.02 * k)                  # failed writes do not count
        watch.wrote(True, 1.001 + 0.02 * k)
    assert watch.done


def test_a_bus_that_never_comes_back_is_given_up_in_the_end() -> None:
    watch = Watch()
    watch.heard(b"", 1.0)
    watch.wrote(False, 30.0)
    assert not watch.done
    watch.wrote(False, 31.1)
    assert watch.done


class Bench:
    """An I2C bus on a socket that notes every write to 0x40."""

    def __init__(self, path: Path) -> None:
        self.spec, self.writes = f"unix:{path}", queue.Queue[bytes]()
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.bind(os.fspath(path))
        self._socket.listen()
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        while True:
            try:
                client, _ = self._socket.accept()
            except OSError:
                return
            threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        with client:
            try:
                while True:
                    _, wrote, wanted = REQUEST.unpack(receive(client, REQUEST.size))
                    data = receive(client, wrote)
                    if not wanted:
                        self.writes.put(data)
                    client.sendall(b"\0" + bytes(wanted))
            except OSError:
                return

    def close(self) -> None:
        self._socket.close()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    made = Bench(tmp_path / "i2c")
    yield made
    made.close()


DRIVER = """
import sys, time
from dart_hal.actuation.guarded import Guard
from dart_hal.links.i2c import open_bus
spec, guarded = sys.argv[1], sys.argv[2] == "guarded"
bus = open_bus(spec)
guard = Guard(spec, address=0x40, channel=1, neutral_counts=307) if guarded else None
print(guard.pid if guard else 0, flush=True)
while True:
    if guard is None or guard.gate() is None:
        bus.writeto(0x40, bytes([0x0A, 0, 0, 0x52, 0x01]))
    elif guard.tripped:
        print("tripped", flush=True)
        guard.acknowledge()
    if guard:
        guard.beat()
    time.sleep(0.02)
"""


def start(bench: Bench, kind: str) -> subprocess.Popen[str]:
    driver = subprocess.Popen([sys.executable, "-c", DRIVER, bench.spec, kind], text=True,
                              stdout=subprocess.PIPE)
    while bench.writes.get(timeout=PATIENCE) == NEUTRAL:
        pass
    return driver


def wait_for_neutral(bench: Bench) -> None:
    while bench.writes.get(timeout=PATIENCE) != NEUTRAL:
        pass


def test_a_killed_driver_leaves_neutral_on_the_bus(bench: Bench) -> None:
    driver = start(bench, "guarded")
    driver.kill()
    driver.wait()
    wait_for_neutral(bench)
    for _ in range(LAST_WORDS - 1):
        assert bench.writes.get(timeout=PATIENCE) == NEUTRAL


def test_without_the_guard_the_last_throttle_stays(bench: Bench) -> None:
    """The negative control: nobody writes after the kill."""
    driver = start(bench, "alone")
    driver.kill()
    driver.wait()
    threading.Event().wait(0.5)
    while not bench.writes.empty():
        assert bench.writes.get() != NEUTRAL


def test_a_stopped_driver_gets_neutral_and_writes_no_stale_throttle_when_it_goes_on(
        bench: Bench) -> None:
    driver = start(bench, "guarded")
    assert driver.stdout is not None
    driver.stdout.readline()
    os.kill(driver.pid, signal.SIGSTOP)
    wait_for_neutral(bench)
    os.kill(driver.pid, signal.SIGCONT)
    assert driver.stdout.readline() == "tripped\n"
    driver.kill()
    driver.wait()
    driver.stdout.close()
    for _ in range(LAST_WORDS):                               # until the guard is done, too
        wait_for_neutral(bench)


def test_a_dead_guard_is_seen_by_the_driver(bench: Bench) -> None:
    guard = Guard(bench.spec, address=0x40, channel=1, neutral_counts=307)
    assert guard.gate() == "GUARD_SILENT", "nobody watches before the first beat"
    guard.beat()
    assert guard.gate() is None
    os.kill(guard.pid, signal.SIGKILL)
    os.waitpid(guard.pid, 0)
    assert guard.gate() == "GUARD_SILENT"
    guard.beat()


def test_a_guard_that_is_closed_writes_nothing(bench: Bench) -> None:
    guard = Guard(bench.spec, address=0x40, channel=1, neutral_counts=307)
    guard.beat()
    guard.close()
    assert bench.writes.empty()


def test_a_guard_without_a_bus_does_not_start(tmp_path: Path) -> None:
    with pytest.raises(BusError, match="does not start") as caught:
        Guard(f"unix:{tmp_path}/none", address=0x40, channel=1, neutral_counts=307)
    assert "no simulated I2C bus" in caught.value.found
