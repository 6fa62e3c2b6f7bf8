"""``dart-hal find``: what is plugged in, listed without opening it; and which of it is a car."""

from __future__ import annotations

import os
import random
import threading
import tty
from types import SimpleNamespace

import pytest

from dart_hal.cli import find
from dart_hal.devices.links import attached, computers
from dart_hal.wire.codec import UP, encode
from dart_hal.wire.decoder import FrameDecoder
from dart_hal.wire.messages import HELLO
from tests.wire.wire_samples import random_values


def port(device, vid=0x1A86, pid=0x7523, description="USB2.0-Serial"):
    return SimpleNamespace(device=device, vid=vid, pid=pid, description=description,
                           serial_number=None)


@pytest.fixture
def plug_in(monkeypatch, tmp_path):
    """``plugged(*ports)``: those are here, and I2C buses 1 and 7."""
    for number, name in ((7, "c250000.i2c"), (1, "bcm2835")):
        (tmp_path / "sys" / f"i2c-{number}").mkdir(parents=True)
        (tmp_path / "sys" / f"i2c-{number}" / "name").write_text(name + "\n")

    def plug(*ports):
        monkeypatch.setattr(attached.list_ports, "comports", lambda: list(ports))
        monkeypatch.setattr(find, "i2c_buses", lambda: computers.i2c_buses(tmp_path / "sys"))
        monkeypatch.setattr(attached, "holders", lambda device: iter(()))
        monkeypatch.setattr(find, "computer", lambda: None)

    return plug


class Far:
    """The far end of a port, which sends ``words`` again and again."""

    def __init__(self, words: bytes) -> None:
        self.master, slave = os.openpty()
        tty.setraw(slave)
        self.device = os.ttyname(slave)
        self._slave = slave
        self._words, self._done = words, threading.Event()
        self._thread = threading.Thread(target=self._talk)
        self._thread.start()

    def _talk(self) -> None:
        while not self._done.wait(0.02):
            os.write(self.master, self._words)

    def close(self) -> None:
        self._done.set()
        self._thread.join()
        os.close(self.master)
        os.close(self._slave)


@pytest.fixture
def nano():
    any_hello = encode(HELLO, 0, random_values(HELLO, random.Random(1)))
    values = {**FrameDecoder(UP).feed(any_hello)[0].as_dict(), "board_id": 0xDA27}
    far = Far(encode(HELLO, 0, values))
    yield far.device
    far.close()


def test_with_nothing_plugged_in_it_names_what_to_do(verb, monkeypatch, tmp_path):
    monkeypatch.setattr(attached.list_ports, "comports", list)
    monkeypatch.setattr(find, "i2c_buses", lambda: computers.i2c_buses(tmp_path / "none"))
    result = verb("find", "--json").json
    assert (result["ports"], result["i2c"]) == ([], [])
    assert "plug the Nano in" in result["hints"][0]
    shown = verb("find")
    assert shown.code == 0
    assert "no I2C bus" in shown.out
    assert verb("find", "--probe").code == 1


def test_ports_are_listed_with_their_bridge_and_how_to_know_the_car(verb, plug_in):
    plug_in(port("/dev/ttyS0", None, None, "n/a"), port("/dev/ttyUSB1", 0x1234, 0xABCD, "a thing"),
            port("/dev/ttyUSB0"))
    result = verb("find", "--json").json
    assert set(result) == {"ports", "i2c", "computer", "bus", "hints"}
    assert (result["computer"], result["bus"]) == (None, None), "two buses: a choice"
    assert set(result["ports"][0]) == {"device", "usb", "bridge", "description", "serial_number",
                                       "link", "users", "url", "probe"}
    assert [(p["device"], p["usb"]) for p in result["ports"]] == [
        ("/dev/ttyUSB0", "1A86:7523"), ("/dev/ttyUSB1", "1234:ABCD"), ("/dev/ttyS0", "")]
    assert [(b["number"], b["name"]) for b in result["i2c"]] == [(1, "bcm2835"), (7, "c250000.i2c")]
    assert all(p["probe"] is None for p in result["ports"])
    assert any("unplug" in hint for hint in result["hints"])
    shown = verb("find").out
    assert "CH340" in shown
    assert "a thing" in shown


