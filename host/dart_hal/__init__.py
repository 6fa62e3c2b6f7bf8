"""DART-HAL: drive, calibrate, simulate and understand the DART research car.

    from dart_hal import Car

    with Car.open() as car:
        car.arm()
        for s in car.states(duration=10.0):
            car.drive(steering=0.2, throttle=0.3 * (1.0 - s.speed))
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

__version__ = "0.1.0"

if TYPE_CHECKING:
    from dart_hal.car import Car, Fleet
    from dart_hal.core.errors import DartHalError
    from dart_hal.core.types import Applied, Estimate, Health, Pose, State

__all__ = ["Applied", "Car", "DartHalError", "Estimate", "Fleet", "Health", "Pose", "State",
           "__version__"]

_WHERE = {"Car": "car", "Fleet": "car", "DartHalError": "core.errors", "Applied": "core.types",
          "Estimate": "core.types", "Health": "core.types", "Pose": "core.types",
          "State": "core.types"}


def __getattr__(name: str) -> Any:
    """Load on first use: ``import dart_hal`` opens nothing and stays light."""
    if name not in _WHERE:
        raise AttributeError(f"module 'dart_hal' has no attribute {name!r}")
    from importlib import import_module

    return getattr(import_module(f"dart_hal.{_WHERE[name]}"), name)
