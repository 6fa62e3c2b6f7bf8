"""LaserScan and transforms of a bag: where they put the beams, the lidar and the car."""

from __future__ import annotations

from math import cos, sin
from types import SimpleNamespace

import numpy as np
import pytest
from rosbags.highlevel import AnyReader

from dart_hal.car import Car
from dart_hal.car.export import standard
from dart_hal.car.export.bags import _rosbags, _types_of, write_ros1, write_ros2
from dart_hal.car.export.standard import Planar
from dart_hal.core.types import Mount, Scan
from dart_hal.devices.links.base import open_backend
from dart_hal.recording.run import RunReader
from dart_lab.sim.mocap import hidden_mocap
from dart_lab.sim.truth import world_of


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """2 s of a bend, with lidar and motion capture; the true place (t, x, y, yaw) each State."""
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    truth = []
    backend = open_backend("sim://?seed=3&nano=mock&lidar=1&mocap=1")
    with Car.over(backend, record=path) as car:
        car.arm()
        for state in car.states(duration=2.0):
            car.drive(steering=0.2, throttle=0.3)
            at = world_of(backend).truth(state.t)
            truth.append((state.t, at.x, at.y, at.yaw))
    return path, truth


@pytest.fixture(scope="module", params=[
    write_ros2, pytest.param(write_ros1, marks=pytest.mark.slow)], ids=["ros2", "ros1"])
def bag(run, request, tmp_path_factory):
    """[(topic, ns, message)] of the run's bag."""
    out = tmp_path_factory.mktemp("bag") / ("run.bag" if request.param is write_ros1 else "run")
    request.param(RunReader(run[0]), out)
    with AnyReader([out]) as reader:
        return [(c.topic, t, reader.deserialize(raw, c.msgtype)) for c, t, raw in reader.messages()]


def planar(turn, place):
    return Planar(place.x, place.y, 2.0 * np.arctan2(turn.z, turn.w))


def links(bag):
    """(ns, {(frame, child): Planar}) of each message of /tf, by its stamp."""
    for topic, _, message in bag:
        if topic == "/tf":
            stamp = message.transforms[0].header.stamp
            yield stamp.sec * 10**9 + stamp.nanosec, {
                (one.header.frame_id, one.child_frame_id):
                    planar(one.transform.rotation, one.transform.translation)
                for one in message.transforms}


@pytest.mark.slow
def test_every_odometry_has_its_transforms(bag):
    topics = [topic for topic, _, _ in bag]
    assert topics.count("/tf") == topics.count("/odom") > 200
    *_, (_, last) = links(bag)
    assert set(last) == {("mocap", "odom"), ("odom", "base_link"), ("base_link", "laser")}
    assert last["base_link", "laser"].x == pytest.approx(0.13, abs=0.05)
    newest = [message for topic, _, message in bag if topic == "/odom"][-1]
    assert last["odom", "base_link"] == planar(newest.pose.pose.orientation,
                                               newest.pose.pose.position)


@pytest.mark.slow
def test_the_stamps_of_external_poses_are_on_the_clock_of_the_bag(bag):
    """That of the motion capture was hours from the others: no filter could match them."""
    late = [ns - (m.header.stamp.sec * 10**9 + m.header.stamp.nanosec)
            for topic, ns, m in bag if topic == "/external_pose"]
    assert len(late) > 100
    assert min(late) >= 0
    assert max(late) < 50e6


@pytest.mark.slow
def test_a_scan_has_its_beams_where_the_unit_saw_them(run, bag):
    mount = standard.mount_of(standard._files(RunReader(run[0])))
    mounted = [scan.mounted(mount) for scan in RunReader(run[0]).scans()]
    scans = [message for topic, _, message in bag if topic == "/scan"]
    assert len(scans) == len(mounted) == [topic for topic, _, _ in bag].count("/scan/raw") > 10
    laser = Planar(mount.x, mount.y, mount.yaw)
    for scan, message in zip(mounted, scans, strict=True):
        assert message.header.frame_id == "laser"
        assert message.scan_time == pytest.approx(1.0 / scan.rate)
        n = len(message.ranges)
        assert n == len(scans[0].ranges), "readers keep the number of the first message"
        assert message.angle_increment > 0.0
        assert n == round((message.angle_max - message.angle_min) / message.angle_increment) + 1
        assert message.time_increment == pytest.approx(-1.0 / scan.rate / n), "an X4 is clockwise"
        angles = message.angle_min + message.angle_increment * np.arange(len(message.ranges))
        finite = np.isfinite(message.ranges)
        reach = message.ranges[finite]
        bearing = laser.yaw + angles[finite]
        points = np.column_stack((laser.x + reach * np.cos(bearing),
                                  laser.y + reach * np.sin(bearing)))
        true = scan.in_car()[np.isfinite(scan.distance)]
        distances = np.min(np.hypot(*(points[:, None] - true[None]).transpose(2, 0, 1)), axis=1)
        half = 0.5 * abs(message.angle_increment)
        assert np.all(distances <= half * reach + 1e-3)
        assert finite.sum() > 0.8 * len(true), "few beams share a step"


def scan_of(angles, distances, *, inverted=False):
    after = 0.125 * np.array(angles) / (2.0 * np.pi)
    return Scan(1.0, 0.9, 8.0, after, np.array(angles), np.array(distances),
                mount=Mount(inverted=inverted))


