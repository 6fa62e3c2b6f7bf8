"""What a guard that has tripped does to the car that it guards."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from dart_hal.car import Car
from dart_hal.car.guarding import Hang
from dart_hal.core.types import Applied
from dart_hal.devices.actuation.pca9685 import NEUTRAL_FRAMES
from tests.car.pin_witness import no_pulse


class Guard:
    """In the place of ``GuardPost``: it has noticed a hang of this program, or has not.

    ``at_close``: what it does to the bus when the car ends it.
    """

    age = 0.0

    def __init__(self, tripped: bool = False,
                 at_close: Callable[[], object] = lambda: None) -> None:
        self.tripped = tripped
        self.writes = False
        self.at_close = at_close
        self.closed_at_neutral: bool | None = None
        self.beats: list[tuple[bool, bool]] = []

    def beat(self, *, at_neutral: bool, off: bool = False) -> None:
        """Nothing is acknowledged here."""
        self.beats.append((at_neutral, off))

    def close(self, *, at_neutral: bool) -> None:
        """Nothing runs."""
        self.closed_at_neutral = at_neutral
        self.at_close()


@pytest.mark.slow_except("True-0.2", "False-0.0")
@pytest.mark.parametrize("throttle", [0.0, 0.2])
@pytest.mark.parametrize("tripped", [True, False])
def test_a_tripped_guard_disarms_also_at_neutral(tripped, throttle):
    """At neutral no write reads the gate: the step itself must look. The control: not tripped."""
    with Car.open("sim://?nano=mock", raise_on_trip=False) as car:
        car.arm()
        car._engine.driver._guard = Guard(tripped)
        for _ in car.states(duration=0.1):
            car.drive(throttle=throttle)
        assert (car.mode == "TRIPPED") == tripped
        assert car.causes == (("GUARD_TRIPPED",) if tripped else ())


def last_beat(car: Car, throttle: float) -> tuple[bool, bool]:
    """(at_neutral, off) of the guard's last beat after 0.1 s with this throttle."""
    car._engine.driver._guard = guard = Guard()
    for _ in car.states(duration=0.1):
        car.drive(throttle=throttle)
    return guard.beats[-1]


def test_the_guard_receives_whether_the_car_is_at_neutral_and_whether_pulses_are_off():
    """By it the guard writes neutral or no pulse: after MOVES_AT_NEUTRAL, neutral drives the car.

    A car that drives gets neutral first: an ESC needs some frames of it to give up a throttle.
    """
    with Car.open("sim://?nano=mock", raise_on_trip=False) as car:
        assert last_beat(car, 0.0) == (True, False)
        car.arm()
        assert last_beat(car, 0.2) == (False, False)
        car._engine.driver.supervisor.silence(car.now, "MOVES_AT_NEUTRAL")
        assert last_beat(car, 0.2) == (True, True)


def test_the_guard_gets_signs_of_life_while_the_car_closes():
    """Ten frames of neutral last longer than the silence after which a guard trips."""
    with Car.open("sim://?nano=mock") as car:
        car.arm()
        car._engine.driver._guard = guard = Guard()
    assert guard.beats == [(True, False)] * NEUTRAL_FRAMES + [(True, True)]


def test_neutral_that_a_guard_wrote_late_is_ended_too():
    """A guard that trips while the car closes may write after the last write of the car."""
    with Car.open("sim://?nano=mock") as car:
        car.arm()
        bus = car._engine.backend.bus
        car._engine.driver._guard = Guard(
            at_close=lambda: bus.writeto(0x40, bytes([0x0A, 0, 0, 0x33, 0x01])))
    assert no_pulse(bus)
    assert car._engine.driver.applied.throttle_us == 0.0


def test_the_guard_is_ended_also_if_ctrl_c_interrupts_closing():
    """Left alone, it would write neutral after the pulses have ended, for as long as we live."""
    car = Car.open("sim://?nano=mock")
    car.arm()
    car._engine.driver._guard = guard = Guard()

    def interrupt(seconds):
        raise KeyboardInterrupt

    car._engine.driver.actuator._sleep = interrupt
    with pytest.raises(KeyboardInterrupt):
        car.close()
    assert guard.closed_at_neutral is True


def test_a_bus_fault_leaves_the_guard_to_its_own_descriptor():
    """A beat would report a healthy program, while this one cannot write neutral."""
    with Car.open("sim://?nano=mock", raise_on_trip=False) as car:
        car.arm()
        car._engine.driver._guard = guard = Guard()
        for _ in car.states(duration=0.1):
            car.drive(throttle=0.2)
        assert guard.beats, "negative control"
        car._engine.backend.bus.nack = 10**9
        for _ in car.states(duration=0.06):
            car.drive(throttle=0.2)
        guard.beats.clear()
        for _ in car.states(duration=0.5):
            car.drive(throttle=0.2)
        assert not guard.beats
        car._engine.backend.bus.nack = 0
        for _ in car.states(duration=0.3):
            car.drive(throttle=0.2)
        assert guard.beats[-1] == (True, False)


def test_states_of_a_hang_are_reported_with_what_the_guard_wrote():
    """Decoded after the hang, they would have the throttle of before it, and the mode ARMED."""
    with Car.open("sim://?nano=mock", raise_on_trip=False) as car:
        car.arm()
        driver = car._engine.driver
        driver._guard = guard = Guard()
        for state in car.states(duration=0.2):
            car.drive(throttle=0.2)
        assert state.applied.throttle > 0.15
        driver._beat_at -= 0.12                 # the guard tripped 20 ms ago
        guard.tripped = guard.writes = True
        state = next(car.states())
        assert (state.applied.throttle, car.mode) == (0.0, "TRIPPED")
        assert state.applied.throttle_us == pytest.approx(1500.0, abs=3.0)


def test_a_hang_is_throttle_then_neutral_then_no_pulse():
    before = Applied(0.1, 0.3, 1600.0, 1650.0)
    after = Applied(0.0, 0.0, 1500.0, 1500.0)
    hang = Hang(10.0, 11.0, before, 1500.0)
    assert hang.correct(after, 9.99) is before
    assert hang.correct(after, 10.1).throttle_us == 1500.0
    assert hang.correct(after, 10.1).throttle == 0.0
    assert hang.correct(after, 10.3).throttle_us == 0.0
    assert hang.correct(after, 11.0) is after
