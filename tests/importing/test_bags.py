"""ROS 1 bags, ROS 2 bags, MCAP files, LeRobot data sets and data frames are read as tables."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from dart_hal.car.runs import read_run
from dart_hal.core.errors import RecordingError
from dart_hal.recording.imported import write_imported
from dart_lab.importing import (
    convert_tables,
    guess_map,
    load_map,
    read_tables,
    table_from_frame,
)
from dart_lab.importing.bags import _store
from dart_lab.importing.maps import column_of, parse_map
from tests.importing.logs import MAP, MAX_ANGLE, make_log

pytest.importorskip("rosbags")
from rosbags import rosbag1, rosbag2

TOPICS = {
    "/pf/pose/odom": ("nav_msgs/msg/Odometry", 20), "/odom": ("nav_msgs/msg/Odometry", 2),
    "/drive": ("ackermann_msgs/msg/AckermannDriveStamped", 5),
    "/sensors/imu/raw": ("sensor_msgs/msg/Imu", 1),
    "/sensors/core": ("vesc_msgs/msg/VescStateStamped", 2),
    "/battery": ("sensor_msgs/msg/BatteryState", 50)}


@pytest.fixture(scope="module")
def log():
    columns = make_log(8.0)
    return {**columns, "voltage": 8.2 - 0.05 * (columns["t"] - columns["t"][0])}


def make_message(store, kind, columns, k):
    """Return a message of a row of the log."""
    types = store.types
    sec, rest = divmod(float(columns["t"][k]), 1.0)
    stamp = types["builtin_interfaces/msg/Time"](sec=int(sec), nanosec=round(1e9 * rest))
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="map")
    vector = types["geometry_msgs/msg/Vector3"]
    zero = vector(x=0.0, y=0.0, z=0.0)
    if kind.endswith("AckermannDriveStamped"):
        drive = types["ackermann_msgs/msg/AckermannDrive"](
            steering_angle=MAX_ANGLE * columns["steering"][k], steering_angle_velocity=0.0,
            speed=6.0 * columns["throttle"][k], acceleration=0.0, jerk=0.0)
        return types[kind](header=header, drive=drive)
    if kind.endswith("VescStateStamped"):
        state = types["vesc_msgs/msg/VescState"]
        numbers = dict.fromkeys(state.__dataclass_fields__, 0) | {
            "voltage_input": columns["voltage"][k]}
        numbers.pop("__msgtype__", None)
        return types[kind](header=header, state=state(**numbers))
    if kind.endswith("BatteryState"):
        cells = np.full(2, 0.5 * columns["voltage"][k], dtype=np.float32)
        numbers = dict.fromkeys(("temperature", "current", "charge", "capacity", "design_capacity",
                                 "percentage"), np.nan)
        return types[kind](
            header=header, voltage=columns["voltage"][k], **numbers, power_supply_status=2,
            power_supply_health=1, power_supply_technology=3, present=True, cell_voltage=cells,
            cell_temperature=np.zeros(0, dtype=np.float32), location="", serial_number="")
    half = 0.5 * columns["yaw"][k]
    turn = types["geometry_msgs/msg/Quaternion"](x=0.0, y=0.0, z=np.sin(half), w=np.cos(half))
    if kind.endswith("Imu"):
        return types[kind](
            header=header, orientation=turn, orientation_covariance=np.zeros(9),
            angular_velocity=vector(x=0.0, y=0.0, z=columns["yaw_rate"][k]),
            angular_velocity_covariance=np.zeros(9),
            linear_acceleration=vector(x=columns["accel_x"][k], y=columns["accel_y"][k], z=9.81),
            linear_acceleration_covariance=np.zeros(9))
    point = types["geometry_msgs/msg/Point"](x=columns["x"][k], y=columns["y"][k], z=0.0)
    pose = types["geometry_msgs/msg/PoseWithCovariance"](
        pose=types["geometry_msgs/msg/Pose"](position=point, orientation=turn),
        covariance=np.zeros(36))
    twist = types["geometry_msgs/msg/TwistWithCovariance"](
        twist=types["geometry_msgs/msg/Twist"](
            linear=vector(x=columns["speed"][k], y=0.0, z=0.0), angular=zero),
        covariance=np.zeros(36))
    return types[kind](header=header, child_frame_id="base_link", pose=pose, twist=twist)


def write_ros2(folder, columns, plugin=rosbag2.StoragePlugin.SQLITE3):
    store = _store()
    with rosbag2.Writer(folder, version=9, storage_plugin=plugin) as writer:
        for topic, (kind, every) in TOPICS.items():
            connection = writer.add_connection(topic, kind, typestore=store)
            for k in range(0, len(columns["t"]), every):
                writer.write(connection, round(1e9 * (columns["t"][k] + 0.003)),
                             store.serialize_cdr(make_message(store, kind, columns, k), kind))
    return folder


def write_ros1(path, columns):
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    from dart_lab.importing.bags import DEFINITIONS

    store = get_typestore(Stores.ROS1_NOETIC)
    for name, text in DEFINITIONS.items():
        if name not in store.fielddefs:
            store.register(get_types_from_msg(text, name))
    header = store.types["std_msgs/msg/Header"]
    with rosbag1.Writer(path) as writer:
        for topic, (kind, every) in TOPICS.items():
            connection = writer.add_connection(topic, kind, typestore=store)
            for k in range(0, len(columns["t"]), every):
                message = make_message(_Ros1(store, header), kind, columns, k)
                writer.write(connection, round(1e9 * (columns["t"][k] + 0.003)),
                             store.serialize_ros1(message, kind))
    return path


class _Ros1:
    """Types of ROS 1, whose header has a number."""

    def __init__(self, store, header):
        self.types = dict(store.types)
        self.types["std_msgs/msg/Header"] = lambda stamp, frame_id: header(
            seq=0, stamp=stamp, frame_id=frame_id)


def compare(tables, log):
    mapping, text = load_map("f1tenth")
    data = convert_tables(tables, mapping, text)
    assert data.drive == "speed"
    assert data.steering_scale == pytest.approx(0.4189)
    rows = slice(None, None, 20)
    poses = data.streams["poses"]
    assert poses.t == pytest.approx(log["t"][rows], abs=1e-6)
    assert poses.values[:, 2] == pytest.approx(np.unwrap(log["yaw"][rows]), abs=1e-6)
    commands = data.streams["commands"].values
    assert commands[:, 0] == pytest.approx(MAX_ANGLE / 0.4189 * log["steering"][::5], abs=1e-6)
    assert commands[:, 1] == pytest.approx(6.0 * log["throttle"][::5], abs=1e-6)
    assert data.streams["encoder"].values[:, 0] == pytest.approx(log["speed"][::2])
    assert data.streams["gyro"].values[:, 0] == pytest.approx(log["yaw_rate"])
    assert data.streams["battery"].values[:, 0] == pytest.approx(log["voltage"][::2])


@pytest.mark.slow
@pytest.mark.parametrize("plugin", list(rosbag2.StoragePlugin))
def test_a_ros2_bag_is_imported_by_topic(log, tmp_path, plugin):
    compare(read_tables([write_ros2(tmp_path / "bag", log, plugin)]), log)


@pytest.mark.slow
def test_one_mcap_file_of_a_bag_is_enough(log, tmp_path):
    folder = write_ros2(tmp_path / "bag", log, rosbag2.StoragePlugin.MCAP)
    path = shutil.copy(next(folder.glob("*.mcap")), tmp_path / "one.mcap")
    compare(read_tables([path]), log)


@pytest.mark.slow
def test_a_ros1_bag_is_imported_by_topic(log, tmp_path):
    compare(read_tables([write_ros1(tmp_path / "run.bag", log)]), log)


BATTERY_TOPICS = ("/sensors/core", "/battery")


@pytest.mark.slow
@pytest.mark.parametrize(("kept", "column"), [
    (BATTERY_TOPICS, "state.voltage_input"), (BATTERY_TOPICS[1:], "voltage"), ((), None)])
def test_a_guess_finds_the_voltage_of_the_battery(log, tmp_path, kept, column):
    tables = [table for table in read_tables([write_ros2(tmp_path / "bag", log)])
              if table.name in kept or table.name not in BATTERY_TOPICS]
    found = guess_map(tables).map.battery
    if column is None:
        assert found is None
        return
    assert (found.table, column_of(found.voltage).column) == (kept[0], column)
    data = convert_tables(tables, guess_map(tables).map)
    write_imported(data, tmp_path / "run.mcap")
    battery = read_run(tmp_path / "run.mcap").battery
    # The clock of the recording starts at the first pose.
    assert battery.interpolate(np.array([2.0, 6.0])) == pytest.approx([8.1, 7.9], abs=1e-3)


@pytest.mark.slow
def test_a_shipped_map_imports_a_bag_without_a_voltage(log, tmp_path):
    tables = [table for table in read_tables([write_ros2(tmp_path / "bag", log)])
              if table.name != "/sensors/core"]
    data = convert_tables(tables, load_map("f1tenth")[0])
    assert "battery" not in data.streams
    assert any("'/sensors/core'" in change for change in data.facts["changes"])


@pytest.mark.slow
def test_a_missing_topic_lists_what_there_is(log, tmp_path):
    tables = read_tables([write_ros2(tmp_path / "bag", log)])
    mapping, _ = load_map("mushr")
    with pytest.raises(RecordingError, match=r"poses.* fits no table") as error:
        convert_tables(tables, mapping)
    assert "/pf/pose/odom" in error.value.found
    assert "table =" in error.value.remedy


@pytest.mark.slow
def test_a_damaged_bag_is_refused(log, tmp_path):
    path = write_ros1(tmp_path / "run.bag", log)
    path.write_bytes(path.read_bytes()[:2000])
    with pytest.raises(RecordingError, match="cannot be read"):
        read_tables([path])


def test_messages_without_definition_are_refused_with_a_remedy(tmp_path):
    from mcap.writer import Writer

    path = tmp_path / "run.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        schema = writer.register_schema("lab_msgs/msg/Secret", "ros2msg", b"lab_msgs/Other inner")
        channel = writer.register_channel("/secret", "cdr", schema)
        writer.add_message(channel, 1, b"\0\1\0\0" + bytes(16), 1)
        writer.finish()
    with pytest.raises(RecordingError, match="cannot be read") as error:
        read_tables([path])
    assert "definitions" in error.value.likely


def write_json(path, channels):
    """Write an MCAP file of (topic, [(time [s], object)]) per channel."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        for topic, rows in channels:
            channel = writer.register_channel(topic, "json", 0, metadata={"from": str(len(rows))})
            for t, row in rows:
                writer.add_message(channel, round(1e9 * t), json.dumps(row).encode(), 0)
        writer.finish()
    return path


