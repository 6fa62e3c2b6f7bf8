"""The facade: ``Car``, ``Fleet`` and ``join``, all that a controller needs."""

from dart_hal.car.car import Car
from dart_hal.car.fleet import Fleet
from dart_hal.car.identity import Hello
from dart_hal.car.member import Member, join
from dart_hal.car.timing import Timing

__all__ = ["Car", "Fleet", "Hello", "Member", "Timing", "join"]
