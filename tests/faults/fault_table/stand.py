"""Cars for rows with real processes: one served over a pty, or a real one with lifted wheels.

Both report what reached the ESC as (CLOCK_MONOTONIC stamp, width in us): the
served one every pulse of its world, the real one what the registers of its
PCA9685 reported each millisecond, to which a pulse period belongs.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from dart_hal.core.config import load_car
from dart_hal.core.url import Url
from dart_hal.devices.links.i2c import open_bus
from fault_table.row import NEVER

HERE = Path(__file__).parent
RIG_TIMEOUT_S = 60.0
"""s within which a car drives, on a busy machine, too, where a late frame disarms it again."""
RIG_NEUTRAL_US = 1500.0
SLACK_US = 5.0
COUNT_US = 122 / 25.0
FAVOURED = -10
"""Niceness of the car's processes: what else a busy machine does is no fault of theirs."""


def environment() -> dict[str, str]:
    """Ours, and where the suite's processes find the suite."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(
        [str(HERE.parent), *filter(None, [os.environ.get("PYTHONPATH")])]), "PYTHONUNBUFFERED": "1"}


def guard_of(pid: int) -> int | None:
    """The guard process that this driver has started."""
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            parent = int((entry / "stat").read_text().rpartition(")")[2].split()[1])
            words = (entry / "cmdline").read_bytes()
        except (OSError, IndexError):
            continue
        if parent == pid and b"dart_hal.devices.actuation.guard" in words:
            return int(entry.name)
    return None


class DriverProcess:
    """A program that drives; ``fault()`` lets it do what it was started for."""

    def __init__(self, rig: Any, how: str) -> None:
        self.process = subprocess.Popen(
            [sys.executable, str(HERE / "driver.py"), rig.url, rig.name, rig.cars, how],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env=environment(), start_new_session=True)
        self.pid = self.process.pid
        self.expect("driving")
        self.guard = guard_of(self.pid)

    def expect(self, word: str) -> str:
        """The rest of the next line that begins so."""
        assert self.process.stdout is not None
        for line in self.process.stdout:
            if line.startswith(word):
                return line[len(word):].strip()
        assert self.process.stderr is not None
        raise AssertionError(f"no {word!r}: {self.process.stderr.read()[-400:]}")

    def fault(self) -> float:
        """Let it happen; its stamp."""
        assert self.process.stdin is not None
        self.process.stdin.write("now\n")
        self.process.stdin.flush()
        return float(self.expect("at"))

    def close(self) -> None:
        guard = guard_of(self.pid)
        self.process.kill()
        self.process.wait()
        if guard is not None:
            with_signal(guard, 9)
        for pipe in (self.process.stdin, self.process.stdout, self.process.stderr):
            if pipe is not None:
                pipe.close()


def with_signal(pid: int, number: int) -> None:
    """Send it; a process that is gone already is fine."""
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        return


class ProcessRig:
    """What both kinds share: drivers, and the last pulse that drives."""

    url = name = cars = ""
    extra_ms = 0.0

    def __init__(self) -> None:
        self._drivers: list[DriverProcess] = []
        self._nice = os.getpriority(os.PRIO_PROCESS, 0)
        with suppress(PermissionError):     # where the right is given, other programs wait
            os.setpriority(os.PRIO_PROCESS, 0, FAVOURED)

    def __enter__(self) -> ProcessRig:
        return self

    def __exit__(self, *_: object) -> None:
        for driver in self._drivers:
            driver.close()
        self.close()
        os.setpriority(os.PRIO_PROCESS, 0, self._nice)

    def close(self) -> None: ...

    def pulses(self) -> list[tuple[float, float]]:
        raise NotImplementedError

    def longest_stall(self, since: float, until: float) -> float:
        """Longest time [s] for which the machine had no processor for this rig."""
        return 0.0

    def driver(self, how: str = "wait") -> DriverProcess:
        driver = DriverProcess(self, how)
        self._drivers.append(driver)
        return driver

    def drove(self, moment: float) -> bool:
        """Whether the ESC had a throttle at that time: a busy machine may have tripped before."""
        before = [pulse for pulse in self.pulses() if pulse[0] <= moment]
        return bool(before) and before[-1][1] > RIG_NEUTRAL_US + SLACK_US

    def last_wrong(self, since: float) -> float:
        """ms from ``since`` to the end of the last pulse that drives; NEVER = it goes on."""
        pulses = self.pulses()
        driving = [t for t, width in pulses if width > RIG_NEUTRAL_US + SLACK_US]
        last = max(driving, default=0.0)
        if last > time.monotonic() - 0.1:
            return NEVER
        return max(0.0, 1e3 * (last - since) + self.extra_ms)


class PtyRig(ProcessRig):
    """``server.py`` in a process of its own."""

    def __init__(self, folder: Path, options: str = "", nano: str = "mock") -> None:
        super().__init__()
        self.folder = folder / f"car-{len(list(folder.iterdir()))}"
        self.folder.mkdir()
        self.process = subprocess.Popen(
            [sys.executable, str(HERE / "server.py"), f"sim://?nano={nano}{options}",
             str(self.folder)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            env=environment())
        assert self.process.stdout is not None
        first_line = self.process.stdout.readline()
        if not first_line:
            assert self.process.stderr is not None
            raise AssertionError(self.process.stderr.read()[-400:])
        announcement = json.loads(first_line)
        self.url = announcement["url"]
        self.name = announcement["car"]
        self.port = announcement["port"]
        self.cars = str(self.folder / "cars")

    def order(self, word: str) -> float:
        """Send a command to the server (``unplug``); return the stamp."""
        assert self.process.stdin is not None
        moment = time.monotonic()
        self.process.stdin.write(word + "\n")
        self.process.stdin.flush()
        return moment

    def pulses(self) -> list[tuple[float, float]]:
        assert self.process.poll() is None, "the car's server has ended"
        text = (self.folder / "pulses").read_text()
        rows = [line.split() for line in text.splitlines() if line.count(" ") == 1]
        return [(float(t), float(width)) for t, width in rows]

    def longest_stall(self, since: float, until: float) -> float:
        text = (self.folder / "stalls").read_text()
        rows = [tuple(map(float, line.split())) for line in text.splitlines()]
        return max((length for t, length in rows if since < t < until + length), default=0.0)

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        for pipe in (self.process.stdin, self.process.stdout, self.process.stderr):
            if pipe is not None:
                pipe.close()


class HilRig(ProcessRig):
    """The real car: its registers, each millisecond."""

    extra_ms = 20.0

    def __init__(self, url: str, folder: Path) -> None:
        super().__init__()
        self.url, self.name = url, os.environ.get("DART_HAL_CAR", "dart-01")
        self.cars = os.environ.get("DART_CARS", "")
        files = load_car(self.name, [Path(self.cars)] if self.cars else None)
        self._register = 0x08 + 4 * files.config.throttle.channel
        self._address = files.config.pwm.address
        self._bus = open_bus(Url.parse(url).options["i2c"])
        self._pulses: list[tuple[float, float]] = []
        self._done = threading.Event()
        self._thread = threading.Thread(target=self._look, daemon=True)
        self._thread.start()

    def _look(self) -> None:
        while not self._done.wait(1e-3):
            pair = bytearray(2)
            for k in range(2):
                one = bytearray(1)
                self._bus.writeto_then_readfrom(self._address, bytes([self._register + k]), one)
                pair[k] = one[0]
            width = (pair[0] | (pair[1] & 0x1F) << 8) * COUNT_US
            self._pulses.append((time.monotonic(), width if pair[1] < 0x10 else 0.0))

    def pulses(self) -> list[tuple[float, float]]:
        return list(self._pulses)

    def close(self) -> None:
        self._done.set()
        self._thread.join()
        close = getattr(self._bus, "close", None)
        if close is not None:
            close()
