"""DART-HAL: drive, calibrate and record the DART research car. ``dart_lab``: simulate, diagnose.

    from dart_hal import Car

    with Car.open() as car:
        car.arm()
        for s in car.states(duration=10.0):
            car.drive(steering=0.2, throttle=0.3 * (1.0 - s.speed))
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dart_hal import compat

__version__ = "0.1.0"

if TYPE_CHECKING:
    from dart_hal.calibration.steering import calibrate_steering
    from dart_hal.car import Car, Fleet, join
    from dart_hal.car.runs import read_any, read_run
    from dart_hal.car.table import to_dataframe
    from dart_hal.control.follow import Follower
    from dart_hal.control.paths import Path, figure_of_eight
    from dart_hal.control.plant import plant_of
    from dart_hal.control.speed import SpeedLaw
    from dart_hal.control.trackers import Lqr, Pursuit, contouring, curvature_aware
    from dart_hal.control.tracks import track_named
    from dart_hal.core import errors
    from dart_hal.core.config import load_car
    from dart_hal.core.errors import DartHalError
    from dart_hal.core.types import Applied, Estimate, Health, Pose, State
    from dart_hal.vehicle import Vehicle, rollout
    from dart_hal.vehicle.load import find_model

__all__ = [
    "Applied", "Car", "DartHalError", "Estimate", "Fleet", "Follower", "Health", "Lqr", "Path",
    "Pose", "Pursuit", "SpeedLaw", "State", "Vehicle", "__version__", "calibrate_steering",
    "contouring", "curvature_aware", "errors", "figure_of_eight", "find_model", "join", "load_car",
    "plant_of", "read_any", "read_run", "rollout", "to_dataframe", "track_named",
]

_MODULES = {
    "calibration.steering": ("calibrate_steering",),
    "car": ("Car", "Fleet", "join"),
    "car.runs": ("read_any", "read_run"),
    "car.table": ("to_dataframe",),
    "control.follow": ("Follower",),
    "control.paths": ("Path", "figure_of_eight"),
    "control.plant": ("plant_of",),
    "control.speed": ("SpeedLaw",),
    "control.trackers": ("Lqr", "Pursuit", "contouring", "curvature_aware"),
    "control.tracks": ("track_named",),
    "core": ("errors",),
    "core.config": ("load_car",),
    "core.errors": ("DartHalError",),
    "core.types": ("Applied", "Estimate", "Health", "Pose", "State"),
    "vehicle": ("Vehicle", "rollout"),
    "vehicle.load": ("find_model",),
}
_MODULE_OF = {name: module for module, names in _MODULES.items() for name in names}


def __getattr__(name: str) -> Any:
    """Load on first use: ``import dart_hal`` opens nothing and stays light."""
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'dart_hal' has no attribute {name!r}")
    from importlib import import_module

    module = import_module(f"dart_hal.{_MODULE_OF[name]}")
    return import_module("dart_hal.core.errors") if name == "errors" else getattr(module, name)


def __dir__() -> list[str]:
    """The public names, for completion."""
    return sorted(__all__)


compat.install()
