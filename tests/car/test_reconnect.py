"""The search for an unplugged board, over ptys, in a clock of its own; and where it looks."""

from __future__ import annotations

import os
import random
import tty
from dataclasses import dataclass, field

import pytest

from dart_hal.car.handshake import BOOT_SILENCE, REQUEST_TIME
from dart_hal.car.reconnect import RETRY_TIME, SCAN_INTERVAL, BoardSearch
from dart_hal.devices.links import serial_port
from dart_hal.devices.links.serial_port import candidates
from dart_hal.wire.codec import UP, encode
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import HELLO
from tests.wire.wire_samples import random_values

OURS = 0x1234


class Port:
    """The far end of a serial port."""

    def __init__(self) -> None:
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.device = os.ttyname(slave)
        self._slave = slave
        os.set_blocking(self.master, False)

    def hello(self, board: int) -> bytes:
        any_hello = encode(HELLO, 0, random_values(HELLO, random.Random(1)))
        values = FrameDecoder(UP).feed(any_hello)[0].as_dict()
        frame = encode(HELLO, 0, {**values, "board_id": board})
        os.write(self.master, frame)
        return frame

    def has_request(self) -> bool:
        try:
            return bool(os.read(self.master, 4096))
        except BlockingIOError:
            return False

    def close(self) -> None:
        for fd in (self.master, self._slave):
            os.close(fd)


@dataclass
class Plugged:
    """What ``Backend`` offers to a search."""

    devices: list[str] = field(default_factory=list)
    looks: int = 0

    def candidates(self) -> list[str]:
        self.looks += 1
        return list(self.devices)


@pytest.fixture
def ports():
    made = [Port(), Port()]
    yield made
    for port in made:
        port.close()


def steps(search: BoardSearch, start: float, stop: float):
    """Look each 40 ms of the clock until something is found: (time, found)."""
    now = start
    while now < stop:
        found = search.look(now)
        if found is not None:
            return now, found
        now += 0.04
    return now, None


def test_all_ports_are_listened_to_at_once_and_the_right_board_is_taken(ports):
    silent, right = ports
    plugged = Plugged([silent.device, right.device])
    search = BoardSearch(plugged, OURS, 500_000)
    assert search.look(0.0) is None
    frame = right.hello(OURS)
    when, found = steps(search, 0.04, 1.0)
    assert when <= 0.08, "the silent one is not waited for"
    assert found.received == frame, "nothing that it sent is lost"
    assert found.link.device == right.device
    found.link.close()
    search.close()


def test_another_board_is_let_go_until_it_is_unplugged(ports):
    other, _ = ports
    plugged = Plugged([other.device])
    search = BoardSearch(plugged, OURS, 500_000)
    search.look(0.0)
    other.hello(OURS + 1)
    assert steps(search, 0.04, 20.0)[1] is None
    other.hello(OURS)
    assert steps(search, 20.0, 25.0)[1] is None, "it is not opened again: that would reset it"
    plugged.devices = []
    search.look(30.0)
    plugged.devices = [other.device]
    search.look(31.0)
    other.hello(OURS)
    _, found = steps(search, 31.04, 33.0)
    assert found is not None
    found.link.close()


def test_a_silent_port_is_tried_again_after_its_boot_loader(ports):
    port, _ = ports
    search = BoardSearch(Plugged([port.device]), OURS, 500_000)
    steps(search, 0.0, BOOT_SILENCE - 0.05)
    assert not port.has_request(), "a byte would restart the boot loader's time-out"
    steps(search, BOOT_SILENCE, BOOT_SILENCE + REQUEST_TIME + 0.2)
    assert port.has_request()
    again = BOOT_SILENCE + REQUEST_TIME + RETRY_TIME + 0.4
    steps(search, BOOT_SILENCE + REQUEST_TIME + 0.2, again)
    port.hello(OURS)
    _, found = steps(search, again, again + 1.0)
    assert found is not None
    found.link.close()


def test_looking_at_what_is_plugged_in_is_seldom():
    plugged = Plugged()
    steps(BoardSearch(plugged, OURS, 500_000), 0.0, 10.0)
    assert plugged.looks <= 10.0 / SCAN_INTERVAL + 1


def test_a_port_that_is_not_there_or_not_ours_yet_is_tried_at_the_next_look(ports):
    port, _ = ports
    plugged = Plugged([port.device, "/dev/pts/no-such-port"])
    holder = serial_port.SerialLink(port.device)
    search = BoardSearch(plugged, OURS, 500_000)
    assert steps(search, 0.0, 1.0)[1] is None
    holder.close()
    search.look(1.25)
    port.hello(OURS)
    _, found = steps(search, 1.29, 2.0)
    assert found is not None
    found.link.close()


@dataclass
class Usb:
    device: str
    vid: int | None
    pid: int | None


def test_candidates_are_of_the_same_bridge_and_no_other(monkeypatch, tmp_path):
    """A lidar on another port must not be opened."""
    there = [Usb("/dev/ttyUSB0", 0x1A86, 0x7523), Usb("/dev/ttyUSB1", 0x10C4, 0xEA60)]
    monkeypatch.setattr(serial_port.list_ports, "comports", lambda: list(there))
    present = candidates("/dev/ttyUSB0", None)
    there[0] = Usb("/dev/ttyUSB2", 0x1A86, 0x7523)
    assert present() == ["/dev/ttyUSB2"]
    there.append(Usb("/dev/ttyUSB3", 0x1A86, 0x7523))
    assert present() == ["/dev/ttyUSB2", "/dev/ttyUSB3"]


def test_a_port_without_an_id_is_looked_for_by_its_name(monkeypatch, tmp_path):
    there = [Usb("/dev/ttyS0", None, None)]
    monkeypatch.setattr(serial_port.list_ports, "comports", lambda: list(there))
    name = tmp_path / "nano"
    present = candidates(str(name), None)
    assert present() == []
    name.symlink_to("/dev/null")
    assert present() == [str(name)]


def test_candidates_of_a_pattern(monkeypatch):
    monkeypatch.setattr(serial_port.list_ports, "comports", list)
    monkeypatch.setattr(serial_port.list_ports, "grep",
                        lambda pattern: [Usb("/dev/ttyUSB7", 0x1A86, 0x7523)])
    assert candidates("/dev/ttyUSB0", "1A86:7523")() == ["/dev/ttyUSB7"]
