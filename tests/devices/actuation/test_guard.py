"""The guard: its decisions in virtual time, and real processes that are killed.

The real ones assert what is written and in which order, never how fast.
"""

from __future__ import annotations

import errno
import os
import queue
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from unittest.mock import Mock

import pytest

from dart_hal.core.errors import BusError
from dart_hal.core.process.waiting import wait_readable
from dart_hal.devices.actuation.guard import (
    ALL_OFF,
    BEAT_TIMEOUT,
    MAX_RETRY_TIME,
    GuardLogic,
    watch,
)
from dart_hal.devices.actuation.guarded import Guard
from dart_hal.devices.actuation.owner import lock_chip
from dart_hal.devices.actuation.pca9685 import FINAL_WRITES, NEUTRAL_FRAMES
from dart_hal.devices.links.i2c import REQUEST, open_bus, receive

NEUTRAL = bytes([0x0A, 0, 0, 307 & 0xFF, 307 >> 8])
PATIENCE = 20.0


def test_silence_counts_from_the_first_beat_and_trips_after_100_ms() -> None:
    watch = GuardLogic()
    assert not watch.due(5.0)
    watch.note_bytes(b"b", 5.0)
    assert not watch.due(5.099)
    assert watch.due(5.101)
    watch.note_bytes(b"b", 5.102)
    assert watch.due(5.102), "a beat does not undo a trip"
    watch.note_bytes(b"a", 5.110)
    assert not watch.due(5.2)
    assert watch.due(5.22)


def test_an_orderly_end_writes_nothing() -> None:
    watch = GuardLogic()
    watch.note_bytes(b"bq", 1.0)
    watch.note_bytes(b"", 1.001)
    assert not watch.due(2.0)
    assert watch.done


def test_end_of_file_trips_at_once_and_ends_after_a_second_of_good_writes() -> None:
    watch = GuardLogic()
    watch.note_bytes(b"b", 1.0)
    watch.note_bytes(b"", 1.001)
    for k in range(FINAL_WRITES):
        assert watch.due(1.001 + 0.02 * k)
        watch.note_write(False)                                    # failed writes do not count
        watch.note_write(True)
    assert watch.done


def test_pulses_that_the_driver_has_ended_stay_off() -> None:
    """Its neutral drove the car; the guard's would do so again."""
    watch = GuardLogic()
    watch.note_bytes(b"bbo", 5.0)
    watch.note_bytes(b"", 5.01)
    assert watch.due(5.01)
    assert watch.switches_off
    watch = GuardLogic()
    watch.note_bytes(b"ob", 5.0)
    watch.note_bytes(b"", 5.01)
    assert not watch.switches_off, "neutral first: the pulses had come back"


def test_pulses_end_after_ten_frames_of_neutral_that_reached_the_chip() -> None:
    watch = GuardLogic()
    watch.note_bytes(b"b", 5.0)
    watch.note_bytes(b"", 5.01)
    for _ in range(NEUTRAL_FRAMES):
        assert not watch.switches_off
        watch.note_write(False)
        watch.note_write(True)
    assert watch.switches_off


@pytest.mark.parametrize(("answer", "starts"), [(b"r", True), (b"rb", True), (b"b", False)])
def test_a_guard_is_ready_by_its_first_byte_alone(answer: bytes, starts: bool) -> None:
    """Its first beat may come before the driver looks."""
    guard = object.__new__(Guard)
    guard._clock, guard.tripped = (lambda: 7.0), False
    guard._process = Mock(communicate=lambda timeout: (b"", b""))
    guard._status, status = os.pipe()
    os.set_blocking(guard._status, False)
    os.write(status, answer)
    if starts:
        guard._wait_ready()
        assert guard._heard == 7.0
    else:
        with pytest.raises(BusError, match="does not start") as caught:
            guard._wait_ready()
        assert caught.value.found == "no answer"
    assert guard._process.kill.called != starts
    os.close(guard._status)
    os.close(status)


