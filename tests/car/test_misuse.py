"""What a program may get wrong with an open car: reported at once, recording or not."""

from __future__ import annotations

import math
import threading

import pytest

from dart_hal.car import Car
from dart_hal.core.errors import BadCommand, LinkLost, UsageError
from tests.common import MOCK_1_URL


@pytest.mark.parametrize("given", [{"duration": math.nan}, {"duration": -1.0},
                                   {"timeout": math.nan}, {"duration": "3"}])
def test_a_time_that_is_none_is_refused(given):
    with Car.open(MOCK_1_URL) as car, pytest.raises(UsageError):
        next(car.states(**given))


@pytest.mark.parametrize("command", [
    lambda car: car.drive(throttle=0.1), lambda car: car.drive_speed(steering=0.0, speed=0.5)])
def test_a_command_after_closing_is_refused(command):
    car = Car.open(MOCK_1_URL)
    car.close()
    with pytest.raises(LinkLost, match="closed"):
        command(car)


@pytest.mark.parametrize("records", [True, False])
@pytest.mark.slow_except("True")
def test_a_note_that_is_not_text_is_refused_recording_or_not(tmp_path, records):
    with Car.open(MOCK_1_URL, record=tmp_path / "run.mcap" if records else None) as car:
        car.note("fine", {"a": "1"})
        with pytest.raises(UsageError, match="not text"):
            car.note("x", {"a": {}})


@pytest.mark.parametrize("wait", [lambda car: car.arm(), lambda car: next(car.states())])
def test_a_listener_that_waits_is_refused(wait):
    with Car.open(MOCK_1_URL) as car:
        remove = car.on_state(lambda state: wait(car))
        with pytest.raises(UsageError, match="a listener waits for a State"):
            next(car.states())
        remove()
        assert next(car.states()).speed == 0.0


@pytest.mark.slow
def test_raw_of_an_armed_car_is_refused():
    with Car.open(MOCK_1_URL) as car:
        car.arm()
        with pytest.raises(UsageError, match="raw\\(\\) of an armed car"), car.raw():
            pass
        assert car.mode == "ARMED"


@pytest.mark.parametrize("name", ["", "run", "run.csv"])
def test_a_recording_is_a_file_that_ends_in_mcap(tmp_path, name):
    with pytest.raises(UsageError, match="an MCAP file"):
        Car.open(MOCK_1_URL, record=tmp_path / name)


@pytest.mark.parametrize("url", ["", "  "])
def test_an_empty_url_is_not_the_default_car(url):
    with pytest.raises(UsageError, match="empty"):
        Car.open(url)


def test_a_url_of_another_type_is_refused():
    with pytest.raises(UsageError, match="is text"):
        Car.open(7)


@pytest.mark.parametrize("name", ["steering", "throttle", "speed", "steer", "lidars"])
def test_an_attribute_that_nothing_reads_is_refused(name):
    """JetRacer and donkeycar drive by ``car.steering = 0.3``."""
    with Car.open(MOCK_1_URL) as car:
        with pytest.raises(AttributeError, match="would do nothing") as refused:
            setattr(car, name, 0.3)
        assert "car.drive(" in str(refused.value)
        car.raise_on_trip = False
        assert car.raise_on_trip is False


def test_a_request_that_the_protocol_does_not_have_is_refused():
    with Car.open(MOCK_1_URL) as car, pytest.raises(UsageError,
                                                    match="no message 'EDGE_REQ'") as why:
        car.request("EDGE_REQ")
    assert "EDGES_REQ" in why.value.remedy


@pytest.mark.parametrize(("command", "shortened"), [
    (lambda car: car.drive(throttle=0.1, valid_for=9.0), True),
    (lambda car: car.drive_speed(steering=0.0, speed=0.3, valid_for=9.0), True),
    (lambda car: car.drive(throttle=0.1, valid_for=0.5), False)])
@pytest.mark.slow
def test_a_command_that_is_valid_for_less_than_requested_is_reported(command, shortened):
    with Car.open(MOCK_1_URL) as car:
        car.arm()
        next(car.states())
        assert ("VALIDITY" in command(car).limited) is shortened


@pytest.mark.slow
def test_a_speed_beyond_the_limit_is_reported():
    with Car.open(MOCK_1_URL) as car:
        car.arm()
        next(car.states())
        assert "RANGE" in car.drive_speed(steering=0.0, speed=99.0).limited
        with pytest.raises(BadCommand):
            car.drive_speed(steering=0.0, speed=math.inf)


def read_in_a_thread(car, n):
    frames = car.states()
    thread = threading.Thread(target=lambda: [next(frames) for _ in range(n)])
    thread.start()
    thread.join()


def test_what_a_loop_loses_to_another_thread_is_counted_and_reported(caplog):
    with Car.open(MOCK_1_URL) as car:
        mine = car.states()
        next(mine)
        for lost in (5, 12):
            read_in_a_thread(car, 5 if lost == 5 else 7)
            assert next(mine).health.skipped == lost
            assert car.timing.skipped == lost
        assert len([r for r in caplog.records if "two threads" in r.message]) == 1


@pytest.mark.slow
def test_a_loop_that_goes_on_in_another_thread_has_lost_nothing(caplog):
    """The control: one after the other is no sharing, nor is arming within a loop."""
    with Car.open(MOCK_1_URL) as car:
        next(car.states())
        read_in_a_thread(car, 5)
        mine = car.states()
        next(mine)
        car.arm()
        assert next(mine).health.skipped == 0
        assert not [r for r in caplog.records if "two threads" in r.message]
