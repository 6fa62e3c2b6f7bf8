"""A run has more than a diagnosis uses: what is not requested changes nothing."""

from __future__ import annotations

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer

from dart_hal.car.runs import read_run
from dart_hal.core.errors import RecordingError
from dart_lab.identification.evidence.onboard_drive import prepare_stretches
from studies.diagnosis import any_car

OTHER_CHANNELS = {"/camera/compressed": b"\xff\xd8 no picture \xff\xd9",
                  "/battery": b'{"volt": 7.4}',
                  "/odom_of_another": b"{}"}
"""Topic: what each of its messages holds."""


@pytest.fixture(scope="module")
def filmed_drive(tmp_path_factory):
    """A second and a half of driving that a motion capture sees as well."""
    path = tmp_path_factory.mktemp("filmed") / "run.mcap"
    any_car.drive("sim://?nano=mock&mocap=1", path, 1.5, np.random.default_rng(5))
    return path


def rewrite(run, path, others=(), but=()):
    """The run with channels of others, and without its own topics ``but``."""
    with run.open("rb") as source, path.open("wb") as target:
        reader = make_reader(source)
        writer = Writer(target)
        writer.start("ros2", "another recorder")
        for a in reader.iter_attachments():
            writer.add_attachment(a.create_time, a.log_time, a.name, a.media_type, a.data)
        for m in reader.iter_metadata():
            writer.add_metadata(m.name, m.metadata)
        theirs = [writer.register_channel(topic, "json", 0) for topic in others]
        ours: dict[int, int] = {}
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.topic in but:
                continue
            if channel.id not in ours:
                kind = writer.register_schema(schema.name, schema.encoding, schema.data)
                ours[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, kind, dict(channel.metadata))
            writer.add_message(ours[channel.id], message.log_time, message.data,
                               message.publish_time, message.sequence)
            for n, topic in zip(theirs, others, strict=True):
                writer.add_message(n, message.log_time, OTHER_CHANNELS[topic], message.publish_time)
        writer.finish()
    return path


def list_inputs(recording):
    """All that a diagnosis takes from it, as bytes."""
    parts = [recording.messages, *([recording.mocap] if recording.mocap else [])]
    return [np.asarray(getattr(part, name)).tobytes() for part in parts
            for name in part.__dataclass_fields__]


@pytest.mark.slow
def test_unknown_channels_are_ignored(filmed_drive, tmp_path):
    plain = read_run(rewrite(filmed_drive, tmp_path / "plain.mcap"))
    more = read_run(rewrite(filmed_drive, tmp_path / "more.mcap", OTHER_CHANNELS))
    assert plain.mocap is not None
    assert list_inputs(more) == list_inputs(plain) == list_inputs(read_run(filmed_drive))


@pytest.mark.slow
def test_requested_channels_are_not_ignored(filmed_drive, tmp_path):
    """Control: the same way of writing without poses, and without what the car sent."""
    without_poses = read_run(rewrite(filmed_drive, tmp_path / "unseen.mcap", OTHER_CHANNELS,
                                   ("/external_pose",)))
    assert without_poses.mocap is None
    with pytest.raises(RecordingError):
        read_run(rewrite(filmed_drive, tmp_path / "mute.mcap", OTHER_CHANNELS, ("/rx",)))


@pytest.mark.slow
def test_a_run_judged_without_its_poses_is_as_if_there_were_none(filmed_drive, tmp_path):
    """By the commands as well, which are read more finely than the sensors."""
    without_poses = rewrite(filmed_drive, tmp_path / "unseen.mcap", but=("/external_pose",))
    with_them, without = (prepare_stretches(read_run(p, poses=False)) for p in (filmed_drive,
                                                                                without_poses))
    assert len(with_them) == len(without) > 0
    for one, other in zip(with_them, without, strict=True):
        for name in ("throttle", "steering", "v_x", "omega"):
            assert np.array_equal(getattr(one.grid, name), getattr(other.grid, name)), name
