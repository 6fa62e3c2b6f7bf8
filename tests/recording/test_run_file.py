"""The MCAP run: what goes in comes out, and a cut costs only what was cut."""

from __future__ import annotations

import math
import random
import struct
import subprocess
import sys
import threading
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from mcap.reader import make_reader

from dart_hal.core.errors import RecordingError
from dart_hal.core.types import Applied
from dart_hal.recording import cdr, open_writer, stamp
from dart_hal.recording.mcap_records import parse_mcap
from dart_hal.recording.run import RunReader, RunWriter
from tests.ros2msg import decode_messages


@given(st.floats(1e-3, 1e7) | st.just(0.0))
def test_stamps_lose_no_bit(t):
    ns, rest = stamp.split(t)
    assert stamp.join(ns, rest) == t
    assert 0 <= rest < 2**32
    assert abs(ns - t * 1e9) <= 1 + 1e-15 * t * 1e9


def test_whole_nanoseconds_alone_would_lose_bits():
    t = 0.1 + 1 / 3
    assert round(t * 1e9) / 1e9 != t


def test_everything_reads_back(run_file, frame_of):
    run = RunReader(run_file)
    assert run.complete
    assert run.notices == ()
    assert run.meta["url"] == "sim://?seed=1"
    assert run.meta["car"] == "sim-1"
    assert run.meta["dart_hal"] == "0.1.0"
    assert run.start == 0.25
    assert run.files == {"car.toml": "name = 'sim-1'\n"}
    chunks = list(run.chunks())[1:]
    assert [c.data for c in chunks] == [frame_of(k, k) for k in range(20)]
    assert [c.t for c in chunks] == [1 / 3 + 0.7e-9 + 0.01 * k for k in range(20)]
    commands = list(run.commands())
    assert [(c.steering, c.throttle, c.source) for c in commands] == [
        (0.01 * k, 0.5, "user") for k in (0, 5, 10, 15)]
    assert [a.applied.steering_us for a in run.applied()] == [1500.0, 1505.0, 1510.0, 1515.0]
    assert next(run.applied()).applied == Applied(0.0, 0.25, 1500.0, 1612.5, ("RANGE",))
    bus = list(run.i2c())
    assert [(b.address, b.wrote, b.read) for b in bus][1] == (0x40, b"\x06\x00\x05", b"\x20")
    assert len(list(run.sent())) == 4


@given(st.binary(max_size=300), st.binary(max_size=40))
def test_any_bytes_survive(tmp_path_factory, data, read):
    path = tmp_path_factory.mktemp("run") / "bytes.mcap"
    with RunWriter(path) as writer:
        writer.rx(data, 1.5)
        writer.i2c(0x70, data, 1.5, read)
    run = RunReader(path)
    assert [c.data for c in run.chunks()] == [data]
    assert [(b.wrote, b.read) for b in run.i2c()] == [(data, read)]


def test_not_a_number_is_kept(tmp_path):
    with RunWriter(tmp_path / "nan.mcap") as writer:
        writer.command(0.0, math.nan, math.inf, "script")
    command = next(RunReader(tmp_path / "nan.mcap").commands())
    assert math.isnan(command.steering)
    assert command.throttle == math.inf


def test_the_same_run_gives_the_same_bytes(tmp_path, writing):
    writing(tmp_path / "a.mcap")
    writing(tmp_path / "b.mcap")
    assert (tmp_path / "a.mcap").read_bytes() == (tmp_path / "b.mcap").read_bytes()


@pytest.mark.slow
def test_cut_at_every_byte_reads_up_to_the_last_flush(tmp_path, writing):
    path = tmp_path / "cut.mcap"
    writing(path, frames=12)
    data = path.read_bytes()
    full = parse_mcap(path, data)
    assert full.complete
    whole = list(full.messages())
    counts = set()
    for size in range(8, len(data), 3):
        found = parse_mcap(path, data[:size])
        assert not found.complete
        assert not found.damages
        assert list(found.messages()) == whole[:found.count]
        assert found.used <= size
        counts.add(found.count)
    ends = [whole[n - 1].ns for n in sorted(counts - {0})]
    assert max(counts) == len(whole)
    assert max(b - a for a, b in pairwise(ends)) <= 60_000_000


