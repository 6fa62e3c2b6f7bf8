"""The page of a fleet: what it shows of each car, and its STOP at the pins of all."""

from __future__ import annotations

import json

import pytest

from dart_hal.fleet import messages as beats
from dart_hal.fleet.codec import encode
from dart_hal.fleet.key import RoomKey
from dart_hal.fleet.station import Station
from dart_hal.fleet.stopping import StopRule
from dart_hal.fleet.transports import open_transport
from dart_lab.live.view import messages as m
from dart_lab.live.view.fleet_desk import FleetDesk, FleetPage
from dart_lab.live.view.operator import Refused
from tests.fleet.rooms import FleetPins

pytestmark = pytest.mark.usefixtures("armed_esc")
STOP_WITHIN_S = 0.3


class WatchedRoom:
    """Two emulated cars that drive, and a page that listens."""

    def __init__(self, room):
        self.pins = FleetPins(room)
        self.station = Station(room, now=lambda: self.pins.fleet.cars[0].now)
        self.desk = FleetDesk([self.station])
        self.states = []
        self.texts = []
        self.count = 0

    def look(self):
        self.count += 1
        if self.count % 3:
            return
        for message in map(json.loads, self.desk.batch()):
            if message["type"] == "cars":
                self.states.append({car["name"]: car for car in message["cars"]})
            elif message["type"] == "said":
                self.texts.append(message["text"])

    def drive(self, seconds, **options):
        self.pins.drive(seconds, each=self.look, **options)
        return {name: car["state"] for name, car in self.states[-1].items()}

    def __enter__(self):
        return self

    def __exit__(self, *error):
        self.station.close()
        self.pins.fleet.close()


def stop_room(room="local://page"):
    with WatchedRoom(room) as watched:
        assert set(watched.drive(0.4, only=[]).values()) == {"link"}
        watched.pins.fleet.arm()
        assert set(watched.drive(0.2, only=[]).values()) == {"armed"}
        assert set(watched.drive(0.8).values()) == {"driving"}
        pressed = watched.pins.now()
        assert all(watched.pins.driving(n, t - 0.1) for n, t in enumerate(pressed))
        watched.desk.handle_message("page", m.Stop())
        states = watched.drive(0.6)
        return [watched.pins.last_driving(n, t) for n, t in enumerate(pressed)], states, watched


def test_its_stop_is_at_the_pins_of_all_cars():
    lasts, states, watched = stop_room()
    assert max(lasts) <= STOP_WITHIN_S
    assert set(states.values()) == {"refused"}
    assert all("TRIPPED" in car["mode"] for car in watched.states[-1].values())
    assert watched.texts == ["STOP ALL was pressed", "all cars have answered"]


def test_control_cars_that_do_not_obey_are_detected(monkeypatch):
    monkeypatch.setattr(StopRule, "drive_block", lambda self, now: "")
    lasts, states, _ = stop_room("local://deaf")
    assert max(lasts) > STOP_WITHIN_S
    assert "driving" in states.values()


@pytest.mark.slow
def test_a_car_that_falls_silent_is_lost_within_a_second():
    with WatchedRoom("local://lost") as watched:
        watched.drive(0.4, only=[])
        watched.pins.fleet.members[1].close()
        gone = watched.pins.now()[0]
        while len({car["state"] for car in watched.states[-1].values()}) == 1:
            watched.drive(0.05, only=[])
            assert watched.pins.now()[0] - gone < 1.0
        names = list(watched.states[-1])
        assert watched.states[-1][names[1]]["state"] == "lost"


def test_it_drives_no_car():
    with Station("local://page2") as station:
        desk = FleetDesk([station])
        for message in (m.Take("x"), m.Arm(), m.DriveRequest(0.0, 1.0, 0.0), m.Record(True)):
            with pytest.raises(Refused, match="stops them"):
                desk.handle_message("page", message)


@pytest.mark.realtime
def test_it_is_served():
    from tests.live.view.sockets import join, until

    with Station("local://page3") as station, FleetPage([station], 0, lan=False) as page:
        assert "#" not in page.urls[0]
        with join(page) as socket:
            assert until(socket, "rooms")["rooms"] == ["local://page3"]
            assert until(socket, "cars")["cars"] == []


@pytest.mark.parametrize("key", [None, RoomKey(b"key of the laboratory")], ids=["no key", "key"])
def test_the_page_knows_which_rooms_have_no_key(key):
    with Station("local://page4", room_key=key) as station:
        (rooms,) = map(json.loads, FleetDesk([station]).open_page("page"))
    assert rooms["open"] == ([] if key else ["local://page4"])


def test_the_page_names_members_that_it_ignores():
    with Station("local://page5", "base", now=lambda: 1.0) as station:
        key = RoomKey(b"key of the laboratory")
        line = open_transport("local://page5")
        line.send(encode(beats.BEAT, 9, 1, 1.0, ("red",), key), 1.0)
        texts = [message["text"] for message in map(json.loads, FleetDesk([station]).batch())
                 if message["type"] == "said"]
        line.close()
    assert any("red is ignored" in text and "key" in text for text in texts)
