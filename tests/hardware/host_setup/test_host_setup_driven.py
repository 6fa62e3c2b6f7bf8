"""A real driver with its real guard on a served car: both are killed, standby is left."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from dart_hal.core.config import load_car
from dart_hal.devices.actuation.standby import Throttle
from dart_hal.devices.links.i2c import SocketBus

STANDBY_TIMEOUT_S = 60.0
CONTROL_PROGRAM = "def control(state):\n    return 0.0, 0.2\n"


def dart_hal(*arguments: str, **more: object) -> subprocess.Popen[str]:
    return subprocess.Popen([sys.executable, "-m", "dart_hal.cli.main", *arguments], text=True,
                            **more)  # type: ignore[call-overload,no-any-return]


def guards_of(pid: int) -> list[int]:
    """Children of a process: its guard."""
    found = []
    for process in Path("/proc").glob("[0-9]*"):
        try:
            stat = (process / "stat").read_text()
        except OSError:
            continue
        if int(stat.rsplit(")", 1)[1].split()[1]) == pid:
            found.append(int(process.name))
    return found


def until(true: Callable[[], bool], seconds: float = STANDBY_TIMEOUT_S) -> bool:
    end = time.monotonic() + seconds
    while not true() and time.monotonic() < end:
        time.sleep(0.02)
    return true()


@pytest.fixture
def served_car(tmp_path: Path) -> Iterator[dict[str, str]]:
    """A simulated car on a pty and a socket."""
    server = dart_hal("sim", "--url", "sim://?seed=3&nano=mock", "--pty", "--bus",
                      str(tmp_path / "i2c"), "--cars", str(tmp_path), "--json",
                      stdout=subprocess.PIPE, stderr=subprocess.DEVNULL)
    assert server.stdout is not None
    text = ""
    while not text.rstrip().endswith("}"):
        text += server.stdout.readline()
    yield {**json.loads(text), "cars": str(tmp_path)}
    server.terminate()
    server.communicate()


@pytest.mark.long
@pytest.mark.parametrize("standby", [True, False], ids=["standby", "control"])
def test_driver_and_guard_are_killed(served_car: dict[str, str], standby: bool,
                                     tmp_path: Path) -> None:
    car = ["--url", served_car["url"], "--car", served_car["car"], "--cars", served_car["cars"]]
    bus = SocketBus(str(served_car["bus"]))
    throttle = Throttle(load_car(served_car["car"], [served_car["cars"]]), bus, time.sleep)
    script = tmp_path / "straight.py"
    script.write_text(CONTROL_PROGRAM)
    watch = dart_hal("standby", *car) if standby else None
    driver = dart_hal("drive", str(script), *car, "--duration", "60", "--waive",
                      "CALIBRATION_MISSING", "--waive", "PWM_CLOCK_UNCALIBRATED",
                      stderr=subprocess.PIPE)
    try:
        assert until(lambda: not throttle.is_off or driver.poll() is not None)
        assert driver.poll() is None, driver.communicate()[1]
        time.sleep(0.5)
        assert not throttle.is_off, "standby leaves a driven car alone"
        guards = guards_of(driver.pid)
        assert guards
        for pid in (*guards, driver.pid):       # the guard first: it has no last word
            os.kill(pid, signal.SIGKILL)
        driver.wait()
        assert until(lambda: throttle.is_off, 5.0 if standby else 1.0) is standby
    finally:
        for process in (watch, driver):
            if process is not None:
                process.kill()
                process.communicate()
        bus.close()