def test_json_channels_of_an_mcap_file_are_read(log, tmp_path):
    rows = [(t, {"t": t, "car": {"v": [v, 0.0], "name": "red"}})
            for t, v in zip(log["t"][:50], log["speed"][:50], strict=True)]
    (table,) = read_tables([write_json(tmp_path / "run.mcap", [("/log", rows)])])
    assert table.columns["car.v[0]"] == pytest.approx(log["speed"][:50])
    assert "car.name" not in table.columns


def test_a_key_that_the_first_object_has_not_is_read(tmp_path):
    rows = [(0.0, {"t": 0.0}), (1.0, {"t": 1.0, "v": 2.0}), (2.0, {"t": 2.0, "v": 3.0})]
    (table,) = read_tables([write_json(tmp_path / "run.mcap", [("/log", rows)])])
    assert table.columns["v"] == pytest.approx([float("nan"), 2.0, 3.0], nan_ok=True)


@pytest.mark.parametrize(("offset", "names"), [
    (0.5, {"/pose#1": [1.0, 1.0], "/pose#2": [2.0, 2.0, 2.0]}),
    (9.0, {"/pose": [1.0, 1.0, 2.0, 2.0, 2.0]})])
def test_two_publishers_of_a_topic_are_two_cars_unless_one_follows_the_other(
        tmp_path, offset, names):
    """Two cars that send their pose on one topic would be one car that leaps to and fro."""
    first = [(t, {"x": 1.0}) for t in (0.0, 1.0)]
    second = [(t + offset, {"x": 2.0}) for t in (0.0, 1.0, 2.0)]
    file = write_json(tmp_path / "run.mcap", [("/pose", second), ("/pose", first)])
    assert {table.name: list(table.columns["x"]) for table in read_tables([file])} == names


