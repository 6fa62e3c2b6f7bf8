"""Who stops a car whose driver and guard are dead: `dart-hal standby`, `dart-hal stop`.

Decisions in virtual time, registers on the chip's model, and real processes
that are killed; those assert what is written, never how fast.
"""

from __future__ import annotations

import contextlib
import fcntl
import json
import os
import pty
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from dart_hal.cli import standby
from dart_hal.cli.main import main
from dart_hal.core.config import load_car
from dart_hal.core.errors import BusError
from dart_hal.core.process.locks import holder, parse_locks
from dart_hal.core.timing import PWM_FRAME
from dart_hal.devices.actuation.pca9685 import FINAL_WRITES, NEUTRAL_FRAMES
from dart_hal.devices.actuation.standby import Throttle, Watchman, stop
from dart_hal.devices.links.i2c import REQUEST, receive
from dart_hal.devices.links.notify import notify
from dart_lab.sim.bus import VirtualBus
from dart_lab.sim.pca9685 import Pca9685Model as Chip

CARS = Path(__file__).parents[3] / "cars"
OFF_COUNT = 0x1000
"""OFF_H bit 4: no pulse."""
PATIENCE = 20.0


# -- decisions ---------------------------------------------------------------

def test_a_driver_that_leaves_owes_a_second_neutral_first_and_then_off() -> None:
    watch = Watchman()
    watch.note_driver(4711)
    assert not watch.due(0.0), "nothing while somebody drives"
    watch.note_driver(None)
    written = []
    now = 1.0
    while watch.due(now):
        written.append(watch.switches_off)
        watch.note_write(True, now)
        now += PWM_FRAME
    assert written == [False] * NEUTRAL_FRAMES + [True] * (FINAL_WRITES - NEUTRAL_FRAMES)
    watch.note_driver(None)
    assert not watch.due(now + 1.0), "and then the bus is left alone"


def test_at_the_start_neutral_is_owed_unless_somebody_drives() -> None:
    watch = Watchman()
    watch.note_driver(None)
    assert watch.due(0.0)
    watch.note_driver(4711)
    assert not watch.due(0.1)


def test_a_new_driver_ends_the_writing_at_once_and_a_failed_write_does_not_count() -> None:
    watch = Watchman()
    watch.note_driver(None)
    watch.note_write(False, 0.0)
    assert watch.owed == FINAL_WRITES
    watch.note_driver(12)
    assert watch.owed == 0


# -- registers ---------------------------------------------------------------

class StandbyBench:
    """A chip that somebody left behind, and the throttle of the example car on it."""

    def __init__(self, *, prescale: int = 121, mode1: int = 0x20, counts: int = 338) -> None:
        self.t, self.chip = 0.0, Chip()
        self.bus = VirtualBus(lambda: self.t, [self.chip])
        self.write(0xFE, prescale)
        self.write(0x00, 0x20)
        self.write(0x0A, 0, 0, counts & 0xFF, counts >> 8)
        self.write(0x00, mode1)
        self.throttle = Throttle(load_car("dart-01", [CARS]), self.bus, self.sleep)

    def sleep(self, seconds: float) -> None:
        self.t += seconds

    def write(self, *data: int) -> None:
        self.bus.writeto(0x40, bytes(data))
        self.t += 0.01

    def pulses(self) -> list[float]:
        """us of the throttle's pulses since the last look."""
        self.chip.output.advance(self.t)
        return [(fall - rise) * 1e6 for rise, fall in self.chip.output.take(1)]


def test_rest_writes_neutral_and_steering_is_left_alone() -> None:
    bench = StandbyBench()
    bench.write(0x06, 0, 0, 0x50, 1)
    bench.sleep(0.1)
    assert bench.pulses()[-1] == pytest.approx(338 * 4.88, abs=1)
    assert not bench.throttle.is_off
    assert bench.throttle.rest()
    bench.pulses()
    bench.sleep(0.1)
    assert bench.pulses()[-1] == pytest.approx(1500, abs=5)
    assert not bench.throttle.is_off
    assert bench.throttle._pca.pulse_counts(0) == 0x150
    bench.throttle.switch_off()
    bench.sleep(0.02)                                         # the frame under way
    bench.pulses()
    bench.sleep(0.1)
    assert bench.pulses() == []
    assert bench.throttle.is_off


