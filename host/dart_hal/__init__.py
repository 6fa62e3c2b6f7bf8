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

__version__ = "0.2.0"

if TYPE_CHECKING:
    from dart_hal.calibration.steering import calibrate_steering
    from dart_hal.car import Car, Fleet, join
    from dart_hal.car.runs import read_any, read_run
    from dart_hal.car.table import to_dataframe
    from dart_hal.control.curvature_aware.progress import Law
    from dart_hal.control.ending import Phase
    from dart_hal.control.follow import Follower, Rules
    from dart_hal.control.mpc.obstacles import Obstacle
    from dart_hal.control.paths import Path, figure_of_eight
    from dart_hal.control.plant import plant_of
    from dart_hal.control.pursuit import PurePursuit
    from dart_hal.control.speed import SpeedLaw
    from dart_hal.control.trackers import Lqr, Pursuit, contouring, curvature_aware
    from dart_hal.control.tracks import track_named
    from dart_hal.core import errors
    from dart_hal.core.config import Calibration, Quantity, load_car, save_calibration, save_model
    from dart_hal.core.errors import DartHalError
    from dart_hal.core.types import Applied, Estimate, Health, Pose, State
    from dart_hal.devices.actuation.steering_map import steering_map
    from dart_hal.estimation.localisation.grid import Grid, write_grid
    from dart_hal.recording.run import RunReader
    from dart_hal.vehicle import Vehicle, rollout
    from dart_hal.vehicle.file import model_of
    from dart_hal.vehicle.load import find_model
    from dart_hal.vehicle.parameters import Delay
    from dart_hal.vehicle.sets import PAPER, UPSTREAM_2024

__all__ = [
    "PAPER",
    "UPSTREAM_2024",
    "Applied",
    "Calibration",
    "Car",
    "DartHalError",
    "Delay",
    "Estimate",
    "Fleet",
    "Follower",
    "Grid",
    "Health",
    "Law",
    "Lqr",
    "Obstacle",
    "Path",
    "Phase",
    "Pose",
    "PurePursuit",
    "Pursuit",
    "Quantity",
    "Rules",
    "RunReader",
    "SpeedLaw",
    "State",
    "Vehicle",
    "__version__",
    "calibrate_steering",
    "contouring",
    "curvature_aware",
    "errors",
    "figure_of_eight",
    "find_model",
    "join",
    "load_car",
    "model_of",
    "plant_of",
    "read_any",
    "read_run",
    "rollout",
    "save_calibration",
    "save_model",
    "steering_map",
    "to_dataframe",
    "track_named",
    "write_grid",
]

_MODULES = {
    "calibration.steering": ("calibrate_steering",),
    "car": ("Car", "Fleet", "join"),
    "car.runs": ("read_any", "read_run"),
    "car.table": ("to_dataframe",),
    "control.curvature_aware.progress": ("Law",),
    "control.ending": ("Phase",),
    "control.follow": ("Follower", "Rules"),
    "control.mpc.obstacles": ("Obstacle",),
    "control.paths": ("Path", "figure_of_eight"),
    "control.plant": ("plant_of",),
    "control.pursuit": ("PurePursuit",),
    "control.speed": ("SpeedLaw",),
    "control.trackers": ("Lqr", "Pursuit", "contouring", "curvature_aware"),
    "control.tracks": ("track_named",),
    "core": ("errors",),
    "core.config": ("Calibration", "Quantity", "load_car", "save_calibration", "save_model"),
    "core.errors": ("DartHalError",),
    "core.types": ("Applied", "Estimate", "Health", "Pose", "State"),
    "devices.actuation.steering_map": ("steering_map",),
    "estimation.localisation.grid": ("Grid", "write_grid"),
    "recording.run": ("RunReader",),
    "vehicle": ("Vehicle", "rollout"),
    "vehicle.file": ("model_of",),
    "vehicle.load": ("find_model",),
    "vehicle.parameters": ("Delay",),
    "vehicle.sets": ("PAPER", "UPSTREAM_2024"),
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
