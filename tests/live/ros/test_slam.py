"""Scans, transforms, clock and map of a simulated drive, as SLAM and localisation of ROS read them.

slam_gmapping and amcl are not in Debian: ``slam_readers`` has what their sources require.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from ros_types import classes_of
from slam_readers import Buffer, Gmapping, amcl_points, reading_times, seconds
from toy_ros import BridgedCar

from dart_hal.core.types import Tracking
from dart_hal.estimation.localisation.field import draw_grid, map_of_grid, map_of_lines
from dart_hal.estimation.localisation.grid import Grid
from dart_lab.live.ros.messages import build_object, occupancy_grid
from dart_lab.live.ros.told import TopicWriter
from dart_lab.sim.room_truth import true_path


@pytest.fixture(scope="module")
def driven():
    """A car after 4 s of a circle in its room, localised by its lidar; its States."""
    url = "sim://?nano=mock&seed=4&lidar=1&map=room"
    with BridgedCar(url, localised=True) as car:
        car.states = []
        car.car.on_state(car.states.append)

        def each(t):
            car.ros.publish_value("safety_value", float(t > 0.1))
            car.ros.publish_value("throttle_1", 0.25)
            car.ros.publish_value("steering_1", 0.8)

        car.run(4.0, each)
        car.scans = [m for topic, m in car.ros.published if topic == "scan_1"]
        car.buffer = Buffer(car.ros.published)
        yield car


def stamped(driven, topic):
    """{stamp in us since the first State: message} of a topic."""
    zero = driven.bridge._epoch
    return {round(1e6 * (seconds(m.fields["header"].fields["stamp"]) - zero)): m
            for name, m in driven.ros.published if name == topic}


@pytest.mark.slow
def test_topics_of_a_car_with_lidar_and_map(driven):
    kinds = {"scan_1": "sensor_msgs/LaserScan", "/tf_static": "tf2_msgs/TFMessage",
             "/map": "nav_msgs/OccupancyGrid", "/clock": "rosgraph_msgs/Clock"}
    assert kinds.items() <= driven.ros.advertised.items()
    assert driven.ros.latched == {"/tf_static", "/map"}
    topics = [topic for topic, _ in driven.ros.published]
    assert topics.count("/tf_static") == topics.count("/map") == 1
    assert topics.count("/clock") == topics.count("/tf") == topics.count("odom_1")
    assert len(driven.scans) > 20


@pytest.mark.slow
def test_map_times_odometry_is_the_localised_pose(driven):
    checked = 0
    for us, odometry in stamped(driven, "odom_1").items():
        state = min(driven.states, key=lambda one: abs(one.t - 1e-6 * us))
        if state.external.estimate is None or state.external.tracking is Tracking.LOST:
            continue
        t = seconds(odometry.fields["header"].fields["stamp"])
        found = driven.buffer.look_up("map", "base_link_1", t)
        pose = state.estimate.pose
        assert (found.x, found.y) == pytest.approx((pose.x, pose.y), abs=1e-6)
        assert np.cos(found.yaw - pose.yaw) == pytest.approx(1.0, abs=1e-9)
        checked += 1
    assert checked > 300


@pytest.mark.slow
def test_the_localised_pose_is_where_the_car_truly_is(driven):
    rows = driven.buffer.links["odom_1"][1][-200:]
    true = true_path(driven.backend, np.array([t for t, _ in rows]) - driven.bridge._epoch)
    found = [driven.buffer.look_up("map", "base_link_1", t) for t, _ in rows]
    off = np.hypot(*(np.array([(one.x, one.y) for one in found]) - true[:, :2]).T)
    assert off.max() < 0.03
    assert np.ptp(true[:, 0]) > 0.5, "it drove"


@pytest.mark.slow
def test_odometry_is_continuous_while_the_map_corrects_it(driven):
    rows = driven.buffer.links["base_link_1"][1]
    steps = [np.hypot(b.x - a.x, b.y - a.y) for (_, a), (_, b) in pairwise(rows)]
    assert max(steps) < 0.03
    corrections = {(pose.x, pose.y) for _, pose in driven.buffer.links["odom_1"][1]}
    assert len(corrections) > 10


@pytest.mark.slow
def test_without_a_pose_there_is_no_map_frame(driven):
    writer = TopicWriter(1, 0.09, simulated=True)
    state = driven.states[-1]
    for external in (None, replace(state.external, estimate=None),
                     replace(state.external, tracking=Tracking.LOST)):
        tf = dict(writer.messages(replace(state, external=external), (0.0,) * 3, 0.0))["/tf"]
        assert [one.fields["child_frame_id"] for one in tf.fields["transforms"]] == ["base_link_1"]


@pytest.mark.slow
def test_gmapping_accepts_each_scan_and_places_its_points_right(driven):
    mapper = Gmapping(driven.scans[0], driven.buffer)
    for scan in driven.scans:
        points = mapper.points(scan)
        assert mapper.reverse is False
        assert len(points) > 300
        assert placed_right(driven, scan, points) > 0.9


@pytest.mark.slow
def test_control_gmapping_of_a_mirrored_scan_places_them_wrongly(driven):
    mapper = Gmapping(driven.scans[0], driven.buffer)
    scan = driven.scans[10]
    mirrored = replace(scan, fields={**scan.fields, "ranges": scan.fields["ranges"][::-1]})
    assert placed_right(driven, mirrored, mapper.points(mirrored)) < 0.5


@pytest.mark.slow
def test_control_gmapping_drops_a_scan_of_another_size(driven):
    mapper = Gmapping(driven.scans[0], driven.buffer)
    scan = driven.scans[10]
    shorter = replace(scan, fields={**scan.fields, "ranges": scan.fields["ranges"][1:]})
    with pytest.raises(AssertionError, match="another size"):
        mapper.points(shorter)


def placed_right(driven, scan, points):
    """Share of points (n, 2), in the car, that the true scan has within half a step of angle."""
    start = np.median(reading_times(scan)) - driven.bridge._epoch
    true = min((s.scan for s in driven.states if s.scan is not None),
               key=lambda one: abs(float(np.median(one.t)) - start)).in_car()
    true = true[np.isfinite(true).all(axis=1)]
    distance = np.min(np.hypot(*(points[:, None] - true[None]).transpose(2, 0, 1)), axis=1)
    return float(np.mean(distance < 0.01 + 0.01 * np.hypot(*points.T)))


@pytest.mark.slow
def test_amcl_finds_the_walls_of_the_map_under_the_beams(driven):
    """By the pose in the map at the stamp of the scan; control: with the other sense of angles."""
    shares = [on_walls(driven, scan, amcl_points(scan, driven.buffer)) for scan in driven.scans[8:]]
    assert np.median(shares) > 0.7, "of eight cars: .72 to 1"
    scan = driven.scans[-1]
    mirrored = replace(scan, fields={**scan.fields, "ranges": scan.fields["ranges"][::-1]})
    assert on_walls(driven, mirrored, amcl_points(mirrored, driven.buffer)) < 0.5


def on_walls(driven, scan, points):
    """Share of points (n, 2), in the car, with an occupied cell of the map within 0.15 m.

    amcl places the whole scan by the pose at its stamp: the car moves by 0.1 m during a turn.
    """
    grid = driven.ros.last("/map").fields
    info = grid["info"].fields
    cells = np.array(grid["data"]).reshape(info["height"], info["width"])
    origin = info["origin"].fields["position"].fields
    rows, columns = np.nonzero(cells == 100)
    walls = np.column_stack((columns, rows)) * info["resolution"] + (origin["x"], origin["y"])
    at = driven.buffer.look_up("map", "base_link_1",
                               seconds(scan.fields["header"].fields["stamp"]))
    c, s = np.cos(at.yaw), np.sin(at.yaw)
    points = points @ np.array(((c, s), (-s, c))) + (at.x, at.y)
    distance = [np.hypot(*(walls - point).T).min() for point in points[::5]]
    return float(np.mean(np.array(distance) < 0.15))


@pytest.mark.slow
def test_one_clock_for_all_stamps(driven):
    """Control: the transform of a time after the last State is refused."""
    times = [seconds(m.fields["clock"]) for topic, m in driven.ros.published if topic == "/clock"]
    assert times == sorted(set(times))
    assert times == [seconds(m.fields["header"].fields["stamp"])
                     for topic, m in driven.ros.published if topic == "odom_1"]
    sent = 0.0
    for topic, message in driven.ros.published:
        if topic == "/clock":
            sent = seconds(message.fields["clock"])
        elif topic == "scan_1":
            readings = reading_times(message)
            assert sent - 0.4 < readings.min() < readings.max() <= sent
            f = message.fields
            assert readings.max() - readings.min() == pytest.approx(
                f["scan_time"] * (1.0 - 1.0 / len(f["ranges"])))
            for t in (readings.min(), readings.max()):
                driven.buffer.look_up("odom_1", "laser_1", t)
    with pytest.raises(AssertionError, match="future"):
        driven.buffer.look_up("odom_1", "base_link_1", times[-1] + 1.0)


@pytest.mark.slow
@pytest.mark.parametrize("topic", ["scan_1", "/tf", "/tf_static", "/map", "/clock"])
@pytest.mark.parametrize("store_name", ["ROS2_HUMBLE", "ROS1_NOETIC"])
def test_each_message_fits_the_types_of_ros(driven, topic, store_name):
    class_of, store = classes_of(store_name)
    made = build_object(driven.ros.last(topic), class_of)
    pack, unpack = ((store.serialize_cdr, store.deserialize_cdr) if store_name.startswith("ROS2")
                    else (store.serialize_ros1, store.deserialize_ros1))
    data = bytes(pack(made, made.__msgtype__))
    assert bytes(pack(unpack(data, made.__msgtype__), made.__msgtype__)) == data


def test_map_has_its_walls_where_they_are():
    chart = map_of_lines(np.array(((0.0, 0.0, 2.0, 0.0), (0.0, 0.0, 0.0, 1.0))))
    grid = draw_grid(chart)
    rows, columns = np.nonzero(grid.occupied)
    places = grid.origin + grid.cell * (np.column_stack((columns, rows)) + 0.5)
    off = np.minimum(np.hypot(places[:, 1], places[:, 0] - np.clip(places[:, 0], 0.0, 2.0)),
                     np.hypot(places[:, 0], places[:, 1] - np.clip(places[:, 1], 0.0, 1.0)))
    assert off.max() <= grid.cell
    for x in np.arange(0.0, 2.0, 0.01):
        assert not grid.is_free(x, 0.0)
    assert grid.is_free(1.0, 0.5)


def test_map_of_a_file_is_the_grid_of_the_file():
    occupied = np.zeros((3, 4), bool)
    occupied[0] = True
    free = np.zeros((3, 4), bool)
    free[1] = True
    grid = draw_grid(map_of_grid(Grid(occupied, free, 0.05, np.array((1.0, -2.0)))))
    message = occupancy_grid(grid, 12.5, "map").fields
    assert message["data"] == [100] * 4 + [0] * 4 + [-1] * 4
    info = message["info"].fields
    assert (info["width"], info["height"], info["resolution"]) == (4, 3, 0.05)
    place = info["origin"].fields["position"].fields
    assert (place["x"], place["y"]) == (1.0, -2.0)