@pytest.mark.slow
def test_a_cut_off_run_opens_and_reports_it(tmp_path, writing):
    path = tmp_path / "cut.mcap"
    writing(path, frames=2)
    data = path.read_bytes()
    full = list(RunReader(path).replay())
    for size in range(8, len(data), 53):
        path.write_bytes(data[:size])
        run = RunReader(path)
        assert not run.complete
        assert str(path) in run.notices[0]
        found = list(run.replay())
        assert found == full[:len(found)]


def test_a_killed_run_keeps_all_but_the_last_50_ms(tmp_path):
    """At every moment the file on the disk lacks less than 50 ms of what was handed over."""
    path = tmp_path / "killed.mcap"
    with RunWriter(path) as writer:
        missing = []
        for k in range(120):
            t = 1.0 + 0.01 * k
            writer.rx(bytes(8), t)
            there = list(RunReader(path).chunks())  # while the writer has it open
            missing.append(t - there[-1].t)
    assert max(missing) < 0.05
    assert max(missing) > 0.02, "flushed each time: a system call per message"


@pytest.mark.slow
def test_a_program_that_is_killed_keeps_what_it_recorded(tmp_path):
    path = tmp_path / "killed.mcap"
    code = ("import os, sys; from dart_hal.recording.run import RunWriter\n"
            "w = RunWriter(sys.argv[1])\n"
            "for k in range(100): w.rx(bytes(8), 1.0 + 0.01 * k)\n"
            "os.kill(os.getpid(), 9)")
    done = subprocess.run([sys.executable, "-c", code, str(path)], check=False)
    assert done.returncode == -9
    run = RunReader(path)
    assert not run.complete
    assert list(run.chunks())[-1].t >= 1.99 - 0.05


def test_threads_that_write_at_once_do_not_damage_the_run(tmp_path):
    """The link's thread records States while the program's records commands."""
    written = 2000
    switch = sys.getswitchinterval()
    with RunWriter(tmp_path / "run.mcap") as writer:
        def write(add):
            for k in range(written):
                add(bytes(8), 1.0 + 0.001 * k)

        threads = [threading.Thread(target=write, args=(add,)) for add in (writer.rx, writer.tx)]
        sys.setswitchinterval(1e-6)
        try:
            for thread in threads:
                thread.start()
            for thread in threads:
                thread.join()
        finally:
            sys.setswitchinterval(switch)
    run = RunReader(tmp_path / "run.mcap")
    assert run.notices == ()
    assert [len(list(what())) for what in (run.chunks, run.sent)] == [written, written]


@pytest.mark.parametrize("content", [
    b"", b"elapsed time sensors, current\n1,2\n", b"\x89PNG\r\n\x1a\n" + bytes(50),
    b"\x89MCAP", bytes(1000)], ids=["empty", "text", "png", "stub", "zeros"])
def test_another_file_is_refused_by_name(tmp_path, content):
    path = tmp_path / "other.mcap"
    path.write_bytes(content)
    with pytest.raises(RecordingError) as error:
        RunReader(path)
    assert str(path) in error.value.what
    assert error.value.found


@pytest.mark.parametrize("name", ["missing.mcap", "."])
def test_what_cannot_be_read_is_refused_by_name(tmp_path, name):
    with pytest.raises(RecordingError) as error:
        RunReader(tmp_path / name)
    assert str(tmp_path / name) in error.value.what


