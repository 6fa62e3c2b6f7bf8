"""Cars of every kind for one suite: emulated, mocked, and served over a real pty."""

from __future__ import annotations

import contextlib
import json
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from dart_hal.car import Car
from dart_hal.core.errors import BusError, EmulatorMissing, LinkLost, NotArmed
from dart_hal.devices.links.base import open_backend
from dart_hal.devices.links.i2c import open_bus
from dart_hal.devices.links.image import find_image
from tests.common import PROCESS_TIMEOUT_S, WAIVED_GATES

COUNT_US = 122 / 25.0
"""us of one PWM count of the nominal car."""
NEUTRAL_COUNTS = range(305, 309)
"""Counts of neutral, with the clocks of the test cars."""
OFF = 0x1000
"""OFF_H bit 4: no pulse, which is what is left after 0.2 s of neutral."""

URLS_BY_NANO = {"mock": "sim://?nano=mock", "avr": "sim://?nano=avr"}


def counts(bus) -> tuple[int, int]:
    """Steering and throttle counts in the PCA9685's registers."""
    found = []
    for register in (0x08, 0x0C):
        pair = bytearray(2)
        for k in range(2):                              # AI may be off: byte by byte
            one = bytearray(1)
            bus.writeto_then_readfrom(0x40, bytes([register + k]), one)
            pair[k] = one[0]
        found.append(pair[0] | (pair[1] & 0x1F) << 8)
    return found[0], found[1]


class Served:
    """``dart-hal sim --pty --bus`` in a process of its own, in real time."""

    def __init__(self, folder: Path, *, url: str = URLS_BY_NANO["mock"], arm_neutral: float = 2.0,
                 link: bool = False) -> None:
        self.cars = folder / "cars"
        self._bus = None
        socket = folder / "i2c"
        self.process = subprocess.Popen(
            [sys.executable, "-m", "dart_hal.cli.main", "sim", "--pty", "--bus", str(socket),
             "--cars", str(self.cars), "--url", url, "--json",
             *(("--link", str(folder / "nano")) if link else ())],
            stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, cwd=folder)
        text = ""
        while not text.endswith("}\n"):
            line = self.process.stdout.readline()
            assert line, "the server did not come up"
            text += line
        announcement = json.loads(text)
        self.url = announcement["url"]
        self.name = announcement["car"]
        self.port = announcement["pty"]
        file = self.cars / self.name / "car.toml"
        file.write_text(re.sub(r"arm_neutral = .*", f"arm_neutral = {arm_neutral}",
                               file.read_text()))

    def open(self, **options) -> Car:
        return Car.open(self.url, car=self.name, cars=self.cars, **options)

    def counts(self) -> tuple[int, int]:
        """As ``counts``; a busy machine may let the server's answer come too late for the bus."""
        if self._bus is None:
            self._bus = open_bus(self.url.partition("i2c=")[2])
        for _ in range(50):
            with contextlib.suppress(BusError):
                return counts(self._bus)
        return counts(self._bus)

    def is_stopped(self) -> bool:
        """Whether the ESC gets neutral, or no pulse: which of them is a matter of 0.2 s."""
        throttle = self.counts()[1]
        return throttle in NEUTRAL_COUNTS or bool(throttle & OFF)

    def close(self) -> None:
        if self._bus is not None:
            self._bus.close()
        self.process.kill()
        self.process.wait()
        self.process.stdout.close()


class ContractBench:
    """One car under test: ``car``, what its pins carry, and its kind."""

    def __init__(self, kind: str, car: Car, bus, virtual: bool) -> None:
        self.kind = kind
        self.car = car
        self.bus = bus
        self.virtual = virtual

    def counts(self) -> tuple[int, int]:
        return counts(self.bus)

    def ready(self) -> Car:
        """The car, armed. In virtual time at once; a busy machine may need another try."""
        self.car.stop()             # a test may leave it driving
        if self.virtual:
            self._settle(0.7)
            self.car.arm(waive=WAIVED_GATES)
            return self.car
        deadline = time.monotonic() + 4 * PROCESS_TIMEOUT_S
        while time.monotonic() < deadline:
            self._settle(0.7)
            with contextlib.suppress(NotArmed, LinkLost):
                self.car.arm(waive=WAIVED_GATES)
                return self.car
        raise AssertionError(f"the car does not arm: {self.car.mode} {self.car.causes}")

    def _settle(self, seconds: float) -> None:
        if self.car.mode == "LOCKED":
            self.car.unlock("next test")
        for _ in self.car.states(duration=seconds, timeout=PROCESS_TIMEOUT_S):
            pass

    def until(self, good, seconds: float = 1.0) -> list:
        """States until ``good(state)``; a real car on a busy machine gets longer."""
        states = []
        for state in self.car.states(duration=seconds if self.virtual else PROCESS_TIMEOUT_S,
                                     timeout=PROCESS_TIMEOUT_S):
            states.append(state)
            if good(state):
                return states
        raise AssertionError(f"not within {seconds} s; last: {states[-1]}")


def need_emulator() -> None:
    try:
        find_image()
        open_backend(URLS_BY_NANO["avr"]).close()
    except EmulatorMissing as error:
        pytest.skip(f"emulator: {error.what}")


@pytest.fixture(scope="module")
def bench(request, tmp_path_factory):
    """A car of the kind that the test names, shared by the tests of a file."""
    kind = request.param
    folder = tmp_path_factory.mktemp(kind)
    if kind == "pty":
        served_car = Served(folder, arm_neutral=0.2)
        try:
            with served_car.open() as car:
                for _ in car.states(duration=2.5, timeout=PROCESS_TIMEOUT_S):
                    pass  # the ESC requires its 2 s of neutral once; later arming is quick
                yield ContractBench(kind, car, open_bus(served_car.url.partition("i2c=")[2]), False)
        finally:
            served_car.close()
        return
    if kind == "avr":
        need_emulator()
    backend = open_backend(URLS_BY_NANO[kind])
    with Car.over(backend, cars=folder) as car:
        yield ContractBench(kind, car, backend.bus, True)


@pytest.fixture
def served_car(tmp_path):
    """A served car whose ESC is taken as ready after 0.2 s: for tests of processes."""
    made = Served(tmp_path, arm_neutral=0.2)
    yield made
    made.close()


@pytest.fixture
def served_by_name(tmp_path):
    """The same behind a name that follows its port, and with a board's own boot loader."""
    made = Served(tmp_path, url="sim://?nano=mock&boot=old", arm_neutral=0.2, link=True)
    yield made
    made.close()


@pytest.fixture
def arm():
    """``arm(car)``: with the waivers of a car that was never calibrated, and patience."""
    def arm_car(car: Car) -> Car:
        return ContractBench("", car, None, False).ready()

    return arm_car


@pytest.fixture
def source_of():
    """Environment for a Python subprocess that needs none of ours."""
    return {**os.environ, "PYTHONUNBUFFERED": "1"}