def test_a_data_frame_is_imported(log):
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({**log, "state": list(zip(log["x"], log["y"], strict=True))})
    frame["t"] = pandas.to_datetime(frame["t"], unit="s")
    text = MAP.replace('x = "x"\ny = "y"', 'x = "state[0]"\ny = "state[1]"')
    data = convert_tables([table_from_frame(frame)], parse_map(text, "map"))
    assert data.streams["poses"].values[:, 1] == pytest.approx(log["y"])
    assert data.streams["poses"].t == pytest.approx(log["t"], abs=1e-6)


def test_a_lerobot_data_set_is_imported_by_episode(log, tmp_path):
    pandas = pytest.importorskip("pandas")
    pytest.importorskip("pyarrow")
    (tmp_path / "set" / "meta").mkdir(parents=True)
    (tmp_path / "set" / "meta" / "info.json").write_text("{}")
    (tmp_path / "set" / "data" / "chunk-000").mkdir(parents=True)
    half = len(log["t"]) // 2
    frame = pandas.DataFrame({
        "timestamp": log["t"], "episode_index": np.arange(len(log["t"])) // half,
        "observation.state": np.stack([log["speed"], log["yaw_rate"]], axis=1).tolist(),
        "action": np.stack([log["steering"], log["throttle"]], axis=1).tolist()})
    frame.to_parquet(tmp_path / "set" / "data" / "chunk-000" / "file-000.parquet")
    tables = read_tables([tmp_path / "set"])
    assert [t.name for t in tables] == ["episode 0", "episode 1"]
    text = """
        schema = "dart-hal/import/1"
        name = "lerobot"
        table = "episode 1"
        time = "timestamp"
        steering = {value = "action[0]"}
        throttle = {value = "action[1]"}
        encoder = {speed = "observation.state[0]"}
        gyro = {yaw_rate = "observation.state[1]"}
    """
    data = convert_tables(tables, parse_map(text, "map"))
    assert data.streams["encoder"].values[:, 0] == pytest.approx(log["speed"][half:])


def test_a_folder_without_tables_is_refused(tmp_path):
    with pytest.raises(RecordingError, match="no table"):
        read_tables([tmp_path])


def test_a_bag_with_a_wrong_checksum_is_refused(log, tmp_path):
    folder = write_ros2(tmp_path / "bag", log, rosbag2.StoragePlugin.MCAP)
    (path,) = folder.glob("*.mcap")
    data = bytearray(path.read_bytes())
    middle = len(data) // 2
    data[middle:middle + 8] = bytes(8)
    path.write_bytes(data)
    with pytest.raises(RecordingError, match="cannot be read"):
        read_tables([path])
