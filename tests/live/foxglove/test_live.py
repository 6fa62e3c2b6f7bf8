"""The live server: what clients see, and that none of them touches the drive."""

from __future__ import annotations

import json
import random
import socket
import struct
import threading
from itertools import pairwise

import numpy as np
import pytest
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory
from websockets.exceptions import ConnectionClosed, InvalidStatus

from dart_hal.core.errors import UsageError
from dart_lab.live.foxglove.server import MAX_BACKLOG_BYTES, serve

pytestmark = pytest.mark.realtime


def test_a_client_sees_every_channel_and_decodes_what_it_subscribes_to(shown_car):
    with shown_car.client() as client:
        assert client.socket.subprotocol == "foxglove.websocket.v1"
        assert client.info["op"] == "serverInfo"
        assert client.info["capabilities"] == []
        assert {"/rx", "/tx", "/command", "/applied", "/odom", "/imu", "/drive"} <= set(
            client.channels)
        client.subscribe("/odom", "/applied")
        heard = client.hear(0.5)
        odom = client.channels["/odom"]
        decode = DecoderFactory().decoder_for("cdr", Schema(
            id=1, name=odom["schemaName"], encoding=odom["schemaEncoding"],
            data=odom["schema"].encode()))
        messages = [(ns, decode(raw)) for _, number, ns, raw in heard if number == 0]
        assert len(messages) > 30, "of 50"
        for ns, message in messages:
            assert message.header.stamp.sec * 10**9 + message.header.stamp.nanosec == ns
        stamps = [ns for ns, _ in messages]
        assert stamps == sorted(stamps)
        assert max(b - a for a, b in pairwise(stamps)) < 0.015e9, "all"


def test_what_the_program_logs_is_advertised_when_it_comes(shown_car):
    with shown_car.client() as client:
        assert "/log/gain" not in client.channels
        shown_car.car.log("gain", 0.5)
        client.hear(0.2)
        client.subscribe("/log/gain")
        client.hear(0.1)
        shown_car.car.log("gain", 2.5)
        assert struct.unpack("<4sd", client.hear(0.3)[-1][3])[1] == 2.5


def test_who_unsubscribes_hears_no_more(shown_car):
    with shown_car.client() as client:
        client.subscribe("/odom")
        assert client.hear(0.2)
        client.send(op="unsubscribe", subscriptionIds=[0])
        client.hear(0.2)
        assert client.hear(0.2) == []


def test_a_page_of_somebody_else_is_refused(shown_car):
    for origin in ("https://evil.example", "null", "http://localhost.evil.example"):
        with pytest.raises(InvalidStatus, match="403"), shown_car.client(origin=origin):
            pass
    with shown_car.client(origin="https://app.foxglove.dev") as client:
        assert client.channels


def test_read_only_means_that_no_client_drives(shown_car):
    before = shown_car.car.recorder.trouble, shown_car.car.mode
    with shown_car.client() as client:
        client.advertise(1, "/cmd_vel")
        assert "read-only" in client.last_status()
        client.publish(1, {"linear": {"x": 1.0}, "angular": {"z": 0.0}})
        assert "read-only" in client.last_status()
    assert (shown_car.car.recorder.trouble, shown_car.car.mode) == before


def junk(rng):
    """Text and bytes that no client should send."""
    op = rng.choice(["subscribe", "unsubscribe", "advertise", "unadvertise", "ping", "", None, 7])
    value = rng.choice([None, [], {}, -1, 2**70, 1e400, "x" * rng.randrange(2000), [[]], [None],
                        [{"id": -1, "channelId": 1}], [{"id": {}, "channelId": []}],
                        [{"id": 2**40, "channelId": 2}], [{"id": True, "topic": "/cmd_vel"}]])
    keys = ["subscriptions", "subscriptionIds", "channels", "channelIds"]
    return rng.choice([
        json.dumps({"op": op, rng.choice(keys): value}), json.dumps(value), "{", "[" * 3000,
        bytes(rng.randrange(256) for _ in range(rng.randrange(40))),
        struct.pack("<BI", 1, rng.choice([0, 1, 2**32 - 1])) + b'{"linear":'])


@pytest.mark.slow
def test_fuzzed_messages_are_answered_without_harm(shown_car):
    rng = random.Random(1)
    count = 400
    with shown_car.client() as other, shown_car.client() as client:
        other.subscribe("/odom")
        for _ in range(count):
            client.socket.send(junk(rng))
        assert len(other.hear(0.5)) > 30, "who behaves goes on"
        client.hear(1.0)
        assert len(client.statuses) > count / 2
        assert all(status["op"] == "status" for status in client.statuses)
        assert all(len(status["message"]) < 400 for status in client.statuses)
        client.subscribe("/odom")
        assert client.hear(0.3), "and it can still subscribe"