def test_a_stop_that_is_interrupted_leaves_no_pulse() -> None:
    bench = StandbyBench()
    slept: list[float] = []

    def interrupt(seconds: float) -> None:
        bench.sleep(seconds)
        slept.append(seconds)
        if len(slept) == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        stop(bench.throttle, lambda: None, interrupt)
    assert bench.throttle.is_off


def test_a_service_that_ends_while_it_writes_neutral_leaves_no_pulse() -> None:
    bench = StandbyBench()
    service = standby.StandbyService(bench.throttle)
    service.step(None, 0.0)
    assert not bench.throttle.is_off
    service.close()
    assert bench.throttle.is_off


def test_a_service_that_ends_leaves_the_pulses_of_a_driver_alone() -> None:
    bench = StandbyBench()
    service = standby.StandbyService(bench.throttle)
    service.step(12, 0.0)
    service.close()
    assert not bench.throttle.is_off


def test_channels_that_are_off_stay_off() -> None:
    """A driver had ended the pulses, since its neutral drove the car."""
    bench = StandbyBench()
    bench.throttle.switch_off()
    bench.sleep(0.02)
    bench.pulses()
    assert bench.throttle.rest()
    bench.sleep(0.2)
    assert bench.pulses() == []


@pytest.mark.parametrize("state", [{"prescale": 30}, {"mode1": 0x00}, {"mode1": 0x11}])
def test_a_chip_that_is_not_ours_gets_no_pulse_and_is_not_woken(state: dict[str, int]) -> None:
    bench = StandbyBench(**state)
    before = bytearray(1)
    bench.bus.writeto_then_readfrom(0x40, b"\x00", before)
    assert not bench.throttle.rest()
    bench.sleep(0.1)
    bench.pulses()
    bench.sleep(0.2)
    assert bench.pulses() == []
    after = bytearray(1)
    bench.bus.writeto_then_readfrom(0x40, b"\x00", after)
    assert after[0] == before[0] & 0x70, "as it was, without RESTART and further addresses"
    assert bench.throttle.is_off


def test_a_bus_without_the_chip_is_reported() -> None:
    bus = VirtualBus(lambda: 0.0, [])
    throttle = Throttle(load_car("dart-01", [CARS]), bus, lambda _: None)
    with pytest.raises(BusError, match="0x40"):
        throttle.rest()


def ms_until_neutral(monkeypatch: pytest.MonkeyPatch, delay: float, look_every: float) -> float:
    """ms from the end of driver and guard to the end of the last driving pulse.

    delay [s]: from a look of the service to that end. The service runs its own loop, in virtual
    time.
    """
    bench = StandbyBench()
    died = 0.35 + delay
    pulses: list[tuple[float, float]] = []

    def sleep(seconds: float) -> None:
        bench.sleep(seconds)
        bench.chip.output.advance(bench.t)
        pulses.extend(bench.chip.output.take(1))

    monkeypatch.setattr(standby, "POLL_INTERVAL", look_every)
    monkeypatch.setattr(standby, "open_throttle", lambda *_: (bench.throttle, None))
    monkeypatch.setattr(standby, "stop_on_signals", lambda: None)
    monkeypatch.setattr(standby, "port_of", lambda _: "port")
    monkeypatch.setattr(standby, "holder", lambda _: 4711 if bench.t < died else None)
    monkeypatch.setattr(standby, "notify", lambda _: None)
    monkeypatch.setattr(standby, "time", SimpleNamespace(monotonic=lambda: bench.t, sleep=sleep))
    with pytest.raises(SystemExit) as ended:
        main(["standby", "--url", "serial:///dev/none?i2c=unix:/none", "--duration", "1.2"])
    assert not ended.value.code
    driving = [fall for rise, fall in pulses if fall - rise > 1.51e-3]
    assert driving[-1] > died - 0.02, "it drives until then"
    return 1e3 * (driving[-1] - died)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.0, 0.4, 0.8, 0.9])
def test_the_car_is_at_neutral_within_200_ms_of_the_end_of_driver_and_guard(
        monkeypatch: pytest.MonkeyPatch, share: float) -> None:
    """Both end this share of the interval after a look of the service."""
    interval = standby.POLL_INTERVAL
    assert ms_until_neutral(monkeypatch, share * interval, interval) <= 200.0


