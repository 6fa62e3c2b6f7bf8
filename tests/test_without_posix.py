"""Windows lacks fcntl, termios and a part of os: what needs none of it works there."""

from __future__ import annotations

import subprocess
import sys
from types import SimpleNamespace

import pytest

from dart_hal.core.errors import PortBusy
from dart_hal.core.process import locks
from dart_hal.core.process.extras import missing_module_error
from dart_hal.devices.links import serial_port
from dart_hal.devices.links.pty import Pty
from dart_hal.devices.links.serial_port import SerialLink
from dart_lab.sim.mock_nano import MockNano
from tests.common import EXCERPT

# Hides what Windows lacks, from this project and from every package below it.
HEAD = """
import concurrent.futures, logging, multiprocessing, os, select, signal, socket, subprocess, sys
import tempfile, time

ABSENT = ("fcntl", "termios", "pty", "tty", "resource", "grp", "pwd")
LACKING = {os: "fork fchmod getuid geteuid killpg openpty register_at_fork sched_getaffinity "
               "set_blocking setsid ttyname O_CLOEXEC O_NOFOLLOW O_NONBLOCK",
           select: "poll epoll", signal: "SIGHUP SIGKILL SIGUSR1 SIGUSR2", socket: "AF_UNIX",
           time: "CLOCK_BOOTTIME clock_gettime clock_gettime_ns"}

class Hide:
    def find_spec(self, name, path=None, target=None):
        if name in ABSENT:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

sys.meta_path.insert(0, Hide())
for name in ABSENT:
    sys.modules.pop(name, None)
for module, names in LACKING.items():
    for name in names.split():
        if hasattr(module, name):
            delattr(module, name)
"""
DRIVE_ON_MOCK = """
from dart_hal import Car, read_run

with Car.open("sim://?nano=mock", record="run.mcap") as car:
    car.arm()
    for state in car.states(duration=2.0):
        car.drive(steering=0.1, throttle=0.3)
assert state.speed > 0.0
assert read_run("run.mcap").duration > 1.0
"""
LEARN = """
import gymnasium

cars = gymnasium.make_vec("dart_lab.sim.gym:DartCar-v0", num_envs=2)
cars.reset(seed=1)
cars.step(cars.action_space.sample())
"""
VERB = """
from dart_hal.cli.main import main

main(sys.argv[1:])
"""


def run_without_posix(program: str, *words: object, cwd) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", HEAD + program, *map(str, words)], cwd=cwd,
                          capture_output=True, text=True, check=False, timeout=300)


@pytest.mark.slow
@pytest.mark.parametrize("program", [DRIVE_ON_MOCK, LEARN], ids=["drive", "learn"])
def test_program_runs_without_posix(program, tmp_path):
    ended = run_without_posix(program, cwd=tmp_path)
    assert ended.returncode == 0, ended.stderr


@pytest.mark.slow
def test_diagnosis_runs_without_posix(tmp_path):
    ended = run_without_posix(VERB, "diagnose", "--train", EXCERPT / "30_step_steering_data",
                              "--only", "steering_lag", "--no-refit", "--html", "report.html",
                              cwd=tmp_path)
    assert ended.returncode == 0, ended.stderr
    assert (tmp_path / "report.html").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("words", [["sim", "--pty"], ["doctor", "--url", "serial:///dev/ttyUSB0"]],
                         ids=["pty", "serial"])
def test_what_needs_posix_is_refused_by_the_catalogue(words, tmp_path):
    """Here pyserial itself needs fcntl; on Windows it has code of its own."""
    ended = run_without_posix(VERB, *words, cwd=tmp_path)
    assert ended.returncode == 2
    assert "which this system lacks" in ended.stderr
    assert "pip install" not in ended.stderr


def test_package_that_can_be_installed_is_named_with_its_command():
    assert "-m pip install" in missing_module_error("websockets", "this").remedy


class WindowsPort:
    """pyserial's port as on Windows: without a descriptor."""

    def __init__(self) -> None:
        self.__dict__["port"] = serial_port.serial.serialposix.Serial()

    def __getattr__(self, name):
        if name == "fd":
            raise AttributeError(name)
        return getattr(self.port, name)

    def __setattr__(self, name, value):
        setattr(self.port, name, value)


def test_port_without_descriptor_is_read_and_written_by_pyserial(monkeypatch):
    with Pty(MockNano(), always=True) as nano:
        monkeypatch.setattr(serial_port.serial, "Serial", WindowsPort)
        link = SerialLink(nano.path)
        first = link.read(2.0)
        assert first is not None
        assert first.data
        link.write(b"\0")
        assert link.dropped == 0
        link.close()


def test_port_that_windows_denies_is_in_use():
    text = "could not open port 'COM3': PermissionError(13, 'Zugriff verweigert', None, 5)"
    error = serial_port._open_error("COM3", serial_port.serial.SerialException(text))
    assert isinstance(error, PortBusy)


def test_port_that_is_no_file_is_a_port_if_it_is_listed(monkeypatch):
    monkeypatch.setattr(serial_port.list_ports, "comports",
                        lambda: [SimpleNamespace(device="COM3")])
    assert serial_port.is_port("COM3")
    assert not serial_port.is_port("COM4")


def test_holder_is_unknown_where_no_table_lists_the_locks(tmp_path):
    path = tmp_path / "lock"
    lock = locks.FileLock(path)
    assert locks.holder(path) is not None
    assert locks.holder(path, locks=tmp_path / "absent") is None
    with pytest.raises(BlockingIOError):
        locks.FileLock(path)
    lock.release()
