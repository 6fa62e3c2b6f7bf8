"""DART-HAL: drive, calibrate and record the DART research car. ``dart_lab``: simulate, diagnose.

    from dart_hal import Car

    with Car.open() as car:
        car.arm()
        for s in car.states(duration=10.0):
            car.drive(steering=0.2, throttle=0.3 * (1.0 - s.speed))
"""

from __future__ import annotations

from dart_hal import compat
from dart_hal.core.lazy import read_public_names

__version__ = "0.2.0"
# The names are in __init__.pyi; ``import dart_hal`` imports none of their modules.
__getattr__, __dir__, __all__ = read_public_names(__name__, __file__)
__all__ += ["__version__"]

compat.install()
