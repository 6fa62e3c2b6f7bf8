"""kill -9 of a program that records a car over a real port: what is missing from its file."""

from __future__ import annotations

import mmap
import struct
import subprocess
import sys
import time

import pytest

from dart_hal.recording.run import RunReader
from dart_hal.recording.run_file import CHUNK_TIME

pytestmark = pytest.mark.realtime

RECORDER = """
import mmap, struct, sys
from dart_hal.car import Car
from dart_hal.recording import run_file
url, name, cars, folder, flush = sys.argv[1:6]
run_file.CHUNK_TIME = float(flush)
with open(folder + "/received", "r+b") as file, \\
        Car.open(url, car=name, cars=cars, record=folder + "/run.mcap") as car:
    received = mmap.mmap(file.fileno(), 16)

    def note(direction, data, t):
        if direction == "rx":
            count, _ = struct.unpack("<qd", received[:])
            received[:] = struct.pack("<qd", count + len(data), t)
        return data

    car.on_bytes(note)
    car.note("from here", {})
    for _ in car.states(timeout=60.0):
        car.drive(steering=0.1)
"""
MAX_LOSS_S = 0.1
"""s of a recording that a kill may cost."""


@pytest.mark.parametrize("flush", [CHUNK_TIME, 1e9])
@pytest.mark.slow_except("0.05")
def test_a_kill_costs_a_recording_less_than_a_tenth_of_a_second(served_car, tmp_path, flush):
    """What the program had received is in shared memory, which outlives it. The control flushes
    never: what was recorded since the opening is lost then."""
    (tmp_path / "received").write_bytes(bytes(16))
    program = subprocess.Popen([sys.executable, "-c", RECORDER, served_car.url, served_car.name,
                                str(served_car.cars), str(tmp_path), str(flush)])
    with (tmp_path / "received").open("r+b") as file, mmap.mmap(file.fileno(), 16) as memory:
        deadline = time.monotonic() + 30.0
        while struct.unpack("<qd", memory[:])[0] < 8000 and time.monotonic() < deadline:
            time.sleep(0.005)
        program.kill()
        program.wait()
        count, last = struct.unpack("<qd", memory[:])
    assert count >= 8000, "it has recorded for more than a second"
    run = RunReader(tmp_path / "run.mcap")
    assert not run.complete
    assert not run.damaged
    kept = max((chunk.t for chunk in run.chunks()), default=float("-inf"))
    if flush == CHUNK_TIME:
        assert last - kept <= MAX_LOSS_S
        assert run.notices, "and it is reported"
    else:
        assert last - kept > MAX_LOSS_S
