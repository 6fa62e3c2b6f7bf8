"""VRPN by bytes of its published layout: whole, in pieces, damaged, and from silent servers."""

from __future__ import annotations

import socket
import struct
import time
from contextlib import contextmanager

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.core.errors import PortMissing, UsageError
from dart_hal.devices.poses import open_poses
from dart_hal.devices.poses.vrpn import COOKIE, POSE_MESSAGE, Parser

COOKIE_OF_SERVER = b"vrpn: ver. 07.33  0".ljust(24, b"\0")


def message(kind, sender, payload, t=(5, 250_000)):
    head = struct.pack(">IIIiiI", 24 + len(payload), *t, sender, kind, 0)
    return head + payload + b"\0" * (-len(payload) % 8)


def described(kind, number, name):
    text = name.encode() + b"\0"
    return message(kind, number, struct.pack(">I", len(text)) + text)


def pose(sender, place, turned=(0, 0, 0, 1), sensor=0):
    return message(2, sender, struct.pack(">ii3d4d", sensor, 0, *place, *turned))


HELLO = (COOKIE_OF_SERVER + described(-1, 0, "VRPN Control") + described(-1, 1, "car")
         + described(-1, 2, "box") + described(-2, 1, "vrpn_Base ping_message")
         + described(-2, 2, POSE_MESSAGE) + message(1, 1, b""))
STREAM = HELLO + pose(2, (9, 9, 9)) + pose(1, (1, 2, 3)) + pose(1, (4, 5, 6), sensor=1)


def test_a_stream_is_read_however_it_is_cut():
    whole = Parser().feed(STREAM)
    assert [(t.body.name, t.body.position, t.t, t.sensor) for t in whole] == [
        ("box", (9, 9, 9), 5.25, 0), ("car", (1, 2, 3), 5.25, 0), ("car", (4, 5, 6), 5.25, 1)]
    parser = Parser()
    assert [t for k in range(len(STREAM)) for t in parser.feed(STREAM[k:k + 1])] == whole


def test_bytes_that_the_library_itself_sent_are_read():
    """The first message of a client of VRPN 07.38, as recorded on a socket."""
    sent = (b"\0\0\0)k\x05\x17\xed\0\x04\x1b\xee\0\0\0\0\xff\xff\xff\xff\0\0\0\0"
            b"\0\0\0\rVRPN Control\0" + 7 * b"\0")
    assert sent == described(-1, 0, "VRPN Control")[:4] + sent[4:12] + described(
        -1, 0, "VRPN Control")[12:]
    parser = Parser()
    parser.feed(COOKIE_OF_SERVER + sent)
    assert parser.senders == {0: "VRPN Control"}


def read_anything(data):
    """Any bytes raise nothing but ValueError."""
    parser = Parser()
    try:
        parser.feed(data)
    except ValueError:
        return


@given(st.binary(max_size=200))
def test_no_bytes_break_the_parser(data):
    read_anything(data)
    read_anything(COOKIE_OF_SERVER + data)


@given(st.integers(0, len(STREAM) - 4), st.binary(max_size=4))
def test_no_damage_breaks_the_parser(offset, data):
    read_anything(STREAM[:offset] + data + STREAM[offset + 4:])


@pytest.mark.parametrize("data", [b"HTTP/1.1 400", b"vrpn: ver. 06.", COOKIE + b"\xff" * 24,
                                  COOKIE + b"\0" * 24])
def test_another_protocol_is_refused(data):
    with pytest.raises(ValueError, match=r"vrpn|VRPN"):
        Parser().feed(data)


class Clock:
    t = 0.0

    def __call__(self):
        return self.t


@contextmanager
def server(user="car@", options=""):
    """(listening socket, source, its clock)."""
    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.settimeout(1.0)
        source = open_poses(f"vrpn://{user}127.0.0.1:{listening.getsockname()[1]}{options}")
        source._clock = Clock()
        try:
            yield listening, source, source._clock
        finally:
            source.close()


def polled(source):
    """Poses once some have come through the loopback, at most for a second."""
    end = time.monotonic() + 1.0
    while not (out := source.poll(7.0)) and time.monotonic() < end:
        time.sleep(0.001)
    return out


def test_a_tracker_sends_poses_after_the_cookies():
    with server() as (listening, source, _):
        assert source.poll(0.0) == []
        peer, _ = listening.accept()
        with peer:
            source.poll(0.01)
            assert peer.recv(100) == COOKIE
            peer.sendall(STREAM)
            found, = polled(source)
            assert (found.stamp, found.arrival, found.x, found.y, found.yaw) == (5.25, 7.0, 1, 2, 0)
            assert (source.others, source.why) == ({"box", "car, sensor 1"}, "")
            peer.sendall(pose(1, (0, 0, 0), (0, 0, 0, 0)) + pose(1, (7, 7, 7)))
            assert [p.x for p in polled(source)] == [7.0]
            assert source.refused == 1


def test_it_connects_again_and_reports_the_reason():
    with server("", "?body=car&sensor=1") as (listening, source, clock):
        source.poll(0.0)
        peer, _ = listening.accept()
        peer.close()
        polled_until(source, "onnection")
        source.poll(0.0)  # not at once
        clock.t = 1.5
        source.poll(0.0)
        peer, _ = listening.accept()
        with peer:
            peer.sendall(STREAM)
            assert [p.x for p in polled(source)] == [4.0]
            before, clock.t = source.connections, 7.0
            source.poll(0.0)  # silent for too long
            listening.accept()[0].close()
            assert source.connections == before + 1
            polled_until(source, "onnection")
        listening.close()
        clock.t = 9.0
        source.poll(0.0)
        polled_until(source, "refused")


def polled_until(source, word):
    end = time.monotonic() + 1.0
    while word not in source.why and time.monotonic() < end:
        assert source.poll(0.0) == []
    assert word in source.why


@pytest.mark.parametrize("url", ["vrpn://", "natnet://", "vrpn://car@h?body=a", "vrpn://h?sensor=x",
                                 "vrpn://h?angle=deg", "natnet://h?up=x", "natnet://h:x"])
def test_urls_that_mean_nothing_are_refused(url):
    with pytest.raises(UsageError):
        open_poses(url)


def test_a_host_that_is_not_there_is_named():
    with pytest.raises(PortMissing, match=r"no-such-host\.invalid"):
        open_poses("vrpn://car@no-such-host.invalid")