def test_a_suspend_trips_although_beats_come_again() -> None:
    watch = GuardLogic()
    watch.note_suspend()
    assert not watch.due(5.0), "no program drives yet"
    watch.note_bytes(b"b", 5.0)
    watch.note_bytes(b"b", 8.0)                                    # the first beat after it
    assert not watch.due(8.0)
    watch.note_suspend()
    assert watch.due(8.0)
    watch.note_bytes(b"a", 8.1)
    assert not watch.due(8.1)


def test_a_bus_that_never_comes_back_is_given_up_in_the_end() -> None:
    watch = GuardLogic()
    watch.note_bytes(b"", 1.0)
    assert watch.due(30.9)
    watch.note_write(False)
    assert not watch.due(31.1)
    assert watch.done


class Bench:
    """An I2C bus on a socket that notes every write to 0x40."""

    def __init__(self, path: Path) -> None:
        self.spec, self.writes = f"unix:{path}", queue.Queue[bytes]()
        self.dead, self.refused = False, 0
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
                    _, n_written, n_read = REQUEST.unpack(receive(client, REQUEST.size))
                    data = receive(client, n_written)
                    if self.dead:
                        self.refused += 1
                        client.sendall(bytes([errno.ETIMEDOUT]))
                        continue
                    if not n_read:
                        self.writes.put(data)
                    client.sendall(b"\0" + bytes(n_read))
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
import multiprocessing, os, sys, time
from dart_hal.devices.actuation.guarded import Guard
from dart_hal.core.process import forks
from dart_hal.devices.links.i2c import open_bus
spec, guarded = sys.argv[1], sys.argv[2] == "guarded"
bus = open_bus(spec)
guard = Guard(spec, open_bus, address=0x40, channel=1, neutral_counts=307) if guarded else None
workers = []
if len(sys.argv) > 3:
    if sys.argv[3] == "keeps":
        forks._private.clear()
    fork = multiprocessing.get_context("fork")
    workers = [fork.Process(target=time.sleep, args=(60,)) for _ in range(2)]
    for worker in workers:
        worker.start()
print(guard.pid if guard else 0, *(worker.pid for worker in workers), flush=True)
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


def start(bench: Bench, *kind: str) -> subprocess.Popen[str]:
    driver = subprocess.Popen([sys.executable, "-c", DRIVER, bench.spec, *kind], text=True,
                              stdout=subprocess.PIPE)
    while bench.writes.get(timeout=PATIENCE) == NEUTRAL:
        pass
    return driver


def wait_for_neutral(bench: Bench) -> None:
    while bench.writes.get(timeout=PATIENCE) != NEUTRAL:
        pass


@pytest.mark.realtime
def test_a_killed_driver_leaves_neutral_and_then_no_pulse_on_the_bus(bench: Bench) -> None:
    driver = start(bench, "guarded")
    driver.kill()
    driver.wait()
    wait_for_neutral(bench)
    assert_last_words(bench)


def assert_last_words(bench: Bench) -> None:
    """After the first neutral: some more, then all channels off for the rest of a second."""
    for word in range(1, FINAL_WRITES):
        assert bench.writes.get(timeout=PATIENCE) == (NEUTRAL if word < NEUTRAL_FRAMES else ALL_OFF)


def alive(pid: int) -> bool:
    """Neither gone nor a zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


@pytest.mark.parametrize("workers", ["let go", "keeps"])
@pytest.mark.slow_except("keeps")
@pytest.mark.realtime
def test_workers_of_a_killed_driver_do_not_hide_its_death(bench: Bench, workers: str) -> None:
    """Two forked workers live on. In the second case they even keep the guard's pipe open."""
    driver = start(bench, "guarded", workers)
    assert driver.stdout is not None
    guard, *pids = map(int, driver.stdout.readline().split())
    driver.kill()
    driver.wait()
    driver.stdout.close()
    wait_for_neutral(bench)
    assert_last_words(bench)
    deadline = time.monotonic() + PATIENCE
    while alive(guard) and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not alive(guard), "the guard ends while the workers live"
    assert len(pids) == 2
    for pid in pids:
        assert alive(pid)
        os.kill(pid, signal.SIGKILL)


