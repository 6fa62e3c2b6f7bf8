"""Poses as lines, as datagrams and as a CSV file: what is read, and what is refused."""

from __future__ import annotations

import itertools
import math
import os
import socket
import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.car import Car
from dart_hal.core.errors import PortBusy, RecordingError, UsageError
from dart_hal.core.types import Tracking
from dart_hal.devices.poses import open_poses, udp
from dart_hal.devices.poses.line import line, parse
from dart_hal.devices.poses.reading import PoseReading

number = st.floats(-1e6, 1e6)
sigma = st.floats(1e-6, 10.0)
word = st.from_regex(r"[A-Za-z0-9_-]{1,20}", fullmatch=True)


@given(st.builds(PoseReading, word, word, st.floats(0, 2e9), number, number, number, sigma, sigma))
def test_a_line_reads_back_exactly(reading):
    assert parse(line(reading)) == [reading]
    assert parse(line(reading) * 3) == [reading] * 3


@pytest.mark.parametrize("text", [
    b"", b"\n", b"hello", b"dart-hal-pose 2 car room 1 2 3 4", b"dart-hal-pose 1 car room 1 2 3",
    b"dart-hal-pose 1 car room 1 2 3 4 5", b"dart-hal-pose 1 car room nan 2 3 4",
    b"dart-hal-pose 1 car room 1 inf 3 4", b"dart-hal-pose 1 car room 1 -Infinity 3 4",
    b"dart-hal-pose 1 car room 1_0 2 3 4", b"dart-hal-pose 1 car room 1,0 2 3 4",
    b"dart-hal-pose 1 car room 1 2 3 \xff", b"dart-hal-pose 1 car room 1 2 3 4" + b"0" * 300])
def test_what_is_no_line_is_refused(text):
    with pytest.raises(ValueError):
        parse(text)


@given(st.binary(max_size=400))
def test_no_bytes_break_the_parser(data):
    try:
        parse(data)
    except ValueError:
        return


@pytest.fixture
def source():
    opened = open_poses("udp://127.0.0.1:0?body=car")
    yield opened
    opened.close()


def send(source, *datagrams):
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        for data in datagrams:
            out.sendto(data, ("127.0.0.1", source.port))


def test_datagrams_are_reported_once_and_bad_ones_counted(source):
    assert source.poll(1.0) == []
    send(source, b"dart-hal-pose 1 car room 5 1 2 3 0.01 0.02\n", b"rubbish",
         b"dart-hal-pose 1 box room 5 9 9 9\n", b"dart-hal-pose 1 car room 1e12 1 2 3\n",
         b"dart-hal-pose 1 car room 6 1 2 3 0 0.1\n")
    pose, = source.poll(100.0)
    assert (pose.stamp, pose.x, pose.y, pose.yaw, pose.frame) == (5.0, 1.0, 2.0, 3.0, "room")
    assert pose.cov[0, 0] == pytest.approx(1e-4)
    assert pose.cov[2, 2] == pytest.approx(4e-4)
    assert 99.0 < pose.arrival <= 100.0
    assert source.refused == 3
    assert source.others == {"box"}
    assert source.poll(101.0) == []


def test_datagrams_keep_their_order_however_slow_they_are_read(source, monkeypatch):
    for t in range(1, 6):
        send(source, b"dart-hal-pose 1 car room %d 0 0 0\n" % t)
    each_look = itertools.count(time.time_ns() + 10**7, 10**7).__next__  # 10 ms later than the last
    monkeypatch.setattr(udp.time, "time_ns", each_look)
    poses = source.poll(100.0)
    assert [pose.stamp for pose in poses] == [1.0, 2.0, 3.0, 4.0, 5.0]
    assert 0.0 < poses[-1].arrival - poses[0].arrival < 0.01


def test_the_first_body_is_the_car_if_none_is_named():
    source = open_poses("udp://127.0.0.1:0")
    send(source, b"dart-hal-pose 1 red room 5 1 0 0\ndart-hal-pose 1 blue room 5 2 0 0\n")
    assert [p.x for p in source.poll(1.0)] == [1.0]
    assert source.others == {"blue"}
    source.close()


def test_a_port_in_use_is_named(source):
    with pytest.raises(PortBusy, match=str(source.port)):
        open_poses(f"udp://127.0.0.1:{source.port}")


@pytest.mark.parametrize("url", ["", "udp://", "udp://:x", "udp://:99999", "ftp://:1", "udp://:0?a=1",
                                 "udp://:0?units=ft", "udp://:0?turn=left",
                                 "udp://:0?body=a&body=b"])
def test_urls_that_mean_nothing_are_refused(url):
    with pytest.raises(UsageError):
        open_poses(url)


def test_a_file_is_played_in_the_cars_time_in_its_own_units(tmp_path):
    path = tmp_path / "poses.csv"
    path.write_text("t,x,y,yaw\n1000,0,0,0\n1010,1000,500,90\n")
    source = open_poses(f"file://{path}?units=mm&angle=deg&time=ms&hand=left&turn=180")
    first, = source.poll(7.0)
    assert (first.stamp, first.arrival) == (1.0, 7.0)
    assert abs(first.yaw) == pytest.approx(math.pi)
    assert source.poll(7.005) == []
    second, = source.poll(7.02)
    assert (second.x, second.y) == (1.0, -0.5)
    assert second.yaw == pytest.approx(math.pi / 2)
    assert second.arrival == pytest.approx(7.01)


@pytest.mark.parametrize("text", ["", "t,x,y\n0,0,0\n", "t,x,y,yaw\n", "t,x,y,yaw\n0,0,0\n",
                                  "t,x,y,yaw\n0,0,0,nan\n", "t,x,y,yaw\n1,0,0,0\n1,0,0,0\n",
                                  "t,x,y,yaw,z\n0,0,0,0,0\n", "t,x,y,yaw\n0,0,0,a\n"])
def test_a_file_that_is_none_is_refused(tmp_path, text):
    path = tmp_path / "poses.csv"
    path.write_text(text)
    with pytest.raises(RecordingError, match=r"poses\.csv"):
        open_poses(f"file://{path}")


def test_neither_a_missing_file_nor_a_pipe_hangs(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for name in ("pipe", "missing.csv", "."):
        with pytest.raises(RecordingError):
            open_poses(f"file://{tmp_path / name}")


@pytest.mark.slow
def test_a_car_takes_a_source_by_its_url_or_from_the_environment(tmp_path, monkeypatch):
    path = tmp_path / "poses.csv"
    path.write_text("t,x,y,yaw\n" + "".join(f"{0.01 * k:.2f},1,2,0.5\n" for k in range(100)))
    with Car.open("sim://?nano=mock", poses=f"file://{path}") as car:
        given = [s.external.tracking for s in car.states(duration=0.5)]
    monkeypatch.setenv("DART_HAL_POSES", f"file://{path}")
    with Car.open("sim://?nano=mock") as car:
        assert [s.external.tracking for s in car.states(duration=0.5)] == given
    assert given[-1] is Tracking.TRACKING
