"""What a guard that has tripped does to the car that it guards."""

from __future__ import annotations

import pytest

from dart_hal.car import Car


class Guard:
    """In the place of ``GuardPost``: it has seen this program hang, or has not."""

    age = 0.0

    def __init__(self, tripped: bool) -> None:
        self.tripped = tripped

    def beat(self, *, at_neutral: bool, off: bool = False) -> None:
        """Nothing is acknowledged here."""

    def close(self, *, at_neutral: bool) -> None:
        """Nothing runs."""


@pytest.mark.few("True-0.2", "False-0.0")
@pytest.mark.parametrize("throttle", [0.0, 0.2])
@pytest.mark.parametrize("tripped", [True, False])
def test_a_tripped_guard_disarms_also_at_neutral(tripped, throttle):
    """At neutral no write asks the gate: the step itself must look. The control: not tripped."""
    with Car.open("sim://?nano=mock", raise_on_trip=False) as car:
        car.arm()
        car._engine.driver._guard = Guard(tripped)
        for _ in car.states(duration=0.1):
            car.drive(throttle=throttle)
        assert (car.mode == "TRIPPED") == tripped
        assert car.causes == (("GUARD_TRIPPED",) if tripped else ())
