"""``dart-hal view``: where the page is served, with which room, camera and other cars."""

from __future__ import annotations

import re

import pytest

from dart_lab.cli import view

MOCK = "sim://?nano=mock&lidar=1&map=room&seed=2"


@pytest.fixture
def served(monkeypatch):
    """What the verb serves, without sockets: the options of ``car.view``."""
    seen = {}

    class Page:
        urls = ("http://localhost:1/#token",)

        def __enter__(self):
            return self

        def __exit__(self, *error):
            pass

        def run(self, duration):
            seen["duration"] = duration

    def serve(car, **options):
        seen.update(options, camera=car.has_camera, url=car.url)
        return Page()

    monkeypatch.setattr(view.Car, "view", serve)
    return seen


def test_a_simulated_car_comes_with_its_room_and_real_time(verb, served):
    told = verb("view", "--url", MOCK, "--camera", "top", "--duration", 1, "--json").json
    assert told == {"urls": ["http://localhost:1/#token"]}
    assert set(served["lines"]) == {"start", "lidar-map"}
    assert served["url"].endswith("pace=1")
    assert served["camera"] is True
    assert (served["drives"], served["others"], served["duration"]) == (True, None, 1.0)


def test_the_other_cars_of_a_room_are_asked_for(verb, served):
    verb("view", "--url", "sim://?nano=mock", "--room", "local://seen", "--json")
    assert served["others"]() == {}
    assert served["lines"] == {}


def test_phones_get_a_picture_of_the_address(verb, served):
    out = verb("view", "--url", "sim://?nano=mock", "--lan", "--duration", 1)
    assert served["lan"] is True
    assert re.search("[█▀▄]{4}", out.out + out.err), "a QR code"
    assert "#token" in out.out + out.err


def test_a_recording_that_is_not_there_is_named(verb):
    assert "no recording" in verb("view", "none.mcap", "--json").error["what"]
