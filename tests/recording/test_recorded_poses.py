"""Poses from outside in a run: a typed channel that gives back the very numbers."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from dart_hal.core.types import ExternalPose
from dart_hal.recording import cdr
from dart_hal.recording.run import RunReader

metres = st.floats(-1e4, 1e4)
stamps = st.floats(0.0, 2.0**31 - 1.0)


@given(stamp=stamps, x=metres, y=metres, yaw=st.floats(-50.0, 50.0), frame=st.text(max_size=20))
def test_a_pose_comes_back_to_the_bit(stamp, x, y, yaw, frame):
    cov = np.array(((0.01, 1e-3, 2e-4), (1e-3, 0.02, 1e-5), (2e-4, 1e-5, 0.3)))
    pose = ExternalPose(stamp, 1.25, x, y, yaw, cov, frame)
    again = cdr.decode_external_pose(cdr.encode_external_pose(pose), 1.25)
    assert (again.stamp, again.x, again.y, again.yaw, again.frame) == (
        pose.stamp, x, y, pose.yaw, frame)
    assert again.cov.tobytes() == cov.tobytes()
    assert abs(pose.stamp - stamp) <= 0.6e-9
    assert abs(math.sin(0.5 * (pose.yaw - yaw))) < 1e-9


@pytest.mark.parametrize("wrong", [
    {"x": math.nan}, {"yaw": math.inf}, {"stamp": -1.0}, {"stamp": 1.7e12}, {"arrival": math.nan},
    {"cov": np.full((3, 3), np.nan)}])
def test_what_is_no_pose_is_refused(wrong):
    with pytest.raises(ValueError, match=r"finite|seconds"):
        ExternalPose(**{"stamp": 1.0, "arrival": 1.0, "x": 0.0, "y": 0.0, "yaw": 0.0, **wrong})


def test_a_run_keeps_its_poses_as_a_ros_message(tmp_path, writing):
    path = tmp_path / "run.mcap"
    writer = writing(path, close=False)
    poses = [ExternalPose(1.7e9 + 0.01 * k, 0.5 + 0.01 * k, 0.1 * k, -2.0, 3.0 + 0.1 * k)
             for k in range(20)]
    for pose in poses:
        writer.pose(pose)
    writer.close()
    assert [(p.stamp, p.arrival, p.x, p.y, p.yaw) for p in RunReader(path).poses()] == [
        (p.stamp, p.arrival, p.x, p.y, p.yaw) for p in poses]
    with path.open("rb") as file:
        schemas = {c.topic: s.name for s, c, _ in make_reader(file).iter_messages()}
    assert schemas["/external_pose"] == "geometry_msgs/msg/PoseWithCovarianceStamped"


def test_a_run_without_poses_has_no_channel_for_them(run_file):
    with run_file.open("rb") as file:
        assert "/external_pose" not in {
            c.topic for c in make_reader(file).get_summary().channels.values()}
    assert list(RunReader(run_file).poses()) == []
