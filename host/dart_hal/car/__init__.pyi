# One line for each public name. ``dart_hal.core.lazy`` reads them, and so do type checkers.
from dart_hal.car.car import Car as Car
from dart_hal.car.fleet import Fleet as Fleet
from dart_hal.car.identity import Hello as Hello
from dart_hal.car.member import Member as Member
from dart_hal.car.member import join as join
from dart_hal.car.timing import Timing as Timing
