"""Simulation without firmware, for controllers and learning.

``LightCar`` is one car over ``math``, ``LightBatch`` many over numpy, on the
same equations as the virtual world. What they leave out against ``sim://``:
bits, frames, registers and faults; the speed controller's brake.
"""

from __future__ import annotations

from dart_hal.sim.light.batch import LightBatch
from dart_hal.sim.light.car import LightCar, vehicle_named
from dart_hal.sim.light.config import (
    DART_ACTUATORS,
    FIRMWARE,
    PERFECT,
    RECORDED,
    Actuators,
    Disturbance,
    Encoder,
    Inertial,
    LightConfig,
    Mocap,
    Sensors,
)
from dart_hal.sim.light.sense import Reading

__all__ = [
    "DART_ACTUATORS", "FIRMWARE", "PERFECT", "RECORDED", "Actuators", "Disturbance", "Encoder",
    "Inertial", "LightBatch", "LightCar", "LightConfig", "Mocap", "Reading", "Sensors",
    "vehicle_named",
]
