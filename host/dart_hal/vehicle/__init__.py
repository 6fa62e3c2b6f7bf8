"""Pure physics of the car: equations once, over any namespace of functions.

Factories bind parameters and functions, and return closures:
``make_dynamic(PAPER, math)`` is fast for one car, ``make_dynamic(PAPER,
numpy)`` takes arrays of cars, ``make_dynamic(PAPER, casadi)`` symbols.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dart_hal.vehicle.bicycle import make_acceleration, make_dynamic, make_kinematic
from dart_hal.vehicle.flat import stack
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.integrate import make_dynamic_step, make_kinematic_step
from dart_hal.vehicle.motor import make_dead_band, make_motor, make_motor_gains
from dart_hal.vehicle.namespace import ARRAY, SCALAR, Namespace, adapt
from dart_hal.vehicle.parameters import (
    GRAVITY,
    AxleTyres,
    Body,
    Delay,
    Friction,
    Motor,
    PaperTyres,
    SpeedLoop,
    Steering,
    Vehicle,
)
from dart_hal.vehicle.sets import PAPER, PAPER_PRINTED, SETS, UPSTREAM_2024
from dart_hal.vehicle.steering import check_monotone, make_steering, make_steering_inverse
from dart_hal.vehicle.step import make_car_step, make_motion_step
from dart_hal.vehicle.tyres import make_slip, make_tyres

if TYPE_CHECKING:
    from dart_hal.vehicle.batch import Batch, rollout

__all__ = [
    "ARRAY", "GRAVITY", "PAPER", "PAPER_PRINTED", "SCALAR", "SETS", "UPSTREAM_2024",
    "AxleTyres", "Batch", "Body", "Delay", "Friction", "Motor", "Namespace", "PaperTyres",
    "SpeedLoop", "Steering", "Vehicle", "adapt", "check_monotone", "make_acceleration",
    "make_car_step",
    "make_dead_band", "make_dynamic", "make_dynamic_step", "make_friction", "make_kinematic",
    "make_kinematic_step", "make_motion_step", "make_motor", "make_motor_gains", "make_slip",
    "make_steering", "make_steering_inverse", "make_tyres", "rollout", "stack",
]


def __getattr__(name: str) -> Any:
    """Load what runs many cars on first use: a car that drives needs no compiled kernels."""
    if name not in ("Batch", "rollout"):
        raise AttributeError(f"module 'dart_hal.vehicle' has no attribute {name!r}")
    from dart_hal.vehicle import batch

    return getattr(batch, name)
