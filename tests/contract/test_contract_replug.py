"""The Nano's cable comes out and goes in again, as another port: found by its number, disarmed."""

from __future__ import annotations

import os
import signal
import time
from contextlib import nullcontext

import pytest

from dart_hal.car import pump
from dart_hal.core.errors import Disarmed, LinkLost
from tests.common import PROCESS_TIMEOUT_S

pytestmark = pytest.mark.realtime



def drive_until_lost(car, served_car):
    """Pull the cable of a car that drives."""
    for state in car.states(timeout=PROCESS_TIMEOUT_S):
        car.drive(throttle=0.3, valid_for=0.5)
        if state.applied.throttle > 0.1:
            served_car.process.send_signal(signal.SIGUSR1)


def modes_without_throttle(car, answer):
    """Command for a second, and on until disarmed: a machine that stalls trips the car again."""
    modes = []
    for state in car.states(duration=PROCESS_TIMEOUT_S, timeout=PROCESS_TIMEOUT_S):
        with answer:
            car.drive(throttle=0.3)
        assert state.applied.throttle == 0.0
        modes.append(car.mode)
        if len(modes) >= 100 and modes[-1] == "DISARMED":
            break
    return modes


def test_a_car_that_drives_loses_its_cable_and_can_be_armed_when_it_is_back(served_by_name, arm):
    with served_by_name.open() as car:
        arm(car)
        with pytest.raises(LinkLost, match=r"vanished|take bytes"):
            drive_until_lost(car, served_by_name)
        assert car.mode != "ARMED"
        assert served_by_name.is_stopped(), "neutral before it is reported"
        served_by_name.process.send_signal(signal.SIGUSR2)
        assert modes_without_throttle(car, pytest.raises(Disarmed))[-1] == "DISARMED"
        arm(car)
        for state in car.states(duration=0.4, timeout=PROCESS_TIMEOUT_S):
            car.drive(throttle=0.3, valid_for=0.5)


@pytest.mark.slow
def test_it_goes_on_disarmed_under_another_name(served_by_name):
    before = os.readlink(served_by_name.port)
    with served_by_name.open() as car:
        board = car.hello.board_id
        served_by_name.process.send_signal(signal.SIGUSR1)
        with pytest.raises(LinkLost, match=r"vanished|take bytes"):
            list(car.states(duration=PROCESS_TIMEOUT_S, timeout=PROCESS_TIMEOUT_S))
        with pytest.raises(LinkLost, match="no frame"):
            next(car.states(timeout=0.2))
        assert car.drive(throttle=0.3).throttle == 0.0
        served_by_name.process.send_signal(signal.SIGUSR2)
        next(car.states(timeout=PROCESS_TIMEOUT_S))
        assert os.readlink(served_by_name.port) != before
        assert car.hello.board_id == board
        assert modes_without_throttle(car, nullcontext())[-1] == "DISARMED"
        assert served_by_name.is_stopped()


@pytest.mark.slow
def test_another_board_in_its_place_is_not_taken(served_by_name, monkeypatch):
    """The control: what makes it the same car is the number in HELLO, not the name."""
    real = pump.BoardSearch
    monkeypatch.setattr(pump, "BoardSearch",
                        lambda backend, board, baud: real(backend, board ^ 1, baud))
    with served_by_name.open() as car:
        served_by_name.process.send_signal(signal.SIGUSR1)
        with pytest.raises(LinkLost, match=r"vanished|take bytes"):
            list(car.states(duration=PROCESS_TIMEOUT_S, timeout=PROCESS_TIMEOUT_S))
        served_by_name.process.send_signal(signal.SIGUSR2)
        with pytest.raises(LinkLost, match="no frame"):
            next(car.states(timeout=4.0))


@pytest.mark.slow
def test_waiting_for_a_cable_is_no_busy_loop(served_by_name):
    """Steps of the search and frames of the pins in a second, not processor time."""
    with served_by_name.open() as car:
        served_by_name.process.send_signal(signal.SIGUSR1)
        with pytest.raises(LinkLost, match=r"vanished|take bytes"):
            list(car.states(duration=PROCESS_TIMEOUT_S, timeout=PROCESS_TIMEOUT_S))
        counters = car._engine.driver.actuator.counters
        begin = time.monotonic()
        frames = counters.frames
        time.sleep(1.0)
        rate = (counters.frames - frames) / (time.monotonic() - begin)
        assert rate <= 1.1 / pump.REFRESH_INTERVAL
        assert car._engine.driver._guard.age is not None, "and the guard is beaten meanwhile"
