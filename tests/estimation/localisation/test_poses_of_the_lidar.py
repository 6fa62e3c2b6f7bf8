"""From the bytes of an emulated lidar to poses of a car, as a controller sees them."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from math import remainder, tau
from typing import NamedTuple

import numpy as np
import pytest

from dart_hal import Car
from dart_hal.car import poses
from dart_hal.car.lidar import UNMEASURED_MOUNT_STD, mount_of, mounting_covariance
from dart_hal.cli.main import main
from dart_hal.core.config import load_car
from dart_hal.core.errors import UsageError
from dart_hal.core.types import Pose, Tracking
from dart_hal.devices.links.base import open_backend
from dart_hal.estimation import room
from dart_hal.estimation.localisation.field import map_of_lines
from dart_hal.estimation.localisation.health import PROBATION_SCANS, Agreement, Status, TrackJudge
from dart_hal.estimation.localisation.localiser import Localiser
from dart_hal.estimation.localisation.rays import fastest_cast
from dart_hal.estimation.localisation.search import search
from dart_hal.estimation.localisation.source import LidarPoses, open_source
from dart_hal.estimation.odometry import Odometry
from dart_lab.sim.lidar.maps import box, room_of
from dart_lab.sim.room_truth import true_path
from dart_lab.sim.truth import room_of_car, world_of
from studies.localisation.world import drive, hidden
from tests.common import MAPPED_ROOM_URL


def far(a, b):
    return float(np.hypot(a[0] - b[0], a[1] - b[1]))


@pytest.mark.slow
@pytest.mark.parametrize("lidar", ["1", "ld19", "rplidar"])
def test_a_car_knows_its_place_by_its_lidar_alone(tmp_path, lidar):
    """Searched, tracked, fused, recorded; a replay gives the same."""
    backend = open_backend(MAPPED_ROOM_URL.replace("lidar=1", f"lidar={lidar}"))
    room = room_of_car(backend)
    world = world_of(backend)
    x0, y0, yaw0 = room.start
    run = tmp_path / "run.mcap"
    source = LidarPoses(map_of_lines(room.lines))
    with Car.over(backend, poses=source, record=run) as car:
        car.arm(waive=("CALIBRATION_MISSING", "PWM_CLOCK_UNCALIBRATED"))
        for state in car.states(duration=2.5):
            car.drive_speed(steering=0.3, speed=1.0)
    x, y, _ = world.poses(np.array([state.t]))[0]
    c = np.cos(yaw0)
    s = np.sin(yaw0)
    external = state.external
    assert external.tracking is Tracking.TRACKING
    pose = external.estimate.pose
    assert far((pose.x, pose.y), (x0 + c * x - s * y, y0 + s * x + c * y)) < 0.015
    with Car.open(f"replay://{run}") as again:
        *_, last = again.states()
    assert last.external.estimate.pose.x == pytest.approx(pose.x, abs=1e-9)


def test_a_map_needs_a_lidar():
    with pytest.raises(UsageError, match="no lidar"):
        Car.open("sim://?nano=mock", poses=LidarPoses(map_of_lines(box(0, 0, 0, 4, 3))))


def test_poses_made_on_board_need_no_marker(monkeypatch):
    """By the attributes of the source, for any class."""
    class Source:
        name = "another localiser"
        map_std = 0.0

        def poll(self, now):
            return []

        def close(self):
            pass

    made = []
    monkeypatch.setattr(room, "ExternalPoseEstimator",
                        lambda _, *marker, **how: made.append(marker))
    for Source.on_board in (False, True):
        poses.room_of(load_car("dart-01", ["cars"]), Odometry(), Source())
    assert made == [(), (room.make_axle_marker(UNMEASURED_MOUNT_STD),)]


def drive_turned_lidar():
    """Yaw [rad]: error at rest and its standard error; the same after 15 s of driving."""
    backend = open_backend("sim://?nano=mock&lidar=1&map=room&seed=4")
    source = LidarPoses(map_of_lines(room_of_car(backend).lines))
    found = []
    with Car.over(backend, poses=source) as car:
        for state in car.states(duration=3.0):
            pass
        found.append(yaw_error(backend, state))
        car.arm(waive=("CALIBRATION_MISSING",))
        for state in car.states(duration=15.0):
            car.drive_speed(steering=0.4 if int(state.t) // 4 % 2 else -0.4, speed=0.6)
        found.append(yaw_error(backend, state))
    return found


def yaw_error(backend, state):
    estimate = state.external.estimate
    true = true_path(backend, np.array([estimate.t]))[0]
    return abs(remainder(estimate.pose.yaw - true[2], tau)), float(np.sqrt(estimate.cov[2, 2]))


@pytest.mark.slow
def test_the_yaw_of_the_mounting_is_in_the_covariance_and_learnt():
    (at_rest, rest_std), (driven, driven_std) = drive_turned_lidar()
    print(f"at rest {at_rest:.4f} +- {rest_std:.4f}, driven {driven:.4f} +- {driven_std:.4f} rad")
    assert at_rest > 0.015
    assert at_rest < 2.0 * rest_std
    assert driven < 0.5 * at_rest
    assert driven < 2.0 * driven_std
    assert driven_std < 0.3 * rest_std


@pytest.mark.slow
def test_control_a_mounting_without_error_is_stated_too_well(monkeypatch):
    monkeypatch.setattr(poses, "mount_std", lambda files: (0.0, 0.0, 0.0))
    (_, _), (driven, driven_std) = drive_turned_lidar()
    assert driven > 4.0 * driven_std


def test_an_error_of_the_mounting_turns_the_car_about_the_lidar():
    with Car.open("sim://?nano=mock&lidar=1") as car:
        covariance = mounting_covariance(car.files, yaw=0.0)
        ahead = mount_of(car.files).x
    x, y, yaw = UNMEASURED_MOUNT_STD
    assert np.sqrt(np.diag(covariance)) == pytest.approx([x, np.hypot(y, ahead * yaw), yaw])


@pytest.mark.parametrize("text", ["lidar:", "lidar:map.yaml?begin=1", "lidar:m.yaml?start=1,2",
                                  "lidar:m.yaml?start=1,2,nan"])
def test_a_source_that_makes_no_sense_is_refused(text):
    with pytest.raises(UsageError):
        open_source(text)


def simulate_scan(lines, pose=(2.0, 1.5, 0.4)):
    """Points and rays of a car at rest without noise."""
    turn = np.linspace(-np.pi, np.pi, 606, endpoint=False)
    origin = np.tile(pose[:2], (606, 1))
    ahead = pose[2] + turn
    r = fastest_cast()(lines, origin, np.column_stack((np.cos(ahead), np.sin(ahead))))
    points = (r[:, None] * np.column_stack((np.cos(turn), np.sin(turn))))[r < 10.0]
    return points, points, np.zeros_like(points)


@pytest.mark.slow
def test_a_bare_rectangle_is_ambiguous_and_a_room_is_not():
    bare = box(3.0, 2.5, 0.0, 6.0, 5.0)
    found = search(map_of_lines(bare), *simulate_scan(bare))
    assert found.fits
    assert not found.is_unique
    room = room_of("room", 3)
    found = search(map_of_lines(room.lines), *simulate_scan(room.lines, pose=room.start))
    assert found.is_unique
    assert far(found.pose, room.start) < 0.02


def test_three_bad_scans_are_a_loss_and_two_are_none():
    judge = TrackJudge(0.95)
    good = Agreement(0.9, 0.0)
    bad = Agreement(0.3, 0.1)
    assert [judge.add(a) for a in (bad, bad, good, bad, bad)] == [Status.TRACKING] * 5
    assert judge.add(bad) is Status.LOST


def test_a_known_map_grows_stale_but_a_searched_one_was_another_rooms():
    judge = TrackJudge(0.95)
    searched = TrackJudge(0.8, Agreement(0.8, 0.0))
    much = Agreement(0.65, 0.0)
    half = Agreement(0.5, 0.0)
    assert {judge.add(much) for _ in range(60)} == {Status.TRACKING, Status.MAP_STALE}
    assert judge.add(half) is Status.MAP_STALE  # the threshold is lower there
    assert Status.LOST in [searched.add(much) for _ in range(PROBATION_SCANS)]


def test_one_bad_scan_gives_no_pose(quiet_drive):
    """The negative control is the scan before."""
    local, scans = quiet_drive
    assert local.add(scans[0]).pose is not None
    blinded = replace(scans[1], distance=np.full(len(scans[1]), 0.4))
    assert local.add(blinded).pose is None


@pytest.fixture
def quiet_drive():
    d = drive(2003, hidden(2003, seconds=2.0))
    local = Localiser(d.chart, tuple(d.true(float(d.scans[5].t[-1]) - 0.01).tolist()))
    for k in range(len(d.t)):
        d.tell(local, k)
    return local, d.scans[5:]


def test_next_to_the_loop_of_a_real_car_the_same_poses_come():
    d = drive(2003, hidden(2003, seconds=3.0))
    start = tuple(d.true(float(d.scans[0].t[-1]) - 0.01).tolist())
    inline = LidarPoses(d.chart, start)
    threaded = LidarPoses(d.chart, start)
    threaded.start_thread()
    for source in (inline, threaded):
        k = 0
        for scan in d.scans:
            n = int(np.searchsorted(d.t, scan.arrival))
            source.add_states([Moment(float(t), Pose(*pose)) for t, pose in
                          zip(d.t[k:n], d.told[k:n].tolist(), strict=True)])
            source.add(scan)
            k = n
    want = inline.poll(9.0)
    got = []
    end = time.monotonic() + 10.0
    while len(got) < len(want) and time.monotonic() < end:
        got += threaded.poll(9.0)
        time.sleep(0.01)
    threaded.close()
    assert len(want) == len(d.scans)
    assert [(p.stamp, p.x, p.y) for p in got] == [(p.stamp, p.x, p.y) for p in want]
    assert {p.arrival for p in got} == {9.0}
    assert threaded.dropped == 0


class Moment(NamedTuple):
    """What the localiser reads of a State."""

    t: float
    pose: Pose
    accel_x: float | None = None


def cover(scan):
    return replace(scan, distance=np.full(len(scan), np.nan))


@pytest.mark.slow
@pytest.mark.parametrize("lose", [cover, None])
def test_a_lidar_that_is_covered_or_silent_is_no_tracking(capsys, monkeypatch, lose):
    """The last pose stayed the newest one: TRACKING, exit status 0."""
    add = LidarPoses.add
    monkeypatch.setattr(LidarPoses, "add", lambda source, scan: (
        add(source, scan) if scan.arrival < 2.0 else lose and add(source, lose(scan))))
    with pytest.raises(SystemExit) as done:
        main(["localize", "--url", MAPPED_ROOM_URL, "--duration", "4", "--json"])
    found = json.loads(capsys.readouterr().out)
    assert done.value.code == 1
    assert found["counts"]["TRACKING"] > 5, "negative control"
    assert (found["status"], found["pose"]) == ("LOST", None)
    assert found["why"]


def test_states_do_not_pile_up_without_scans():
    source = LidarPoses(map_of_lines(box(0.0, 0.0, 0.0, 4.0, 3.0)))
    with Car.open("sim://?nano=mock&lidar=1&seed=4") as car:
        states = list(car.states(duration=8.0))
    for state in states:
        source.add_states([state])
    assert 500 < len(source._states) <= 601
