"""Simulation without firmware, for controllers and learning.

``LightCar`` is one car computed with ``math``, ``LightBatch`` many cars at once, ``LightWorld``
several cars with contacts. All use the equations of the virtual world. They do not simulate bits,
frames, registers, faults, and the brake of the speed controller, which ``sim://`` does.
"""

from __future__ import annotations

from dart_lab.sim.light.batch import LightBatch
from dart_lab.sim.light.car import LightCar, vehicle_named
from dart_lab.sim.light.config import (
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
from dart_lab.sim.light.sense import Reading
from dart_lab.sim.light.world import Area, LightWorld, Outline, WorldConfig

__all__ = [
    "DART_ACTUATORS", "FIRMWARE", "PERFECT", "RECORDED", "Actuators", "Area", "Disturbance",
    "Encoder", "Inertial", "LightBatch", "LightCar", "LightConfig", "LightWorld", "Mocap",
    "Outline", "Reading", "Sensors", "WorldConfig", "vehicle_named",
]