def test_a_foreign_mcap_is_refused_by_name(tmp_path):
    from mcap.writer import Writer

    path = tmp_path / "foreign.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        writer.add_message(writer.register_channel("/camera", "json", 0), 0, b"{}", 0)
        writer.finish()
    with pytest.raises(RecordingError, match="not a run") as error:
        RunReader(path)
    assert "/camera" in error.value.found


def without_channels(run_file) -> bytes:
    data = bytearray(run_file.read_bytes())
    at = data.index(b"/rx") - 4
    data[at:at + 4] = b"\xff\xff\xff\x7f"
    return bytes(data)


def test_the_index_repeats_the_channels(run_file):
    whole = list(RunReader(run_file).chunks())
    run_file.write_bytes(without_channels(run_file))
    run = RunReader(run_file)
    assert run.damaged
    assert list(run.chunks()) == whole[1:], "the first chunk is lost, and that alone"


def test_without_any_channels_it_is_an_error_not_a_crash(run_file):
    run_file.write_bytes(without_channels(run_file)[:-100])
    with pytest.raises(RecordingError, match="damaged") as error:
        RunReader(run_file)
    assert str(run_file) in error.value.what


@pytest.mark.slow_except("?", "??")
@pytest.mark.parametrize("seed", range(150))
def test_any_damage_is_an_error_or_less_data(run_file, seed):
    rng = random.Random(seed)
    raw = bytearray(run_file.read_bytes()[:9000])
    for _ in range(rng.randint(1, 5)):
        raw[rng.randrange(len(raw))] = rng.randrange(256)
    run_file.write_bytes(raw)
    try:
        run = RunReader(run_file)
        got = [*run.replay(), *run.sent(), *run.commands(), *run.i2c()]
    except RecordingError as error:
        got = [error.what.index(str(run_file))]
    assert isinstance(got, list)


def test_reads_what_another_tool_has_chunked(tmp_path, run_file):
    """`mcap compress` and friends rewrite a file in chunks of their own."""
    from mcap.stream_reader import StreamReader
    from mcap.writer import Writer

    path = tmp_path / "chunked.mcap"
    with path.open("wb") as file, run_file.open("rb") as source:
        writer = Writer(file)
        writer.start("ros2")
        for record in StreamReader(source).records:
            kind = type(record).__name__
            if kind == "Channel":
                writer.register_channel(record.topic, record.message_encoding, 0)
            elif kind == "Message":
                writer.add_message(record.channel_id, record.log_time, record.data,
                                   record.publish_time, record.sequence)
            elif kind == "DataEnd":
                break
        writer.finish()
    assert list(RunReader(path).replay()) == list(RunReader(run_file).replay())


# -- readable without this library ------------------------------------------


def test_the_reference_reader_accepts_the_file(run_file):
    with run_file.open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        assert reader.get_header().profile == "ros2"
        topics = {c.topic: c for c in reader.get_summary().channels.values()}
        assert {"/rx", "/tx", "/i2c", "/command", "/odom", "/imu", "/drive"} <= set(topics)
        assert {c.message_encoding for c in topics.values()} == {"cdr"}
        for schema, channel, message in reader.iter_messages():
            assert schema.encoding == "ros2msg"
            assert message.log_time == message.publish_time
            if channel.topic == "/rx":
                (length,) = struct.unpack_from("<I", message.data, 12)
                assert length == len(message.data) - 16


def test_odometry_matches_its_definition(run_file, state):
    got = list(decode_messages(run_file, "/odom"))[3]
    s = state(3)
    assert got["header.stamp.sec"] + got["header.stamp.nanosec"] * 1e-9 == pytest.approx(s.t)
    assert (got["header.frame_id"], got["child_frame_id"]) == ("odom", "base_link")
    assert got["pose.pose.position.x"] == s.pose.x
    w = got["pose.pose.orientation.w"]
    z = got["pose.pose.orientation.z"]
    assert 2 * math.atan2(z, w) == pytest.approx(s.pose.yaw)
    assert got["twist.twist.linear.x"] == s.speed
    assert got["twist.twist.angular.z"] == s.yaw_rate
    assert got["twist.covariance"][0] == pytest.approx(s.speed_std**2)


