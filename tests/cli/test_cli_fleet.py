"""``dart-hal fleet`` in a room of this computer: who is there, and one command that stops them."""

from __future__ import annotations

import json
import socket
import threading
import time
from importlib.util import find_spec
from io import StringIO

import pytest

from dart_hal.car import Car, join
from dart_hal.cli.main import main
from dart_hal.core.errors import Disarmed
from dart_hal.devices.links.base import open_backend
from dart_lab.sim.truth import world_of


def free_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


KEY_TEXT = "4f7c" * 16


class FleetCar:
    """An emulated car that drives in a thread, no faster than real time, in a room over UDP.

    It waits for its program: a busy computer makes it slow and trips nothing.
    """

    def __init__(self, *, arm, key=None, answers=True):
        port = free_port()
        station = free_port()
        backend = open_backend("sim://?nano=mock&seed=1")
        self.pulses, self.world, self.disarmed = [], world_of(backend), None
        self.world.watchers.append(
            lambda channel, pulse: self.pulses.append(pulse) if channel == 1 else None)
        self.room = f"udp://127.0.0.1:{station}?to=127.0.0.1:{port}"
        self.car = Car.over(backend)
        to = 9 if answers else station  # a program that is in no list is answered
        self.member = join(self.car, f"udp://127.0.0.1:{port}?to=127.0.0.1:{to}", name="red",
                           room_key=key)
        if arm:
            self.car.arm()
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self):
        begin = time.monotonic() - self.car.now
        for _ in self.car.states():
            if self._ended.wait(max(begin + self.car.now - time.monotonic(), 0.0)):
                return
            try:
                self.car.drive(throttle=0.25)
            except Disarmed as why:
                self.disarmed = self.disarmed or (self.world.t, why)

    def last_driving(self):
        return max((fall for rise, fall in self.pulses if abs(fall - rise - 1.5e-3) > 5e-6),
                   default=0.0)

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self._ended.set()
        self._thread.join()
        self.member.close()
        self.car.close()


def run_verb(capsys, *args):
    with pytest.raises(SystemExit) as status:
        main(list(args))
    return status.value.code, json.loads(capsys.readouterr().out)


@pytest.mark.realtime
def test_a_car_is_listed(capsys):
    with FleetCar(arm=False) as driven:
        code, result = run_verb(capsys, "fleet", "--room", driven.room, "--json")
    assert code == 0
    (car,) = result["cars"]
    assert (car["name"], car["state"], car["url"]) == ("red", "DISARMED", driven.room)
    assert car["pose"]["frame"] == "start"


@pytest.mark.realtime
@pytest.mark.slow
@pytest.mark.parametrize("key", [None, KEY_TEXT], ids=["no key", "key"])
def test_one_command_stops_it_at_the_pin(capsys, tmp_path, key):
    options = []
    if key is not None:
        (tmp_path / "room.key").write_text(key)
        options = ["--room-key", str(tmp_path / "room.key")]
    with FleetCar(arm=True, key=None if key is None else tmp_path / "room.key") as driven:
        time.sleep(0.5)
        before = driven.world.t
        assert driven.last_driving() > before - 0.1, "control: it drives, and the pin is observed"
        code, result = run_verb(capsys, "fleet", "stop", "--room", driven.room, *options, "--json")
        time.sleep(0.3)
        assert driven.disarmed is not None
        at, why = driven.disarmed
        assert why.causes == ("RUN_STOP",)
        assert driven.last_driving() <= at + 0.05
    assert code == 0
    assert result == {"stopped": ["red"], "silent": [], "missing": 0}


@pytest.mark.realtime
@pytest.mark.slow
def test_a_car_that_died_before_is_missed_by_its_number(capsys):
    with FleetCar(arm=False) as driven:
        code, result = run_verb(capsys, "fleet", "stop", "--room", driven.room, "--expect", "2",
                                "--json")
    assert (code, result["stopped"], result["missing"]) == (1, ["red"], 1)


@pytest.mark.realtime
@pytest.mark.slow
def test_a_watch_ends_by_itself_and_names_who_was_there(capsys):
    with FleetCar(arm=False) as driven:
        _, result = run_verb(capsys, "fleet", "watch", "--room", driven.room, "--duration", "0.8",
                           "--json")
    assert [car["name"] for car in result["cars"]] == ["red"]