def test_on_a_known_computer_the_bus_of_its_header_is_reported(verb, plug_in, monkeypatch):
    plug_in(port("/dev/ttyUSB0"))
    orin = next(known for known in computers.COMPUTERS if "Orin" in known.name)
    monkeypatch.setattr(find, "computer", lambda: orin)
    result = verb("find", "--json").json
    assert (result["computer"], result["bus"]) == ("Jetson Orin Nano", 7)
    assert result["ports"][0]["url"] == "serial:///dev/ttyUSB0?i2c=7"
    assert "i2c=7  c250000.i2c  <- header pins 3 and 5 of this Jetson Orin Nano" in verb("find").out


def test_without_probe_no_port_is_opened(verb, plug_in, monkeypatch):
    def refuse_to_open(device):
        raise AssertionError(f"{device} was opened: that restarts its board")

    monkeypatch.setattr(find, "identify_port", refuse_to_open)
    plug_in(port("/dev/ttyUSB0"))
    assert verb("find").code == 0


def test_a_port_in_use_is_never_queried(verb, plug_in, monkeypatch):
    """Root's open would succeed, and restart the Nano under a car that drives."""
    def refuse_to_open(device):
        raise AssertionError(f"{device} was opened")

    plug_in(port("/dev/ttyUSB0"))
    monkeypatch.setattr(find, "identify_port", refuse_to_open)
    monkeypatch.setattr(attached, "holders", lambda device: iter([(4711, "python")]))
    ran = verb("find", "--probe", "--json")
    assert ran.code == 1
    assert ran.json["ports"][0]["users"] == ["python (4711)"]
    assert "in use by python (4711)" in ran.json["ports"][0]["probe"]["why"]


@pytest.mark.realtime
def test_a_nano_is_known_by_its_hello(verb, plug_in, nano):
    plug_in(port(nano), port("/dev/ttyS0", None, None))
    result = verb("find", "--probe", "--json").json
    car, other = result["ports"]
    assert car["probe"]["hello"]["board_id"] == "0000da27"
    assert car["url"] == f"serial://{nano}"
    assert other["probe"] is None, "what is no USB device is not opened"
    shown = verb("find", "--probe")
    assert shown.code == 0
    assert "DART firmware" in shown.out


@pytest.mark.realtime
@pytest.mark.slow
def test_another_board_is_not_taken_for_a_car(verb, plug_in):
    """The negative control: it speaks, but not our language."""
    far = Far(b"hello world\r\n")
    try:
        plug_in(port(far.device))
        ran = verb("find", "--probe", "--json")
    finally:
        far.close()
    assert ran.code == 1
    assert ran.json["ports"][0]["probe"]["hello"] is None
    assert "no DART firmware" in ran.json["ports"][0]["probe"]["why"]


def test_a_port_that_is_gone_is_reported_and_the_others_are_still_listed(verb, plug_in):
    plug_in(port("/dev/ttyUSB_gone"))
    ran = verb("find", "--probe", "--json")
    assert ran.code == 1
    assert "ttyUSB_gone" in ran.json["ports"][0]["probe"]["why"]


def test_the_names_that_stay_are_reported(plug_in, tmp_path):
    device = tmp_path / "ttyUSB0"
    device.touch()
    (tmp_path / "by-id").mkdir()
    (tmp_path / "by-id" / "usb-1a86").symlink_to(device)
    plug_in(port(str(device)))
    (found_port,) = attached.serial_ports(tmp_path / "by-id")
    assert found_port.link == str(tmp_path / "by-id" / "usb-1a86")