@pytest.mark.slow
def test_a_service_that_looks_each_300_ms_is_too_late(monkeypatch: pytest.MonkeyPatch) -> None:
    """The control: both end right after a look."""
    assert ms_until_neutral(monkeypatch, 0.0, 0.3) > 200.0


# -- who drives --------------------------------------------------------------

def test_the_kernels_list_of_locks() -> None:
    text = ("1: POSIX  ADVISORY  WRITE 10 00:05:77 0 EOF\n"
            "2: FLOCK  ADVISORY  WRITE 11 00:06:78 0 EOF\n"
            "2: -> FLOCK  ADVISORY  WRITE 12 00:05:77 0 EOF\n"
            "3: FLOCK  ADVISORY  WRITE 13 00:05:77 0 EOF\n")
    assert parse_locks(text, os.makedev(0, 5), 77) == 13
    assert parse_locks(text, os.makedev(0, 5), 78) is None, "another file system"
    assert parse_locks("", os.makedev(0, 5), 77) is None


def test_a_held_port_is_detected_and_a_missing_one_is_free(tmp_path: Path) -> None:
    port = tmp_path / "port"
    port.touch()
    assert holder(str(port)) is None
    with port.open("w") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        assert holder(str(port)) == os.getpid()
    assert holder(str(port)) is None
    assert holder(str(tmp_path / "none")) is None


# -- systemd -----------------------------------------------------------------

@pytest.mark.parametrize("abstract", [False, True])
def test_words_reach_the_socket_that_the_environment_names(
        abstract: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name = f"@dart-{os.getpid()}" if abstract else str(tmp_path / "notify")
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind("\0" + name[1:] if abstract else name)
        manager.settimeout(PATIENCE)
        monkeypatch.setenv("NOTIFY_SOCKET", name)
        assert notify("READY=1", "STATUS=here")
        assert manager.recv(100) == b"READY=1\nSTATUS=here"


def test_without_a_listener(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    assert not notify("READY=1")
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "gone"))
    assert not notify("READY=1")


# -- real processes ----------------------------------------------------------

class StandbyBoard:
    """Registers of a PCA9685 on a socket; set up as ours."""

    def __init__(self, path: Path) -> None:
        self.spec, self.regs = f"unix:{path}", bytearray(256)
        self.regs[0x00], self.regs[0xFE] = 0x20, 121
        self.regs[0x02:0x06] = bytes([0xE2, 0xE4, 0xE8, 0xE0])
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.bind(os.fspath(path))
        self._socket.listen()
        threading.Thread(target=self._accept, daemon=True).start()

    def _accept(self) -> None:
        with contextlib.suppress(OSError):
            while True:
                client, _ = self._socket.accept()
                threading.Thread(target=self._serve, args=(client,), daemon=True).start()

    def _serve(self, client: socket.socket) -> None:
        with contextlib.suppress(ConnectionError):
            while True:
                _, write, read = REQUEST.unpack(receive(client, REQUEST.size))
                data = receive(client, write)
                if len(data) > 1:
                    self.regs[data[0]:data[0] + len(data) - 1] = data[1:]
                if data[:1] == b"\xfd" and len(data) == 2:       # OFF_H of all channels
                    for register in range(0x09, 0x46, 4):
                        self.regs[register] = data[1]
                client.sendall(b"\0" + bytes(self.regs[data[0]:data[0] + read]))

    @property
    def throttle(self) -> int:
        return self.regs[0x0C] | self.regs[0x0D] << 8

    def drive(self) -> None:
        self.regs[0x0A:0x0E] = bytes([0, 0, 338 & 0xFF, 338 >> 8])


STANDBY_DRIVER = """
import fcntl, signal, sys, time
port = open(sys.argv[1]); fcntl.flock(port, fcntl.LOCK_EX)
if sys.argv[2] == "deaf": signal.signal(signal.SIGTERM, signal.SIG_IGN)
print("drives", flush=True); time.sleep(60)
"""