@pytest.mark.slow
def test_a_client_that_subscribes_and_does_not_read_is_closed(shown_car, monkeypatch):
    monkeypatch.setattr("dart_lab.live.foxglove.server.MAX_BACKLOG_BYTES", 20_000)
    one = Stalled(shown_car.server.port, [])
    with pytest.raises(OSError, match=r"reset|pipe"):
        one.ask(10**6)
    with shown_car.client() as client:
        client.subscribe("/odom")
        assert client.hear(0.3), "the others stay"


def test_a_huge_message_ends_its_connection_alone(shown_car):
    with shown_car.client() as other, shown_car.client() as client:
        client.socket.send("x" * 10**6)
        with pytest.raises(ConnectionClosed, match="1009"):  # message too big
            client.hear(2.0)
        other.subscribe("/odom")
        assert other.hear(0.3)


class Stalled:
    """A client that subscribes to everything and never reads: a socket with a small window."""

    def __init__(self, port, channels):
        self.socket = socket.socket()
        self.socket.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        self.socket.connect(("localhost", port))
        self.socket.sendall("\r\n".join((
            "GET / HTTP/1.1", "Host: localhost", "Upgrade: websocket", "Connection: Upgrade",
            "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==", "Sec-WebSocket-Version: 13",
            "Sec-WebSocket-Protocol: foxglove.websocket.v1", "", "")).encode())
        assert b"101" in self.socket.recv(15)
        text = json.dumps({"op": "subscribe", "subscriptions": [
            {"id": n, "channelId": n} for n in channels]}).encode()
        self.socket.sendall(struct.pack(">BBHI", 0x81, 0xFE, len(text), 0) + text)

    def ask(self, times):
        """Text that is no JSON is answered each time."""
        for _ in range(times):
            self.socket.sendall(struct.pack(">BBI", 0x81, 0x80 | 100, 0) + b"{" * 100)


def share_received(client, seconds):
    """Of the States that there were."""
    stamps = [ns for _, _, ns, _ in client.hear(seconds)]
    return (len(stamps) - 1) / ((stamps[-1] - stamps[0]) / 10e6)


@pytest.mark.slow
def test_a_stalled_client_delays_no_other(shown_car):
    """What it does not read is 20 MB."""
    with shown_car.client() as client:
        shown_car.car.log("bulk", np.zeros(100_000))
        client.hear(0.2)
        client.subscribe("/odom")
        numbers = [c["id"] for c in client.channels.values()]
        stalled = [Stalled(shown_car.server.port, numbers) for _ in range(3)]
        behind = []
        for _ in range(25):
            shown_car.car.log("bulk", np.zeros(100_000))
            client.hear(0.1)
            behind.append(max(c.queued_bytes for c in shown_car.server._clients))
        taken = shown_car.count
        assert share_received(client, 2.0) > 0.99
        assert shown_car.count - taken > 50, "the program's loop goes on"
        assert max(behind) > 3_000_000, "else none was stalled"
        assert max(behind) <= MAX_BACKLOG_BYTES
        assert any(b < a for a, b in pairwise(behind)), "what it is behind is dropped"
        for one in stalled:
            one.socket.close()


def test_a_port_in_use_is_refused_with_a_sentence(shown_car):
    with pytest.raises(UsageError, match="cannot be served") as refused, serve(
            shown_car.car, port=shown_car.server.port):
        pass
    assert "in use" in refused.value.found
    assert refused.value.remedy == f"--port {shown_car.server.port + 1}"


def test_it_listens_on_this_computer_alone(shown_car):
    """127.0.0.77 is this computer, too, and would be served by who listens everywhere."""
    with socket.socket() as probe, pytest.raises(OSError, match="refused"):
        probe.connect(("127.0.0.77", shown_car.server.port))


def test_a_recorded_car_is_served_too_and_the_end_leaves_no_thread(serving, tmp_path):
    before = threading.active_count()
    with serving(record=tmp_path / "run.mcap") as driven, driven.client() as client:
        client.subscribe("/odom")
        live = {raw for _, _, _, raw in client.hear(0.3)}
    assert threading.active_count() == before
    from dart_hal.recording.run import RunReader

    written = {m.data for m in RunReader(tmp_path / "run.mcap").messages() if m.topic == "/odom"}
    assert live <= written
    assert len(live) > 10
