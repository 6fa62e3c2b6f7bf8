"""A run is repeatable to the bit, and its recording gives the same States again."""

from __future__ import annotations

import hashlib
import json
import math
import subprocess
import sys

import pytest

from dart_hal.car import Car
from dart_hal.core.errors import EndOfRecording, LinkLost
from dart_hal.devices.links.base import open_backend

REPLAY_NANOS = ["mock", pytest.param("avr", marks=pytest.mark.emulator)]

REPLAY_SCRIPT = """
from math import sin
def control(state):
    return 0.3 * sin(3 * state.t), 0.25
"""


def flat(state):
    pose = state.pose
    health = state.health
    return (state.t, state.seq, state.speed, state.speed_std, state.yaw_rate, state.accel_x,
            state.accel_y, state.ticks, pose.x, pose.y, pose.yaw, pose.cov.tobytes(),
            state.applied, health.flags, health.imu_age, health.beat_age, health.lost,
            health.skipped, health.vcc, health.t_std, health.accel_kind, health.calib)


class Sliced:
    """A link that is read in slices of ``slice_s`` and keeps what passed."""

    def __init__(self, link, slice_s):
        self._link = link
        self._slice = slice_s
        self.heard, self.sent = hashlib.sha256(), hashlib.sha256()

    def __getattr__(self, name):
        return getattr(self._link, name)

    def read(self, timeout):
        chunk = self._link.read(min(timeout, self._slice))
        if chunk is not None:
            self.heard.update(chunk.data + repr(chunk.t).encode())
        return chunk

    def write(self, data):
        self.sent.update(data)
        self._link.write(data)


def closed_loop(url, cars, record=None, slice_s=None, seconds=2.0):
    """Drives by what it sees; returns the States and the digests of the bytes."""
    backend = open_backend(url)
    link = backend.link = Sliced(backend.link, slice_s or 1.0)
    with Car.over(backend, cars=cars, record=record) as car:
        car.arm()
        states = []
        for state in car.states(duration=seconds):
            yaw = 0.3 * math.sin(2 * state.t) - 0.5 * (state.yaw_rate or 0.0)
            car.drive(steering=0.2 * yaw, throttle=0.3 * (1.0 - state.speed))
            states.append(flat(state))
    return states, link.heard.hexdigest(), link.sent.hexdigest()


@pytest.mark.parametrize("kind", REPLAY_NANOS)
@pytest.mark.slow_except("mock")
def test_replay_gives_the_states_of_the_run(kind, tmp_path):
    path = tmp_path / "run.mcap"
    states, _, _ = closed_loop(f"sim://?seed=5&nano={kind}", tmp_path, record=path)
    with Car.open(f"replay://{path}") as car:
        replayed = {s.seq: flat(s) for s in car.states()}
        with pytest.raises(EndOfRecording):
            car._pump.next(0.5)
    assert len(states) >= 199
    assert [replayed[s[1]] for s in states] == states
    assert states[-1][2] > 0.1
    assert len({s[12] for s in states}) > 10, "the pulses were taken from the recording"


@pytest.mark.slow
def test_a_replay_is_not_driven_and_reports_it(tmp_path):
    path = tmp_path / "run.mcap"
    closed_loop("sim://?nano=mock", tmp_path, record=path, seconds=0.5)
    with Car.open(f"replay://{path}") as car:
        car.arm()
        next(car.states())
        assert "NOT_SENT" in car.drive(steering=0.1, throttle=0.1).limited
        assert car.stop().throttle == 0.0


@pytest.mark.parametrize("kind", REPLAY_NANOS)
@pytest.mark.slow
def test_two_runs_are_one_file(kind, tmp_path):
    files = [tmp_path / "a.mcap", tmp_path / "b.mcap"]
    url = f"sim://?seed=9&nano={kind}&jitter=usb"
    first, second = (closed_loop(url, tmp_path, record=f, seconds=1.0) for f in files)
    assert first == second
    assert files[0].read_bytes() == files[1].read_bytes()
    other = closed_loop(url.replace("seed=9", "seed=8"), tmp_path, seconds=1.0)
    assert other[1] != first[1]


@pytest.mark.parametrize(("kind", "extra"), [
    ("mock", ""), ("mock", "&jitter=busy&ber=1e-5"),
    pytest.param("avr", "", marks=pytest.mark.emulator),
    pytest.param("avr", "&jitter=busy&ber=1e-5", marks=[pytest.mark.emulator, pytest.mark.long]),
])
@pytest.mark.slow
def test_the_length_of_a_read_cannot_be_noticed(kind, extra, tmp_path):
    url = f"sim://?seed=3&nano={kind}{extra}"
    first, *others = (closed_loop(url, tmp_path, slice_s=s, seconds=1.0)
                      for s in (1e-2, 1e-3, 1e-4))
    assert all(other == first for other in others)


@pytest.mark.parametrize("kind", REPLAY_NANOS)
@pytest.mark.slow
def test_drive_and_replay_print_the_same_digest(kind, tmp_path):
    script = tmp_path / "wave.py"
    run = tmp_path / "run.mcap"
    script.write_text(REPLAY_SCRIPT)

    def verb(*args):
        done = subprocess.run([sys.executable, "-m", "dart_hal.cli.main", *args, "--json"],
                              capture_output=True, text=True, cwd=tmp_path, check=False)
        assert done.returncode == 0, done.stderr
        return json.loads(done.stdout)

    driven = verb("drive", str(script), "--url", f"sim://?seed=4&nano={kind}", "--record",
                  str(run), "--duration", "2")
    again = verb("replay", str(run))
    assert driven["frames"] == again["frames"] > 400
    assert driven["summary"]["states_sha256"] == again["summary"]["states_sha256"]
    assert driven["summary"]["pose"] == again["summary"]["pose"]
    assert driven["summary"]["distance_m"] == again["summary"]["distance_m"] > 0.1


def test_a_closed_car_states_that_it_is_closed(tmp_path):
    car = Car.open("sim://?nano=mock", cars=tmp_path)
    car.close()
    car.close()
    assert car.mode == "CLOSED"
    with pytest.raises(LinkLost, match="closed"):
        next(car.states())