def test_an_empty_room_is_an_answer(capsys, monkeypatch):
    monkeypatch.setattr("dart_hal.cli.fleet.LISTEN_TIME_S", 0.05)
    code, result = run_verb(capsys, "fleet", "--room", f"udp://:{free_port()}?to=127.0.0.1:9",
                          "--json")
    assert (code, result) == (1, {"cars": []})


@pytest.mark.slow
def test_a_stop_in_an_empty_room_misses_no_number(capsys):
    """It fails because nothing was stopped; without ``--expect`` no car is counted as missing."""
    room = ["--room", f"udp://:{free_port()}?to=127.0.0.1:9", "--json"]
    assert run_verb(capsys, "fleet", "stop", *room) == (
        1, {"stopped": [], "silent": [], "missing": 0})
    assert run_verb(capsys, "fleet", "stop", "--expect", "2", *room) == (
        1, {"stopped": [], "silent": [], "missing": 2})


@pytest.mark.skipif(find_spec("zeroconf") is not None, reason="zeroconf is installed")
def test_without_zeroconf_a_room_must_be_named(capsys, monkeypatch):
    monkeypatch.delenv("DART_HAL_ROOM", raising=False)
    code, result = run_verb(capsys, "fleet", "--json")
    assert code == 2
    assert "zeroconf" in result["error"]["what"]


@pytest.mark.realtime
@pytest.mark.slow
@pytest.mark.skipif(find_spec("zeroconf") is None,
                    reason="needs zeroconf: pip install 'dart-hal[fleet]'")
def test_a_room_that_announces_itself_is_found():
    from dart_hal.fleet.discovery import Announcement, discover_rooms

    room = f"udp://127.0.0.1:{free_port()}?to=127.0.0.1:9"
    announcement = Announcement("red", room)
    try:
        assert discover_rooms(2.0).get("red") == room
    finally:
        announcement.close()


def test_without_a_key_it_is_stated_what_others_can_do(capsys, monkeypatch, tmp_path):
    monkeypatch.setattr("dart_hal.cli.fleet.LISTEN_TIME_S", 0.05)
    room = f"udp://:{free_port()}?to=127.0.0.1:9"
    with pytest.raises(SystemExit):
        main(["fleet", "--room", room])
    assert "keep a watched car driving" in capsys.readouterr().err
    (tmp_path / "room.key").write_text(KEY_TEXT)
    with pytest.raises(SystemExit):
        main(["fleet", "--room", room, "--room-key", str(tmp_path / "room.key")])
    assert "without a key" not in capsys.readouterr().err


def test_a_key_that_is_missing_ends_the_verb(capsys, tmp_path):
    code, result = run_verb(capsys, "fleet", "--room", "udp://:7447?to=127.0.0.1:9", "--room-key",
                          str(tmp_path / "missing"), "--json")
    assert code == 2
    assert result["error"]["code"] == "D-USE-01"
    assert "missing" in result["error"]["what"]


@pytest.mark.realtime
def test_a_car_with_a_key_is_named_to_a_watcher_without(capsys):
    from dart_hal.fleet.key import RoomKey

    with FleetCar(arm=False, key=RoomKey(KEY_TEXT.encode()), answers=False) as driven:
        code, result = run_verb(capsys, "fleet", "--room", driven.room, "--json")
    assert (code, result["cars"]) == (1, [])
    assert "signed" in result["ignored"]["red"]


@pytest.mark.parametrize("name", ["[bold red]x", "[/]", "[link=file:///etc]x[/link]"])
def test_a_name_from_the_network_is_no_markup(name):
    """It is shown as it is, in the table and in the list of ignored members."""
    from rich.console import Console

    from dart_hal.cli.fleet import _make_table
    from dart_hal.fleet import messages as m
    from dart_hal.fleet.codec import encode
    from dart_hal.fleet.station import Station
    from dart_hal.fleet.transports import open_transport

    with Station("local://markup", "base", now=lambda: 1.0) as station:
        line = open_transport("local://markup")
        line.send(encode(m.HEALTH, 9, 1, 1.0, (name, "ARMED", 0, "[red]", "[/]")), 1.0)
        line.send(encode(m.BEAT, 8, 1, 1.0, ("[blink]", ), None)[:2] + b"\x02", 1.0)
        station.look()
        console = Console(width=200, record=True, file=StringIO())
        console.print(_make_table([station]))
        assert name in console.export_text()
        line.close()