class StandbyScene:
    """A board, a port (a pty), and drivers that hold it."""

    def __init__(self, folder: Path) -> None:
        self.board = StandbyBoard(folder / "i2c")
        self._pty = pty.openpty()
        self.port = os.ttyname(self._pty[1])
        self.url = f"serial://{self.port}?i2c={self.board.spec}"
        self.processes: list[subprocess.Popen[str]] = []

    def driver(self, kind: str = "plain") -> subprocess.Popen[str]:
        process = subprocess.Popen([sys.executable, "-c", STANDBY_DRIVER, self.port, kind],
                                   stdout=subprocess.PIPE, text=True)
        self.processes.append(process)
        assert process.stdout is not None
        assert process.stdout.readline() == "drives\n"
        return process

    def standby(self, notify_socket: Path) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [sys.executable, "-m", "dart_hal.cli.main", "standby", "--url", self.url, "--cars",
             str(CARS)], env={**os.environ, "NOTIFY_SOCKET": str(notify_socket)}, text=True,
            stderr=subprocess.PIPE)
        self.processes.append(process)
        return process

    def close(self) -> None:
        for process in self.processes:
            process.kill()
            process.communicate()
        for fd in self._pty:
            os.close(fd)


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[StandbyScene]:
    made = StandbyScene(tmp_path)
    yield made
    made.close()


def until(true: object) -> bool:
    end = time.monotonic() + PATIENCE
    while not true() and time.monotonic() < end:  # type: ignore[operator]
        time.sleep(0.01)
    return bool(true())  # type: ignore[operator]


@pytest.mark.realtime
def test_driver_and_guard_are_killed_and_standby_stops_the_car(scene: StandbyScene,
                                                               tmp_path: Path) -> None:
    """The layer that is left; the control is the same second without it."""
    driver = scene.driver()
    scene.board.drive()
    driver.send_signal(signal.SIGKILL)
    driver.wait()
    time.sleep(0.5)
    assert scene.board.throttle == 338, "nothing else stops this car"

    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(PATIENCE)
        driver = scene.driver()
        service = scene.standby(tmp_path / "notify")
        assert manager.recv(200) == b"READY=1"
        assert b"STATUS=pid %d drives" % driver.pid in {manager.recv(200) for _ in range(3)}
        scene.board.drive()
        time.sleep(0.3)
        assert scene.board.throttle == 338, "who drives is left alone"
        driver.send_signal(signal.SIGKILL)
        assert until(lambda: scene.board.throttle & OFF_COUNT)
        assert manager.recv(200) == b"WATCHDOG=1"
        service.send_signal(signal.SIGTERM)
        assert service.wait(PATIENCE) == 128 + signal.SIGTERM


@pytest.mark.realtime
def test_stop_ends_the_driver_and_leaves_no_pulse(scene: StandbyScene,
                                                  capsys: pytest.CaptureFixture[str]
                                                 ) -> None:
    driver = scene.driver()
    scene.board.drive()
    assert run_stop(scene) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["ended"] == driver.pid
    assert result["driver"] is None
    assert result["found_us"] == pytest.approx(1649, abs=5)
    assert (result["left_us"], result["at_rest"]) == (0.0, True)
    assert scene.board.throttle & OFF_COUNT
    assert driver.wait(PATIENCE) == -signal.SIGTERM


@pytest.mark.realtime
def test_stop_names_who_goes_on_driving(scene: StandbyScene,
                                        capsys: pytest.CaptureFixture[str]) -> None:
    driver = scene.driver("deaf")
    assert run_stop(scene) == 1
    captured = capsys.readouterr()
    assert json.loads(captured.out)["driver"] == driver.pid
    assert f"kill -9 {driver.pid}" in captured.err


def run_stop(scene: StandbyScene) -> int:
    with pytest.raises(SystemExit) as left:
        main(["stop", "--url", scene.url, "--cars", str(CARS), "--json"])
    return int(left.value.code or 0)


@pytest.mark.parametrize("name", ["stop", "standby"])
@pytest.mark.parametrize(("url", "message"), [
    ("sim://", "nothing to stop"), ("replay://x", "nothing to stop"), ("nonsense", "not a backend"),
    ("serial:///dev/ttyNONE?i2c=250", "no such bus"), ("serial:///dev/x?i2c=one", "names no bus"),
    ("serial:///dev/x?bus=1", "no option bus"),
])
def test_what_cannot_be_stopped_is_refused(name: str, url: str, message: str,
                                           capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main([name, "--url", url, "--cars", str(CARS)])
    assert left.value.code == 2
    assert message in capsys.readouterr().err
