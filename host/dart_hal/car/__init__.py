"""The facade: ``Car`` and ``Fleet``, the only objects a controller needs."""

from dart_hal.car.car import Car
from dart_hal.car.fleet import Fleet
from dart_hal.car.identity import Hello
from dart_hal.car.timing import Timing

__all__ = ["Car", "Fleet", "Hello", "Timing"]
