"""Bags of ROS 2 and ROS 1: every message of a run, decoded by the library that reads bags."""

from __future__ import annotations

import gzip
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from rosbags.convert.converter import convert
from rosbags.highlevel import AnyReader

from dart_hal.car import Car, Fleet
from dart_hal.car.export.bags import write_ros1, write_ros2
from dart_hal.core.errors import RecordingError, UsageError
from dart_hal.recording.run import RunReader

OLD_RUN = Path(__file__).parents[1] / "recording" / "fixtures"
URL = "sim://?seed=3&nano=mock&lidar=1&camera=top"


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """0.3 s with a lidar, commands, numbers and arrays."""
    path = tmp_path_factory.mktemp("run") / "run.mcap"
    with Car.open(URL, record=path) as car:
        for n, _ in enumerate(car.states(duration=0.3)):
            car.drive(steering=0.001 * n)
            car.log("cost", float("nan") if n == 3 else n)
            car.log("plan", np.arange(4.0).reshape(2, 2) + n)
    return path


def decode_bag(bag):
    """[(topic, ns, message)] of a bag."""
    with AnyReader([bag]) as reader:
        return [(c.topic, t, reader.deserialize(raw, c.msgtype)) for c, t, raw in reader.messages()]


def plain(message):
    """A message as what it holds; a header's seq is ROS 1's alone."""
    if hasattr(message, "__msgtype__"):
        return {name: plain(getattr(message, name)) for name in message.__dataclass_fields__
                if name not in ("seq", "__msgtype__")}
    if isinstance(message, np.ndarray):
        return message.tobytes()
    return [plain(m) for m in message] if isinstance(message, list) else repr(message)


def same(one, other):
    """Whether two bags hold the same; the order within one moment is not defined."""
    one, other = ([(topic, t, plain(m)) for topic, t, m in sorted(bag, key=lambda m: (m[1], m[0]))]
                  for bag in (one, other))
    return one == other


@pytest.mark.slow
def test_every_message_goes_to_ros_1_and_back(run, tmp_path):
    messages = RunReader(run).messages()
    counts = [write_ros2(RunReader(run), tmp_path / "two"),
              write_ros1(RunReader(run), tmp_path / "one.bag")]
    odometry = sum(m.topic == "/odom" for m in messages)
    scans = sum(m.topic == "/scan" for m in messages)
    assert counts == [len(messages) + odometry + scans] * 2
    convert([tmp_path / "one.bag"], tmp_path / "back", "mcap", 9, None, "file", None, None,
            (), (), (), ())
    original = decode_bag(run)
    assert Counter(topic for topic, *_ in original) == Counter(m.topic for m in messages)
    assert {"/rx", "/scan", "/log/plan", "/command", "/odom"} <= {t for t, *_ in original}
    two = decode_bag(tmp_path / "two")
    for bag in ("one.bag", "back"):
        assert same(two, decode_bag(tmp_path / bag)), bag
    made = [one for one in two if one[0] not in ("/tf", "/scan")]
    assert same(original, [(t.removesuffix("/raw"), ns, m) for t, ns, m in made])
    other = [(t, ns, m if t != "/log/cost" else None) for t, ns, m in original]
    assert not same(original, other), "the comparison can fail"


@pytest.mark.slow
def test_a_bag_of_ros_2_has_its_metadata(run, tmp_path):
    write_ros2(RunReader(run), tmp_path / "two")
    text = (tmp_path / "two" / "metadata.yaml").read_text()
    assert "storage_identifier: mcap" in text
    assert "sim://?seed=3" in text, "which car it was"
    assert (tmp_path / "two" / "two.mcap").is_file()


@pytest.mark.slow
@pytest.mark.parametrize("packed", ["v0_1", "v3"])
def test_older_runs_become_bags_with_absolute_topics(packed, tmp_path):
    path = tmp_path / "old.mcap"
    path.write_bytes(gzip.decompress((OLD_RUN / packed / "run.mcap.gz").read_bytes()))
    count = write_ros2(RunReader(path), tmp_path / "two")
    found = decode_bag(tmp_path / "two")
    assert len(found) == count > 500
    assert {"/rx", "/tx", "/i2c", "/command", "/applied", "/odom"} <= {t for t, *_ in found}
    assert {m.__msgtype__ for t, _, m in found if t in ("/command", "/applied")} == {
        "std_msgs/msg/String"}


@pytest.mark.slow
def test_a_run_that_was_killed_or_damaged_becomes_a_bag_of_what_is_there(run, tmp_path):
    path = tmp_path / "cut.mcap"
    data = bytearray(run.read_bytes())
    data[len(data) // 3] ^= 1
    path.write_bytes(data[:2 * len(data) // 3])
    reader = RunReader(path)
    assert reader.damaged
    assert not reader.complete
    assert write_ros1(reader, tmp_path / "one.bag") == len(decode_bag(tmp_path / "one.bag")) > 100


@pytest.mark.slow
def test_of_a_fleet_one_car(tmp_path):
    path = tmp_path / "fleet.mcap"
    with Fleet.open([URL, "sim://?seed=4&nano=mock"], record=path) as fleet:
        for _ in fleet.states(duration=0.1):
            pass
    with pytest.raises(RecordingError, match="sim-3, sim-4"):
        RunReader(path)
    run = RunReader(f"{path}?car=sim-4")
    odometry = sum(m.topic == "/odom" for m in run.messages())
    assert write_ros2(run, tmp_path / "two") == len(run.messages()) + odometry > 30
    assert "/odom" in {t for t, *_ in decode_bag(tmp_path / "two")}


def test_without_the_library_it_names_what_to_install(run, tmp_path, monkeypatch):
    for name in [n for n in sys.modules if n.partition(".")[0] == "rosbags"]:
        monkeypatch.setitem(sys.modules, name, None)
    with pytest.raises(UsageError) as refused:
        write_ros2(RunReader(run), tmp_path / "two")
    assert "-m pip install 'rosbags>=" in refused.value.remedy
    assert not (tmp_path / "two").exists()