@pytest.mark.slow
def test_a_beam_mirrored_is_detected(run):
    """Control: the test above would see a unit taken to turn the other way."""
    scan = scan_of([0.0, np.pi / 2, np.pi, 3 * np.pi / 2], [1.0, 2.0, 3.0, 4.0], inverted=True)
    message = standard.laser_scan(scan, 0, store_of(run), 4)
    other = standard.laser_scan(scan.mounted(Mount(inverted=False)), 0, store_of(run), 4)
    assert list(other.ranges) == [1.0, 2.0, 3.0, 4.0]
    assert list(message.ranges) == [4.0, 3.0, 2.0, 1.0]
    assert message.angle_min == pytest.approx(np.pi / 2)
    assert message.angle_max == pytest.approx(2.0 * np.pi)


@pytest.mark.slow
@pytest.mark.parametrize("inverted", [False, True])
def test_every_reading_has_the_time_of_its_beam(run, inverted):
    scan = scan_of(np.arange(4) * np.pi / 2, [1.0, 2.0, 3.0, 4.0], inverted=inverted)
    message = standard.laser_scan(scan, 0, store_of(run), 4)
    stamp = message.header.stamp.sec + 1e-9 * message.header.stamp.nanosec
    times = {reach: stamp + k * message.time_increment for k, reach in enumerate(message.ranges)}
    assert [times[reach] for reach in (1.0, 2.0, 3.0, 4.0)] == pytest.approx(scan.t, abs=1e-6)


@pytest.mark.slow
def test_nothing_that_came_back_is_infinite_and_a_lost_beam_is_nan(run):
    scan = scan_of([0.0, 0.1, np.pi / 2, 3 * np.pi / 2], [1.0, np.nan, np.nan, 2.0])
    message = standard.laser_scan(scan, 0, store_of(run), 4)
    assert message.ranges.tolist()[:2] == [1.0, np.inf]
    assert np.isnan(message.ranges[2])
    assert message.ranges[3] == 2.0


def test_out_of_range_is_infinite_with_the_sign_of_the_side():
    scan = scan_of([0.0, np.pi / 2, np.pi, 3 * np.pi / 2], [0.05, 0.13, 11.9, 12.1])
    assert standard.laser_readings(scan, 4).ranges.tolist() == [
        -np.inf, np.float32(0.13), np.float32(11.9), np.inf]


@pytest.mark.parametrize(("lengths", "readings"), [
    ([], 0), ([0], 0), ([620, 625, 630], 620), ([625, 12, 622, 300, 624], 622)])
def test_number_of_readings_is_that_of_the_shortest_whole_turn(lengths, readings):
    assert standard.count_readings(lengths) == readings


def store_of(run):
    return _types_of(RunReader(run[0]), _rosbags())


@pytest.mark.slow
def test_a_scan_without_a_beam_has_no_reading(run):
    empty = Scan(1.0, 0.9, 8.0, *np.zeros((3, 0)))
    message = standard.laser_scan(empty, 0, store_of(run), 0)
    assert len(message.ranges) == 0
    assert message.angle_increment == 0.0
    assert np.isnan(standard.laser_scan(empty, 0, store_of(run), 5).ranges).tolist() == [True] * 5


@pytest.mark.slow
@pytest.mark.parametrize("known", [True, False])
def test_poses_in_the_room_are_where_the_car_was(run, tmp_path, monkeypatch, known):
    """By the marker as it truly is; control: taken to sit on the axle it is off by its arm."""
    true = hidden_mocap(3)
    arm = float(np.hypot(true.lx, true.ly))
    axle = Planar(true.lx, true.ly, -true.theta).inverse() if known else Planar()
    monkeypatch.setattr(standard, "_marker_of",
                        lambda files: standard._Marker(axle, true.latency if known else 0.0))
    start = Planar(true.x, true.y, true.yaw)
    off = []
    (path, truth), store = run, store_of(run)
    messages = [(m.topic, m.ns, store.deserialize_cdr(m.data, m.kind))
                for m in standard.messages(RunReader(path), store) if m.topic == "/tf"]
    for (ns, chain), (t, x, y, yaw) in zip(list(links(messages))[-len(truth):], truth,
                                           strict=True):
        assert ns == pytest.approx(1e9 * t, abs=1e3)
        here = chain["mocap", "odom"] @ chain["odom", "base_link"]
        there = start @ Planar(x, y, yaw)
        off.append(np.hypot(here.x - there.x, here.y - there.y))
    assert arm > 0.02
    assert (max(off[-50:]) < 0.02) == known


@pytest.mark.slow
def test_the_marker_is_turned_back(run):
    def value(number):
        return SimpleNamespace(value=number)

    table = SimpleNamespace(marker_x=value(0.1), marker_y=value(0.02), marker_yaw=value(0.3),
                            latency=value(0.05))
    found = standard._marker_of(SimpleNamespace(calibration=SimpleNamespace(mocap=table)))
    axle = Planar(1.0, 2.0, 0.5)
    marker = Planar(1.0 + 0.1 * cos(0.5) - 0.02 * sin(0.5), 2.0 + 0.1 * sin(0.5) + 0.02 * cos(0.5),
                    0.5 - 0.3)
    assert marker @ found.axle == pytest.approx(axle)
    assert found.latency == 0.05
    assert standard._marker_of(None) == (Planar(), 0.0)
