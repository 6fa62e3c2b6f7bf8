"""The map of the page of a fleet: cars of one frame, in their colours, all in sight."""

from __future__ import annotations

import json
import time

import pytest

from dart_hal.core.types import START_FRAME
from dart_hal.fleet.station import Station
from dart_lab.live.view.fleet_desk import FleetDesk, FleetPage
from tests.fleet.rooms import FleetPins
from tests.live.view.test_browser_shows import within
from tests.live.view.test_floor import pixels

CAR_NAMES = """
window.shown = [];
Floor.others = ((real) => (list) => { shown = list; real(list); })(Floor.others);
"""
SHOWN_NAMES = "return shown.map((one) => one.name).sort()"
SWATCHES = """
return Object.fromEntries([...document.querySelectorAll('article')].map((one) =>
  [one.dataset.name, getComputedStyle(one.querySelector('i')).backgroundColor]));
"""
CHOICES = "return [...document.querySelectorAll('#frames button')].map((one) => one.textContent)"


def car(name, x=0.0, frame="mocap", state="link", room="local://map"):
    return {"name": name, "room": room, "state": state, "mode": "DISARMED", "why": "",
            "silent": 0.0, "lost": 0, "battery": None, "pose": {
                "x": x, "y": 0.0, "yaw": 0.0, "frame": frame, "own_frame": frame == START_FRAME,
                "speed": 0.0, "age": 0.0}}


@pytest.fixture
def show(browsers, monkeypatch):
    """Show these cars on the page of a fleet in a browser."""
    cars = []
    monkeypatch.setattr(FleetDesk, "batch", lambda self: [json.dumps(
        {"type": "cars", "cars": cars})])
    with Station("local://map") as station, FleetPage([station], 0, lan=False) as page:
        one = browsers()
        one.open(page.urls[0])
        one.run(CAR_NAMES)

        def show_cars(*some):
            cars[:] = some
            within(30.0, lambda: len(one.run(SWATCHES)) >= len(some))
            time.sleep(0.3)
            return one

        yield show_cars


def rgb(text):
    return [int(part) for part in text.partition("(")[2].rstrip(")").split(",")]


@pytest.mark.realtime
@pytest.mark.slow
def test_cars_of_other_frames_are_not_on_the_same_map(show):
    one = show(car("a"), car("b", 1.0), car("c", frame=START_FRAME), car("d", frame=START_FRAME),
               car("e", room="local://other"))
    assert one.run(SHOWN_NAMES) == ["a", "b"]
    assert one.run(CHOICES) == ["mocap: 2 cars", "start of c: 1 car", "start of d: 1 car",
                                "mocap: 1 car"]
    one.driver.find_elements("css selector", "#frames button")[1].click()
    time.sleep(0.3)
    assert one.run(SHOWN_NAMES) == ["c"]
    show(car("a"), car("b", 1.0))
    assert one.run(SHOWN_NAMES) == ["a", "b"], "the chosen frame is gone"
    assert not one["frames"].is_displayed()


@pytest.mark.realtime
@pytest.mark.slow
def test_colours_link_cars_and_cards_and_the_view_fits_all(show):
    one = show(car("a", -20.0), car("b", 0.0), car("c", 20.0))
    swatches = one.run(SWATCHES)
    assert len(set(swatches.values())) == 3
    for name, colour in swatches.items():
        assert pixels(one, rgb(colour)) > 5, name
    one.press("near")
    for _ in range(6):
        one.press("near")
    time.sleep(0.3)
    assert not one["follow"].is_selected()
    assert pixels(one, rgb(swatches["a"])) == 0, "control: by hand the view stays"
    one.press("follow")
    time.sleep(0.3)
    assert pixels(one, rgb(swatches["a"])) > 5


@pytest.mark.slow
def test_the_page_is_told_which_frame_is_of_one_car_alone():
    pins = FleetPins("local://own")
    with Station("local://own", now=lambda: pins.fleet.cars[0].now) as station:
        desk = FleetDesk([station])
        messages = []
        pins.drive(0.5, only=[], each=lambda: messages.extend(map(json.loads, desk.batch())))
        cars = [one for one in messages if one["type"] == "cars"][-1]["cars"]
        assert cars
        assert all(one["pose"]["own_frame"] == (one["pose"]["frame"] == START_FRAME)
                   for one in cars if one["pose"])
        assert any(one["pose"] for one in cars)
    pins.fleet.close()
