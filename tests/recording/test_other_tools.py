"""Every channel of a run through the decoders that others use."""

from __future__ import annotations

import math
from collections import Counter

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.highlevel import AnyReader, AnyReaderError

from dart_hal.core.types import ExternalPose, Image, Scan
from dart_hal.recording.log import LogNames
from dart_hal.recording.repair import repair

RUN_TOPICS = {"/rx", "/tx", "/i2c", "/command", "/applied", "/odom", "/imu", "/drive", "/scan",
              "/external_pose", "/camera/image/compressed", "/log/mpc/cost", "/log/mpc/plan"}
PLAN_POINTS = np.arange(6.0).reshape(2, 3)


@pytest.fixture
def full_run(tmp_path, writing):
    """A run with something in every kind of channel; its clock showed 0.25 s just now."""
    path = tmp_path / "run.mcap"
    writer = writing(path, close=False, now=0.25)
    names = LogNames()
    for k in range(5):
        t = 0.4 + 0.05 * k
        writer.log(t, names.take("mpc",
                                 {"cost": math.nan if k == 3 else 0.5 * k, "plan": PLAN_POINTS}))
        writer.pose(ExternalPose(1.7e9 + t, t, 1.0, -2.0, 0.5))
        writer.scan(Scan(t, t - 0.1, 4000.0, np.linspace(0, 0.1, 7), np.linspace(0, 6, 7),
                         np.full(7, 1.5), 0.01))
        writer.image(Image(t, t - 0.04, bytes((k, 1, 2, 3))))
    writer.close()
    return path


def counts(path) -> Counter[str]:
    with path.open("rb") as file:
        return Counter(c.topic for _, c, _ in make_reader(file).iter_messages())


def test_rosbags_decodes_every_message(full_run, state):
    found = Counter()
    odom = []
    with AnyReader([full_run]) as reader:
        for connection, stamp, raw in reader.messages():
            message = reader.deserialize(raw, connection.msgtype)
            found[connection.topic] += 1
            if connection.topic == "/odom":
                assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == stamp
                odom.append(message)
            elif connection.topic == "/camera/image/compressed":
                taken = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
                assert stamp - taken == pytest.approx(0.04e9, abs=2.0)
                assert (message.format, bytes(message.data)[1:]) == ("jpeg", b"\1\2\3")
            elif connection.topic == "/log/mpc/plan":
                assert message.data.tolist() == PLAN_POINTS.ravel().tolist()
                assert [d.size for d in message.layout.dim] == [2, 3]
    assert found == counts(full_run)
    assert set(found) == RUN_TOPICS
    assert [m.twist.twist.linear.x for m in odom] == [state(k).speed for k in range(20)]


def test_the_decoder_of_foxglove_decodes_every_message(full_run):
    found = Counter()
    commands = []
    with full_run.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, message, decoded in reader.iter_decoded_messages():
            assert schema.encoding == "ros2msg"
            assert message.log_time > 10**18, "of this century"
            found[channel.topic] += 1
            if channel.topic == "/command":
                commands.append((decoded.steering, decoded.throttle, decoded.source))
            elif channel.topic == "/scan":
                assert list(decoded.distance) == [1.5] * 7
    assert found == counts(full_run)
    assert commands == [(0.01 * k, 0.5, "user") for k in (0, 5, 10, 15)]


def test_stamps_are_in_order_for_who_reads_by_time(full_run):
    with AnyReader([full_run]) as reader:
        stamps = [stamp for _, stamp, _ in reader.messages()]
        assert (reader.start_time, reader.end_time - 1) == (stamps[0], stamps[-1])
    assert stamps == sorted(stamps)
    assert stamps[-1] - stamps[0] < 10**9


def test_topics_are_absolute(full_run):
    assert all(topic.startswith("/") for topic in counts(full_run))


def test_a_killed_run_opens_everywhere_once_it_is_repaired(full_run):
    """It has no index; only ours opens it without."""
    full_run.write_bytes(full_run.read_bytes()[:-3000])
    with pytest.raises(AnyReaderError), AnyReader([full_run]):
        pass
    done = repair(full_run)
    with AnyReader([full_run]) as reader:
        found = [reader.deserialize(raw, c.msgtype) for c, _, raw in reader.messages()]
    assert len(found) == done.messages > 80
