"""NatNet by bytes of its published layout: every version, any damage, a server that is silent."""

from __future__ import annotations

import socket
from contextlib import contextmanager
from math import pi, sqrt

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dart_hal.devices.poses import natnet, open_poses
from tests.devices.poses import natnet_bytes as built

VERSIONS = [(3, 0), (3, 1), (4, 0), (4, 1), (4, 2), (4, 3)]


@pytest.mark.parametrize("version", VERSIONS)
def test_every_version_is_read(version):
    bodies = [built.rigid(4, (1, 2, 3), built.level(0.5)),
              built.rigid(5, (0, 0, 0), built.level(0), tracked=False)]
    kind, payload = natnet.message(built.frame(version, bodies))
    found = natnet.frame(payload, version)
    assert (kind, found.number, found.t, found.exposed) == (7, 7, 12.5, 3 * built.TICKS)
    assert (found.bodies[0].name, found.bodies[0].position, found.lost) == ("4", (1, 2, 3), ("5",))
    assert found.bodies[0].quaternion == pytest.approx(built.level(0.5))
    names = {4: "car", 5: "box"}
    assert natnet.models(natnet.message(built.models(version, names))[1], version) == {
        "4": "car", "5": "box"}
    info = natnet.server(natnet.message(built.server_info(version, group="239.255.42.99"))[1])
    assert info == natnet.Server("Motive", version, built.TICKS, 1511, "239.255.42.99")


@pytest.mark.parametrize("version", [(2, 10), (5, 0)])
def test_a_version_that_is_not_read_is_named(version):
    with pytest.raises(ValueError, match=r"3\.0 to 4\.x are read"):
        natnet.server(natnet.message(built.server_info(version))[1])


def read_anything(data, version):
    """Any bytes raise nothing but ValueError."""
    for read in (natnet.server, lambda b: natnet.frame(b, version),
                 lambda b: natnet.models(b, version)):
        try:
            read(natnet.message(data)[1])
        except ValueError:
            continue


@given(st.binary(max_size=400), st.sampled_from(VERSIONS))
def test_no_bytes_break_the_parser(data, version):
    read_anything(data, version)


@given(st.data(), st.sampled_from(VERSIONS))
def test_no_damage_breaks_the_parser(data, version):
    good = data.draw(st.sampled_from([
        built.frame(version, [built.rigid(4, (1, 2, 3), built.level(0.5))] * 2),
        built.models(version, {4: "car"}), built.server_info(version)]))
    at = data.draw(st.integers(0, len(good) - 4))
    read_anything(good[:at] + data.draw(st.binary(max_size=4)) + good[at + 4:], version)
    read_anything(good[:at], version)


class Motive:
    """A server with one socket that sends only the messages of a test."""

    def __init__(self):
        self.socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self.socket.bind(("127.0.0.1", 0))
        self.socket.settimeout(1.0)
        self.port = self.socket.getsockname()[1]
        self.client = None

    def requests(self):
        data, self.client = self.socket.recvfrom(1000)
        return natnet.message(data)

    def send(self, *messages):
        for data in messages:
            self.socket.sendto(data, self.client)


@contextmanager
def motive(options):
    server = Motive()
    source = open_poses(f"natnet://127.0.0.1:{server.port}{options}")
    try:
        yield server, source
    finally:
        source.close()
        server.socket.close()


def met(server, source, version=(4, 1)):
    """The handshake of a unicast."""
    assert source.poll(0.0) == []
    assert server.requests() == (natnet.CONNECT, b"Ping\0")
    server.send(built.server_info(version))
    assert source.poll(0.1) == []
    source.poll(0.2)
    assert [server.requests()[0] for _ in range(2)] == [natnet.REQUEST_MODELS, natnet.KEEP_ALIVE]


@pytest.mark.parametrize("version", [(3, 1), (4, 2)])
def test_the_selected_body_is_reported_and_losses_are_counted(version):
    with motive("?body=car&up=y&units=mm&turn=90") as (server, source):
        met(server, source, version)
        flat = (0.0, sqrt(0.5), 0.0, sqrt(0.5))  # a quarter turn about the y that points up
        car = built.rigid(4, (1000, 20, -500), flat)
        box = built.rigid(5, (0, 0, 0), built.level(0))
        server.send(built.models(version, {4: "car", 5: "box"}),
                    built.frame(version, [box, car], number=7),
                    built.frame(version, [built.rigid(4, (0, 0, 0), flat, tracked=False)], 8),
                    b"rubbish", built.frame(version, [car], number=11, exposed=0))
        first, second = source.poll(100.0)
        assert (first.x, first.y, first.stamp, second.stamp) == (1.0, 0.5, 3.0, 12.5)
        assert abs(first.yaw) == pytest.approx(pi, abs=1e-6)  # 90 deg, and the 90 of turn
        assert 99.0 < first.arrival <= 100.0
        assert (source.refused, source.missed, source.untracked) == (1, 2, 1)
        assert (source.others, source.why) == ({"box"}, "")


def test_a_silent_server_and_a_missing_body_are_reported():
    with motive("?body=car") as (server, source):
        assert [source.poll(t) for t in (0.0, 0.1)] == [[], []]
        assert "has not answered" in source.why
        server.requests()
        server.send(built.server_info())
        source.poll(0.2)
        server.send(built.models((4, 1), {5: "box"}),
                    built.frame((4, 1), [built.rigid(5, (0, 0, 0), built.level(0))]))
        assert source.poll(0.3) == []
        assert "'car'" in source.why
        assert "box" in source.why


def test_the_error_of_an_upright_body_names_the_axis():
    with motive("") as (server, source):
        met(server, source)
        up = (0.0, -sqrt(0.5), 0.0, sqrt(0.5))
        server.send(built.frame((4, 1), [built.rigid(4, (0, 0, 0), up)]))
        assert source.poll(0.3) == []
        assert "up=y" in source.why


def test_the_multicast_group_of_the_server_is_joined():
    with motive("") as (server, source), socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out:
        source.poll(0.0)
        server.requests()
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as free:
            free.bind(("", 0))
            port = free.getsockname()[1]
        group = "239.255.42.99"
        server.send(built.server_info(port=port, group=group))
        source.poll(0.1)
        if "cannot join" in source.why:
            pytest.skip(source.why)
        out.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, socket.inet_aton("127.0.0.1"))
        out.sendto(built.frame((4, 1), [built.rigid(4, (1, 2, 0), built.level(0))]), (group, port))
        assert [(p.x, p.y) for p in source.poll(0.2)] == [(1.0, 2.0)]
