"""A listener that blocks, a lock that is held: the stop does not wait for either."""

from __future__ import annotations

import logging
import threading

import pytest

from dart_hal.car import Car
from dart_hal.car.driver import Driver
from dart_hal.cli.common.checks import run_checks
from dart_hal.core.errors import BadCommand
from tests.common import MOCK_URL

pytestmark = pytest.mark.usefixtures("armed_esc")


@pytest.fixture
def car():
    with Car.open(MOCK_URL) as opened:
        yield opened


def arm_and_drive(car: Car) -> Car:
    car.arm()
    for _ in car.states(duration=0.1):
        car.drive(throttle=0.3)
    assert car._engine.driver.actuator.applied.throttle > 0.2
    return car


def test_listeners_are_called_without_the_lock(car):
    """Another thread can stop the car while one of them hangs."""
    acquired = []

    def listener(state):
        def take():
            acquired.append(car._engine._own_lock.acquire(timeout=5))
            car._engine._own_lock.release()

        thread = threading.Thread(target=take)
        thread.start()
        thread.join()

    car.on_state(listener)
    for _ in car.states(duration=0.05):
        pass
    assert acquired
    assert all(acquired)


def test_close_does_not_wait_for_the_holder_of_the_lock(car):
    arm_and_drive(car)
    held = threading.Event()
    let_go = threading.Event()

    def hold():
        with car._engine.lock:
            held.set()
            let_go.wait(30)

    thread = threading.Thread(target=hold)
    thread.start()
    held.wait(5)
    car.close()                                      # would wait for ever
    assert car.mode == "CLOSED"
    assert car._engine.driver.actuator.applied.throttle == 0.0
    let_go.set()
    thread.join()


def test_any_exception_in_a_command_path_trips(car, monkeypatch):
    """Also one of our own: the old command must not run out its time."""
    arm_and_drive(car)

    def broken(*_):
        raise RuntimeError("a disk that is full")

    monkeypatch.setattr(car._engine.driver.actuator._planner.arbiter, "put", broken)
    with pytest.raises(RuntimeError):
        car.drive(throttle=0.4)
    assert car._engine.driver.actuator.applied.throttle == 0.0
    for _ in car.states(duration=0.05):
        pass
    assert car.mode == "TRIPPED"
    assert car.causes == ("COMMAND_INVALID",)


@pytest.mark.slow_except("nan")
@pytest.mark.parametrize("speed", [None, "1", True, float("nan"), 10**400])
def test_a_speed_that_is_no_number_trips(car, speed):
    arm_and_drive(car)
    with pytest.raises(BadCommand, match="speed"):
        car.drive_speed(steering=0.0, speed=speed)
    assert car._engine.driver.actuator.applied.throttle == 0.0


def test_warnings_are_returned_and_logged_once(car, monkeypatch, caplog):
    monkeypatch.setattr(type(car._engine.receiver.hello), "dirty", True)
    with caplog.at_level(logging.WARNING, "dart_hal"):
        names = [c.name for c in car.arm()]
        car.stop()
        assert [c.name for c in car.arm()] == names == ["FIRMWARE_DIRTY"]
    assert [r.getMessage().split(":")[0] for r in caplog.records] == ["FIRMWARE_DIRTY"]


def test_the_doctor_reports_what_arm_warns_of(monkeypatch):
    monkeypatch.setattr("dart_hal.car.identity.Hello.dirty", True)
    found = {c.id: c for c in run_checks(MOCK_URL, "dart-01", None, 1.0)}
    assert found["cautions"].verdict == "warn"
    assert "FIRMWARE_DIRTY" in found["cautions"].found
    assert found["cautions"].remedy


def neutral_after_a_boot(car: Car) -> bool:
    """Whether the bus has neutral in the step in which the state loses its right to drive."""
    engine = car._engine
    for _ in car.states(duration=0.1):
        car.drive(throttle=0.3)
        if not engine._due:                          # between two PWM frames
            break
    assert not engine._due
    with engine.lock:
        engine.driver.on_boot()                      # as the receiver does with a new HELLO
    engine.step(0.0)
    assert car.mode == "DISARMED"
    return engine.driver.actuator.applied.throttle == 0.0


def test_a_boot_does_not_wait_for_the_next_pwm_frame(car):
    assert neutral_after_a_boot(arm_and_drive(car))


def test_without_looking_at_what_is_overdue_it_would(car, monkeypatch):
    """The negative control: the next PWM frame is up to 30 ms away."""
    monkeypatch.setattr(Driver, "overdue", False)
    assert not neutral_after_a_boot(arm_and_drive(car))
