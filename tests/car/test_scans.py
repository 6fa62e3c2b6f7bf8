"""A car with a lidar: scans with its States, in its recording, and the same from the recording."""

from __future__ import annotations

from itertools import pairwise
from math import sin

import numpy as np
import pytest
from mcap.reader import make_reader

from dart_hal.car import Car
from dart_hal.core.errors import UsageError
from dart_hal.core.types import Mount
from dart_hal.devices.links.base import open_backend
from dart_hal.recording.run import RunReader
from dart_lab.sim.lidar.maps import clearance
from dart_lab.sim.truth import room_of_car, world_of
from tests.common import KINEMATIC_3_URL

EXACT_LIDAR_URL = f"{KINEMATIC_3_URL}&lidar=noise=0,dropout=0,scale=1,x=0.13,y=0,yaw=0"


def drive(url, seconds, record=None):
    """(States, scans, room, poses of the truth) of a drive in bends."""
    backend = open_backend(url)
    states = []
    scans = []
    with Car.over(backend, record=record) as car:
        car.arm()
        car.lidar.scans()
        for state in car.states(duration=seconds):
            states.append(state)
            scans += car.lidar.scans()
            car.drive(steering=0.35 * sin(3.0 * state.t), throttle=0.2)
        assert car.lidar.trouble is None
        return states, scans, room_of_car(backend), world_of(backend).poses


def list_values(scan):
    return (scan.arrival, scan.start, scan.rate, scan.std, scan.after.tobytes(),
            scan.angle.tobytes(), scan.distance.tobytes(), scan.mount)


@pytest.mark.slow
def test_scans_lie_on_the_walls_of_the_true_room_and_a_replay_has_the_same(tmp_path):
    path = tmp_path / "run.mcap"
    states, scans, room, poses = drive(EXACT_LIDAR_URL, 3.0, path)
    assert 20 <= len(scans) <= 26
    assert all(s.mount == Mount(x=0.13) for s in scans)

    def pose_at(t):
        x0, y0, yaw0 = room.start
        x, y, yaw = poses(t).T
        c = np.cos(yaw0)
        s = np.sin(yaw0)
        return x0 + c * x - s * y, y0 + s * x + c * y, yaw0 + yaw

    everything = np.vstack((room.lines, room.glass))
    for scan in scans[4:]:
        off = [clearance(everything, x, y) for x, y in scan.points(pose_at)[::10]
               if np.isfinite(x)]
        assert len(off) > 30
        assert np.median(off) < 0.004
    for a, b in pairwise(scans):
        assert 0.0 <= b.start - a.t[-1] < 0.5e-3
    for state in states[50:]:  # a revolution takes 0.14 s, and is whole with the next one's first
        assert 0.0 < state.t - state.scan.t[-1] < 0.2
    live = {state.seq: list_values(state.scan) for state in states if state.scan}
    with Car.open(f"replay://{path}") as car:
        again = {state.seq: list_values(state.scan) for state in car.states() if state.scan}
        assert car.lidar.trouble is None
    assert all(again[seq] == before for seq, before in live.items())


@pytest.mark.slow
def test_a_run_keeps_scans_as_the_unit_sent_them(tmp_path):
    path = tmp_path / "run.mcap"
    _, scans, _, _ = drive(EXACT_LIDAR_URL, 1.0, path)
    kept = {s.start: s for s in RunReader(path).scans()}
    for scan in scans:
        same = kept[scan.start]
        assert list_values(same)[:-1] == list_values(scan)[:-1]
        assert same.mount == Mount()
    with path.open("rb") as file:
        names = {c.topic: s.name for s, c, _ in make_reader(file).iter_messages()}
    assert names["/scan"] == "dart_msgs/msg/LidarScan"


def test_without_a_lidar_nothing_is_reported_or_recorded(tmp_path):
    path = tmp_path / "run.mcap"
    with Car.open(KINEMATIC_3_URL, record=path) as car:
        assert next(car.states()).scan is None
        assert not car.has_lidar
        with pytest.raises(UsageError, match="no lidar"):
            car.lidar.scans()
    with path.open("rb") as file:
        assert "/scan" not in {
            c.topic for c in make_reader(file).get_summary().channels.values()}
    assert list(RunReader(path).scans()) == []


@pytest.mark.slow
def test_without_reads_the_newest_is_kept():
    with Car.open(f"{KINEMATIC_3_URL}&lidar=1") as car:
        for state in car.states(duration=9.5):
            pass
        came = car.lidar.scans()
        assert len(came) == 64
        assert came[-1] is state.scan
        assert car.lidar.scans() == ()


def test_the_lidar_of_the_environment_is_opened(monkeypatch):
    monkeypatch.setenv("DART_HAL_LIDAR", "colour://red")
    with pytest.raises(UsageError, match="is no lidar"):
        Car.open(KINEMATIC_3_URL)
    with Car.open(f"{KINEMATIC_3_URL}&lidar=1") as car:  # which has one of its own
        assert car.lidar.scans() == ()


def test_a_map_without_a_lidar_is_refused():
    with pytest.raises(UsageError, match="needs a lidar or a camera"):
        Car.open(f"{KINEMATIC_3_URL}&map=room")
    with pytest.raises(UsageError, match="map=cellar is no room"):
        Car.open(f"{KINEMATIC_3_URL}&lidar=1&map=cellar")
