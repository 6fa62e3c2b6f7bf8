"""``dart-hal view``: where the page is served, with which room, camera and other cars."""

from __future__ import annotations

import re

import pytest

from dart_lab.cli import view

MOCK = "sim://?nano=mock&lidar=1&map=room&seed=2"


@pytest.fixture
def capture_options(monkeypatch):
    """What the verb serves, without sockets: the options of ``car.view``."""
    captured = {}

    class Page:
        urls = ("http://localhost:1/#token",)

        def __enter__(self):
            return self

        def __exit__(self, *error):
            pass

        def run(self, duration):
            captured["duration"] = duration

    def serve(car, **options):
        captured.update(options, camera=car.has_camera, url=car.url)
        return Page()

    monkeypatch.setattr(view.Car, "view", serve)
    return captured


@pytest.mark.slow
def test_a_simulated_car_comes_with_its_room_and_real_time(verb, capture_options):
    result = verb("view", "--url", MOCK, "--camera", "top", "--duration", 1, "--json").json
    assert result == {"urls": ["http://localhost:1/#token"]}
    assert set(capture_options["lines"]) == {"start", "lidar-map"}
    assert capture_options["url"].endswith("pace=1")
    assert capture_options["camera"] is True
    assert (capture_options["drives"], capture_options["others"],
            capture_options["duration"]) == (True, None, 1.0)


@pytest.mark.slow
def test_the_other_cars_of_a_room_are_requested(verb, capture_options):
    verb("view", "--url", "sim://?nano=mock", "--room", "local://seen", "--json")
    assert capture_options["others"]() == {}
    assert capture_options["lines"] == {}


@pytest.mark.slow
def test_phones_get_a_picture_of_the_address(verb, capture_options):
    out = verb("view", "--url", "sim://?nano=mock", "--lan", "--duration", 1)
    assert capture_options["lan"] is True
    assert re.search("[█▀▄]{4}", out.out + out.err), "a QR code"
    assert "#token" in out.out + out.err


def test_a_recording_that_is_not_there_is_named(verb):
    assert "no recording" in verb("view", "none.mcap", "--json").error["what"]


@pytest.mark.slow
def test_two_recordings_are_served_and_three_refused(verb, monkeypatch, tmp_path):
    from dart_lab.live.view import player

    served = {}

    class Page:
        urls = ("http://localhost:1/",)

        def __init__(self, run, port, lan, second=None):
            served.update(run=run, second=second)

        def __enter__(self):
            return self

        def __exit__(self, *error):
            pass

    monkeypatch.setattr(player, "Player", Page)
    paths = [tmp_path / f"{n}.mcap" for n in range(2)]
    for n, path in enumerate(paths):
        with view.Car.open(f"sim://?nano=mock&seed={n + 1}", record=path) as car:
            for _ in car.states(duration=0.2 + n):
                pass
    verb("view", *paths, "--duration", 0.1, "--json")
    assert len(served["second"]["rows"]) > len(served["run"]["rows"]) + 50
    verb("view", paths[0], "--duration", 0.1, "--json")
    assert served["second"] is None
    refused = verb("view", *paths, paths[0])
    assert refused.code == 2
    assert "3 recordings" in refused.err