def test_covariance_sits_where_ros_expects_it(tmp_path, state):
    import numpy as np

    from dart_hal.core.types import Pose

    cov = np.array([[1.0, 2, 3], [2, 4, 5], [3, 5, 6]])
    with RunWriter(tmp_path / "r.mcap") as writer:
        writer.state(state(0, pose=Pose(0, 0, 0, cov)))
    got = np.array(next(decode_messages(tmp_path / "r.mcap",
                                        "/odom"))["pose.covariance"]).reshape(6, 6)
    assert (got[np.ix_([0, 1, 5], [0, 1, 5])] == cov).all()


def test_imu_and_drive_match_their_definitions(run_file, state):
    got = next(decode_messages(run_file, "/imu"))
    s = state(0)
    assert got["angular_velocity.z"] == s.yaw_rate
    assert (got["linear_acceleration.x"], got["linear_acceleration.y"]) == (-0.25, 0.5)
    assert got["orientation_covariance"][0] == -1.0
    got = next(decode_messages(run_file, "/drive"))
    assert got["drive.steering_angle"] == pytest.approx(0.1)


def test_no_imu_no_message(tmp_path, state):
    with RunWriter(tmp_path / "r.mcap") as writer:
        writer.state(state(0, yaw_rate=None, accel_x=None, accel_y=None))
    assert list(decode_messages(tmp_path / "r.mcap", "/imu")) == []
    assert len(list(decode_messages(tmp_path / "r.mcap", "/odom"))) == 1


def test_raw_bytes_commands_and_pulses_follow_their_definitions(run_file, frame_of):
    got = list(decode_messages(run_file, "/rx"))[1]
    assert bytes(got["data"]) == frame_of(0, 0)
    assert list(decode_messages(run_file, "/command"))[1] == {
        "steering": 0.05, "throttle": 0.5, "source": "user"}
    assert list(decode_messages(run_file, "/applied"))[1] == {
        "steering": 0.05, "throttle": 0.25, "steering_us": 1505.0, "throttle_us": 1612.5,
        "limited": ["RANGE"]}


ANY_TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=9)
ANY_NUMBER = st.floats(allow_nan=False)


@given(st.binary(max_size=80), ANY_NUMBER, ANY_TEXT, st.lists(ANY_TEXT, max_size=4))
@pytest.mark.slow
def test_cdr_inverses(data, value, text, texts):
    assert cdr.decode_byte_array(cdr.encode_byte_array(data)) == data
    assert cdr.decode_command(cdr.encode_command(value, -value, text)) == (value, -value, text)
    pulses = Applied(value, 0.5, 1500.0, 1600.0, tuple(texts))
    assert cdr.decode_applied(cdr.encode_applied(pulses)) == pulses


@pytest.mark.parametrize("cut", [-1, 1, 9])
def test_a_command_or_pulses_of_another_length_are_refused(cut):
    applied = Applied(0.1, 0.2, 1500.0, 1600.0, ("SLEW", "RANGE"))
    whole = {cdr.decode_command: cdr.encode_command(0.1, 0.2, "user"),
             cdr.decode_applied: cdr.encode_applied(applied)}
    for read, data in whole.items():
        with pytest.raises((ValueError, struct.error)):
            read(data[:-cut] if cut > 0 else data + b"\0")


def test_the_suffix_picks_the_writer(tmp_path):
    for name, kind in (("a.mcap", "RunWriter"), ("a.csv", "CsvWriter"),
                       ("a.dart.csv", "DartCsvWriter")):
        with open_writer(tmp_path / name) as writer:
            assert type(writer).__name__ == kind
    with pytest.raises(RecordingError, match="suffix"):
        open_writer(tmp_path / "a.xlsx")
