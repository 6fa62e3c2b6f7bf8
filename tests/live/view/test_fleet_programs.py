"""The page of a fleet with programs that drive: found, lost, and STOP ALL at the cars' pins."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from contextlib import ExitStack
from pathlib import Path

import pytest

from dart_hal.fleet.station import Station
from dart_lab.live.view import messages as m
from dart_lab.live.view.fleet_desk import FleetDesk

ROOM = "udp://239.255.42.97:7451?via=127.0.0.1"
FOUND = 5.0
RED = 1.0
STOPPED = 0.3
"""s: the figures that are promised."""
pytestmark = [pytest.mark.slow, pytest.mark.realtime]


class Programs(ExitStack):
    """Two programs with two cars each in processes of their own, and a page that listens."""

    def __init__(self, folder):
        super().__init__()
        self.out = [folder / f"{n}.json" for n in range(2)]
        self.processes = []
        self.cars = {}

    def __enter__(self):
        for n, out in enumerate(self.out):
            words = [sys.executable, Path(__file__).parent / "fleet_program.py", ROOM,
                     str(1 + 2 * n), out]
            self.processes.append(subprocess.Popen(words, stdin=subprocess.PIPE))
            self.callback(self.end, self.processes[-1])
        self.desk = FleetDesk([self.enter_context(Station(ROOM))])
        return self

    def end(self, process):
        process.stdin.close()
        try:
            process.wait(20)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()

    def until(self, done, seconds):
        """s until the states on the page, by car, are so."""
        begun = time.monotonic()
        while not done(self.cars):
            assert time.monotonic() - begun < seconds, self.cars
            for message in map(json.loads, self.desk.batch()):
                if message["type"] == "cars":
                    self.cars = {car["name"]: car["state"] for car in message["cars"]}
            time.sleep(1 / 30)
        return time.monotonic() - begun

    def all_drive(self):
        self.until(lambda cars: list(cars.values()) == ["driving"] * 4, 40.0)

    def pins(self):
        """{car: when its ESC got a pulse that drives}."""
        for process in self.processes:
            self.end(process)
        return {car: [t for t, us in pulses if abs(us - 1500.0) > 5.0]
                for out in self.out for car, pulses in json.loads(out.read_text()).items()}


@pytest.fixture
def programs(tmp_path):
    with Programs(tmp_path) as made:
        yield made


def test_stop_all_is_at_the_pins_of_cars_whose_programs_drive_on(programs):
    programs.all_drive()
    pressed = time.monotonic()
    programs.desk.handle_message("page", m.Stop())
    programs.until(lambda cars: list(cars.values()) == ["refused"] * 4, 2.0)
    time.sleep(0.5)
    driving = programs.pins()
    assert len(driving) == 4
    for car, times in driving.items():
        assert any(pressed - 0.2 < t <= pressed for t in times), f"control: {car} drove until then"
        assert max(times) - pressed <= STOPPED, car


def test_a_page_that_comes_later_finds_all_and_one_that_is_killed_is_lost(programs):
    programs.all_drive()
    with Station(ROOM) as station:
        programs.desk = FleetDesk([station])
        programs.cars = {}
        assert programs.until(lambda cars: len(cars) == 4, 10.0) <= FOUND
        programs.processes[1].kill()
        assert programs.until(lambda cars: "lost" in cars.values(), 5.0) <= RED
        programs.until(lambda cars: sorted(cars.values()) == ["driving"] * 2 + ["lost"] * 2, 2.0)
