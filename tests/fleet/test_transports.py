"""Who carries the frames: found by entry point; UDP on this computer; zenoh where it is there."""

from __future__ import annotations

import dataclasses
import socket
import time
from importlib.util import find_spec

import msgspec
import pytest

from dart_hal.car import Car, join
from dart_hal.core.errors import NotArmed, PortBusy, UsageError
from dart_hal.fleet import messages as m
from dart_hal.fleet.key import RoomKey
from dart_hal.fleet.outbox import Outbox
from dart_hal.fleet.peers import Peers
from dart_hal.fleet.transports import open_transport, transports
from tests.fleet.rooms import pose_frame

needs_zenoh = pytest.mark.skipif(find_spec("zenoh") is None,
                                 reason="needs eclipse-zenoh: pip install 'dart-hal[fleet]'")


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def until(condition, seconds=2.0):
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.005)
    return condition()


def test_they_are_entry_points():
    assert {"local", "udp", "zenoh"} <= set(transports())


@pytest.mark.parametrize("text", ["carrier-pigeon://roof", "room"])
def test_an_unknown_transport_is_refused_with_the_known_ones(text):
    with pytest.raises(UsageError) as caught:
        open_transport(text)
    assert "local://" in str(caught.value)
    assert "udp://" in str(caught.value)


@pytest.mark.parametrize("text", [
    "udp://239.255.42.99", "udp://:7447", "udp://:7447?to=10.0.0.1", "udp://:x?to=10.0.0.1:1",
    "udp://239.255.42.99:7447?to=10.0.0.1:1", "udp://239.255.42.99:7447?hops=many",
    "udp://239.255.42.99:7447?lose=1", "local://x?loss=2", "local://x?delay=soon"])
def test_a_url_that_means_nothing_is_refused(text):
    with pytest.raises(UsageError):
        open_transport(text)


KEYS = pytest.mark.parametrize("key", [None, RoomKey(b"key of the laboratory")],
                               ids=["no key", "key"])


def exchange(a, b, key=None):
    """Frames each way, until they came; with a key also until each has proved that it lives."""
    ends = (a, Peers("a", 1, key)), (b, Peers("b", 2, key))
    outboxes = [Outbox(peers, line) for line, peers in ends]
    (_, hears_b), (_, hears_a) = ends
    count = 0

    def both():
        nonlocal count
        count += 1
        now = time.monotonic()
        for (line, peers), name in zip(ends, "ab", strict=True):
            if key is None:
                line.send(pose_frame(count, name=name, boot=peers.boot, sent=line.stamp(now)), now)
            peers.receive(line, now)
        if key is not None:
            for outbox in outboxes:
                outbox.send(m.HEALTH, ("ARMED", 0, "", ""), now)
                outbox.send_heard(now)
        return "b" in hears_b.senders and "a" in hears_a.senders

    return until(both)


@KEYS
def test_udp_to_a_list_of_addresses_and_to_senders(key):
    """The second is not on the first's list: it is answered because it is heard."""
    p = free_port()
    q = free_port()
    a = open_transport(f"udp://127.0.0.1:{p}?to=127.0.0.1:9")
    b = open_transport(f"udp://127.0.0.1:{q}?to=127.0.0.1:{p}")
    try:
        assert exchange(a, b, key)
        a.answer(("127.0.0.1", q))
        assert a._guests.keys() == {("127.0.0.1", q)}
    finally:
        a.close()
        b.close()


@KEYS
def test_udp_multicast_on_one_computer(key):
    url = f"udp://239.255.42.99:{free_port()}?via=127.0.0.1"
    try:
        a = open_transport(url)
        b = open_transport(url)
    except UsageError as why:
        pytest.skip(f"no multicast on this computer: {why.found}")
    try:
        assert exchange(a, b, key)
    finally:
        a.close()
        b.close()


def test_a_missing_network_is_reported_and_not_raised():
    line = open_transport(f"udp://127.0.0.1:{free_port()}?to=192.0.2.1:7447")
    line.send(b"x", 0.0)
    assert "192.0.2.1" in line.trouble
    line.close()


def test_a_port_that_is_taken_is_reported():
    port = free_port()
    first = open_transport(f"udp://127.0.0.1:{port}?to=127.0.0.1:9")
    with pytest.raises(PortBusy):
        open_transport(f"udp://127.0.0.1:{port}?to=127.0.0.1:9")
    first.close()


class Gone:
    """A line that cannot be read any more."""

    url = "gone://"
    trouble = ""

    def stamp(self, now):
        return now

    def send(self, data, now):
        pass

    def poll(self, now):
        raise OSError("network is down")

    def answer(self, source):
        pass

    def close(self):
        pass


def test_a_car_lives_on_without_its_network_and_is_stopped_by_the_silence():
    with Car.open("sim://?nano=mock&seed=1") as car, join(car, Gone(), beat_within=0.2) as member:
        assert len(list(car.states(duration=0.3))) >= 29
        assert "down" in member.transport.trouble
        assert "watched" in member.held
        with pytest.raises(NotArmed) as caught:
            car.arm()
        assert "RUN_STOP" in caught.value.reasons


def test_a_state_that_comes_after_leaving_reads_nothing():
    with Car.open("sim://?nano=mock&seed=1") as car:
        member = join(car, f"udp://127.0.0.1:{free_port()}?to=127.0.0.1:9")
        step = member._step
        state = next(car.states())
        member.close()
        step(state)
        assert member.transport.trouble == ""


@pytest.mark.realtime
@needs_zenoh
@KEYS
def test_zenoh_between_two_sessions(key):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    a = open_transport(f"zenoh://test?listen=tcp/127.0.0.1:{port}")
    b = open_transport(f"zenoh://test?connect=tcp/127.0.0.1:{port}")
    try:
        assert exchange(a, b, key)
    finally:
        a.close()
        b.close()


@pytest.mark.skipif(find_spec("zenoh") is not None, reason="eclipse-zenoh is installed")
def test_without_zenoh_it_names_what_to_install():
    with pytest.raises(UsageError, match="eclipse-zenoh"):
        open_transport("zenoh://room")


def test_cars_of_one_process_share_a_socket_and_each_hears_everything():
    url = f"udp://239.255.42.99:{free_port()}?via=127.0.0.1"
    try:
        ends = [open_transport(url) for _ in range(3)]
    except UsageError as why:
        pytest.skip(f"no multicast on this computer: {why.found}")
    assert len({end._port.socket.fileno() for end in ends}) == 1
    ends[0].send(b"frame", 0.0)
    heard = [[], [], []]

    def all_heard():
        for end, came in zip(ends, heard, strict=True):
            came += [datagram.data for datagram in end.poll(0.0)]
        return all(heard)

    assert until(all_heard)
    assert heard == [[b"frame"]] * 3
    ends[0].close()
    ends[1].send(b"again", 0.0)
    again = []
    assert until(lambda: again.extend(ends[2].poll(0.0)) or again)
    for end in ends:
        end.close()
    late = open_transport(url)
    assert late._port is not ends[0]._port, "the last one closed it"
    late.close()


@pytest.mark.parametrize("name", ["", "x" * 33, "\u00fc" * 17, "a\nb"])
def test_a_name_that_no_message_can_carry_enters_no_room(name):
    with Car.open("sim://?nano=mock&seed=1") as car:
        config = msgspec.structs.replace(car.files.config, name=name)
        car.files = dataclasses.replace(car.files, config=config)
        with pytest.raises(UsageError, match="member of a room"):
            join(car, "local://names")