@pytest.mark.realtime
def test_a_child_holds_no_pipe_of_the_guard(bench: Bench) -> None:
    """The control is the second line: what the parent has there is a pipe."""
    guard = Guard(bench.spec, open_bus, address=0x40, channel=1, neutral_counts=307)
    assert os.readlink(f"/proc/self/fd/{guard._beats}").startswith("pipe:")
    answer = os.pipe()
    child = os.fork()
    if child == 0:
        found = {os.readlink(f"/proc/self/fd/{fd}") for fd in (guard._beats, guard._status)}
        os.write(answer[1], repr(found).encode())
        os._exit(0)
    os.waitpid(child, 0)
    assert os.read(answer[0], 100) == b"{'/dev/null'}"
    for fd in answer:
        os.close(fd)
    guard.beat()
    assert guard.gate() is None, "the parent's are as they were"
    guard.close()


@pytest.mark.realtime
def test_the_guard_is_of_a_session_of_its_own(bench: Bench) -> None:
    """A closed terminal ends the driver's session and process group."""
    guard = Guard(bench.spec, open_bus, address=0x40, channel=1, neutral_counts=307)
    assert os.getsid(guard.pid) == guard.pid
    assert os.getpgid(guard.pid) == guard.pid
    assert os.getsid(0) != guard.pid
    guard.close()


@pytest.mark.realtime
def test_a_whole_process_group_is_killed_and_the_guard_is_not_of_it(bench: Bench) -> None:
    driver = subprocess.Popen([sys.executable, "-c", DRIVER, bench.spec, "guarded"], text=True,
                              stdout=subprocess.PIPE, start_new_session=True)
    while bench.writes.get(timeout=PATIENCE) == NEUTRAL:
        pass
    os.killpg(driver.pid, signal.SIGKILL)
    driver.communicate()
    wait_for_neutral(bench)


@pytest.mark.slow
def test_of_two_cars_the_other_one_drives_on(tmp_path: Path) -> None:
    benches = [Bench(tmp_path / name) for name in "ab"]
    first, second = (start(bench, "guarded") for bench in benches)
    first.kill()
    first.wait()
    wait_for_neutral(benches[0])
    for _ in range(FINAL_WRITES):                               # as long as the first guard speaks
        assert benches[1].writes.get(timeout=PATIENCE) != NEUTRAL
    second.kill()
    second.wait()
    wait_for_neutral(benches[1])
    for bench, driver in zip(benches, (first, second), strict=True):
        assert driver.stdout is not None
        driver.stdout.close()
        bench.close()


@pytest.mark.slow
@pytest.mark.parametrize("owned", [True, False])
def test_a_guard_on_a_dead_bus_writes_nothing_for_the_next_owner(
        bench: Bench, owned: bool) -> None:
    """The next car of this very process. The control: no program owns the chip, and it writes."""
    guard = Guard(bench.spec, open_bus, address=0x40, channel=1, neutral_counts=307)
    guard.beat()
    bench.dead = True
    guard.leave()
    deadline = time.monotonic() + PATIENCE
    while not bench.refused and time.monotonic() < deadline:
        time.sleep(0.01)
    release = lock_chip(bench.spec, 0x40) if owned else None
    time.sleep(0.1)                                           # a write that was under way
    bench.dead = False
    time.sleep(0.3)
    assert bench.writes.empty() == owned
    if release is not None:
        release()
    for word in range(FINAL_WRITES):
        assert bench.writes.get(timeout=PATIENCE) == (NEUTRAL if word < NEUTRAL_FRAMES else ALL_OFF)
    guard._process.wait(PATIENCE)


def test_a_guard_on_a_bus_that_stays_dead_ends() -> None:
    """Half a minute of the guard's own clock after the driver is gone."""

    class Dead:
        tries = 0

        def writeto(self, address: int, data: bytes) -> None:
            self.tries += 1
            raise OSError(errno.ETIMEDOUT, "stuck")

        def writeto_then_readfrom(self, address: int, data: bytes, into: bytearray) -> None:
            raise OSError(errno.ETIMEDOUT, "stuck")

    beats, status, bus, now = os.pipe(), os.pipe(), Dead(), iter(range(10_000))
    os.close(beats[1])
    watch(bus, 0x40, 1, 307, beats=beats[0], status=status[1],  # type: ignore[arg-type]
          clock=lambda: float(next(now)))
    assert 0 < bus.tries <= MAX_RETRY_TIME + 1
    assert next(now) > MAX_RETRY_TIME
    for fd in (beats[0], *status):
        os.close(fd)


