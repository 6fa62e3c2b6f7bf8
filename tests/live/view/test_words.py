"""The page's messages of a trip or a refusal: in words for a person with a phone."""

from __future__ import annotations

import re

import pytest

from dart_hal.car import join
from dart_hal.devices.actuation.arming import REFUSALS
from dart_hal.devices.actuation.trips import TRIPS
from dart_hal.fleet.station import Station
from dart_lab.live.view import messages as m
from dart_lab.live.view import words
from dart_lab.live.view.words import WAIT_FOR_REST, refusal_words, trip_words
from tests.live.view.at_the_desk import AtTheDesk

pytestmark = pytest.mark.usefixtures("armed_esc")
PROGRAMMERS = re.compile(r"\w\(|\)\.|\b(member|car)\.[a-z]+\b(?!toml)|\[[a-z]+\]|car\.toml|"
                         r"waive=|\braw\b|\barm\(")
"""Calls, attributes, keys of files."""


def texts():
    for name in TRIPS:
        yield f"trip {name}", " ".join(trip_words(name, ""))
    for refusal in REFUSALS:
        yield f"refusal {refusal.name}", " ".join(refusal_words(refusal.name, ""))


@pytest.mark.parametrize(("name", "text"), list(texts()))
def test_no_text_of_the_page_speaks_of_calls_or_files(name, text):
    assert PROGRAMMERS.search(text) is None, text
    assert text[0].isupper()
    assert text.endswith(".")
    assert len(text) < 200


def test_control_the_texts_of_the_package_do():
    assert PROGRAMMERS.search(TRIPS["COMMAND_EXPIRED"][1])
    assert sum(PROGRAMMERS.search(refusal.remedy) is not None for refusal in REFUSALS) >= 5


def test_every_name_of_the_page_is_one_of_the_package():
    assert set(words.TRIP_WORDS) <= set(TRIPS)
    assert set(words.REFUSAL_WORDS) <= {refusal.name for refusal in REFUSALS}


def trip_of(desk):
    return [one["trips"] for one in desk.messages if one["type"] == "status" and one["trips"]][-1]


def test_a_stop_at_a_page_is_reported_as_that():
    with AtTheDesk() as desk:
        desk.take_and_arm()
        desk.send_message("two", m.Stop())
        desk.drive(0.4)
        trip = trip_of(desk)
        assert trip["name"] == "RUN_STOP"
        assert trip["text"] == "STOP was pressed at a live page."
        assert trip["remedy"] == "Arm when the way is free."


@pytest.mark.slow_except("stopped")
@pytest.mark.parametrize("stops", [True, False], ids=["stopped", "watcher gone"])
def test_a_stop_of_the_room_is_reported_as_that(stops):
    with AtTheDesk() as desk, join(desk.car, f"local://words-{stops}", name="red",
                                   beat_within=0.3), \
            Station(f"local://words-{stops}", "base", now=desk.now) as station:
        watching = [True]
        leave = desk.car.on_state(lambda state: station.watch() if watching[0] else None)
        desk.take_and_arm()
        if stops:
            station.call_stop("test")
            desk.drive(0.3, lambda t: station.press())
        else:
            watching[0] = False
            desk.drive(0.7)
        expected = "stopped by base" if stops else "the room was not watched for 0.3 s"
        assert trip_of(desk)["text"].startswith(f"Run-stop of the room: {expected}")
        leave()


@pytest.mark.slow
def test_a_program_that_stops_the_car_is_reported():
    with AtTheDesk() as desk:
        desk.take_and_arm()
        desk.car.run_stop(True)
        desk.drive(0.4)
        assert trip_of(desk)["text"] == "The run-stop was pressed by: program."


def coasting(desk):
    """A car at speed that is stopped, and armed at once."""
    desk.take_and_arm()
    desk.drive(2.0, lambda t: desk.hold())
    desk.send_message("two", m.Stop())
    desk.drive(0.1)
    desk.send_message("one", m.Release())
    before = len(desk.list_texts())
    desk.send_message("one", m.Arm())
    desk.drive(3.0)
    return desk.list_texts()[before:]


@pytest.mark.slow
def test_arming_while_the_car_coasts_requests_to_wait():
    """It is no fault: the text names no other cause, and the list of the page no trip."""
    with AtTheDesk(max_throttle=1.0) as desk:
        assert WAIT_FOR_REST in coasting(desk)
        assert not any("Not armed" in text for text in desk.list_texts())
        notes = [one["refusals"] for one in desk.messages if one["type"] == "status"][-1]
        assert {note["name"] for note in notes} <= {"ENCODER_MOVING"}