@pytest.mark.realtime
def test_without_the_guard_the_last_throttle_stays(bench: Bench) -> None:
    """The negative control: without a guard nothing is written after the kill."""
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
    assert wait_readable(driver.stdout.fileno(), PATIENCE), "the guard does not report its trip"
    assert driver.stdout.readline() == "tripped\n"
    driver.kill()
    driver.wait()
    driver.stdout.close()
    for _ in range(FINAL_WRITES - NEUTRAL_FRAMES):              # until the guard is done, too
        while bench.writes.get(timeout=PATIENCE) != ALL_OFF:
            pass


@pytest.mark.realtime
def test_the_driver_detects_a_dead_guard(bench: Bench) -> None:
    guard = Guard(bench.spec, open_bus, address=0x40, channel=1, neutral_counts=307)
    assert guard.gate() == "GUARD_SILENT", "the guard does not watch before the first beat"
    guard.beat()
    assert guard.gate() is None
    os.kill(guard.pid, signal.SIGKILL)
    os.waitpid(guard.pid, 0)
    assert guard.gate() == "GUARD_SILENT"
    guard.beat()


@pytest.mark.realtime
def test_a_trip_that_is_acknowledged_is_over(bench: Bench) -> None:
    guard = Guard(bench.spec, open_bus, address=0x40, channel=1, neutral_counts=307)
    guard.beat()
    wait_for_neutral(bench)                                   # no second beat came
    until = time.monotonic() + PATIENCE
    while guard.gate() != "GUARD_TRIPPED":
        assert time.monotonic() < until, "the guard does not report its trip"
        time.sleep(0.01)
    until = time.monotonic() + 20.0                           # a busy machine trips it again
    while guard.gate() is not None:
        assert time.monotonic() < until
        guard.acknowledge()
        guard.beat()
        time.sleep(0.01)
    guard.close()


@pytest.mark.realtime
def test_a_guard_that_hangs_does_not_hold_up_the_driver(bench: Bench) -> None:
    """Its pipe takes 64 KiB of beats and no more; the frame step must not wait for it."""
    guard = Guard(bench.spec, open_bus, address=0x40, channel=1, neutral_counts=307)
    os.kill(guard.pid, signal.SIGSTOP)
    try:
        beats = threading.Thread(target=lambda: [guard.beat() for _ in range(70_000)], daemon=True)
        beats.start()
        beats.join(60.0)
        assert not beats.is_alive()
        guard.gate()                                          # reads what it sent before it hung
        time.sleep(2 * BEAT_TIMEOUT)
        assert guard.gate() == "GUARD_SILENT"
    finally:
        os.kill(guard.pid, signal.SIGCONT)
        os.kill(guard.pid, signal.SIGKILL)


@pytest.mark.realtime
def test_a_guard_that_is_closed_writes_nothing(bench: Bench) -> None:
    guard = Guard(bench.spec, open_bus, address=0x40, channel=1, neutral_counts=307)
    guard.beat()
    guard.close()
    assert bench.writes.empty()
    assert guard._process.returncode == 0, "it has ended, and is no zombie"


@pytest.mark.slow
def test_a_guard_without_a_bus_does_not_start(tmp_path: Path) -> None:
    with pytest.raises(BusError, match="does not start") as caught:
        Guard(f"unix:{tmp_path}/none", open_bus, address=0x40, channel=1, neutral_counts=307)
    assert "no simulated I2C bus" in caught.value.found


@pytest.mark.realtime
def test_a_guard_whose_opener_has_no_name_does_not_start(bench: Bench) -> None:
    """The guard is another process: it finds a function by the name of its module."""
    with pytest.raises(BusError, match="does not start"):
        Guard(bench.spec, lambda spec: open_bus(spec), address=0x40, channel=1,
              neutral_counts=307)
