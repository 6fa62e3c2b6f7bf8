"""Readings of the sensors for a given motion, with the effects on them."""

from __future__ import annotations

from typing import Any

import numpy as np

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import FloatArray
from dart_hal.vehicle.channels import transform_signal
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.effect import Now
from dart_hal.vehicle.motor import make_drive
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import GEAR_REVOLUTION, Vehicle

NO_RATES = (0.0, 0.0, 0.0)


def motion(t: FloatArray, states: Any, rates: Any = NO_RATES, distance: Any = 0.0) -> Now:
    """Return a motion as effects take it, without the force at the wheels.

    t [s]; states: x, y, yaw, v_x, v_y, omega of the centre of mass as in a rollout;
    rates: of the last three, by which a_x = v_x' - omega v_y, a_y = v_y' + omega v_x;
    (n,) or (n, windows) each. distance [m]: driven before the first sample.
    """
    _, _, yaw, v_x, v_y, omega = states
    turns = (distance + np.cumsum(v_x, axis=0) * SAMPLE) / GEAR_REVOLUTION
    return Now(t, v_x, v_y, omega, yaw, rates[0] - omega * v_y, rates[1] + omega * v_x, rates[2],
               0.0, turns)


def add_drive_force(p: Vehicle, now: Now, throttle: FloatArray) -> Now:
    """Add the force at the wheels to a motion; throttle -1..1 behind its actuator."""
    q = apply_parameter_effects(p)
    return now._replace(drive=make_drive(q.motor, q.friction, ARRAY)(throttle, now.v_x))


def read_sensors(p: Vehicle, now: Now) -> tuple[FloatArray, ...]:
    """Return the readings of wheel [m/s], gyro [rad/s] and accelerometer (x, y) [m/s2]."""
    return (transform_signal(p, "wheel", np.array(now.v_x), now, SAMPLE),
            transform_signal(p, "gyro", np.array(now.omega), now, SAMPLE),
            *transform_signal(p, "accel", (now.a_x, now.a_y), now, SAMPLE))


def marker_pose(p: Vehicle, t: FloatArray, states: Any, marker: Any) -> tuple[FloatArray, ...]:
    """Return the pose (x, y, yaw) that motion capture measures of a marker on a moving car."""
    x, y, yaw = transform_signal(p, "pose", marker, motion(t, states), SAMPLE)
    return x, y, yaw
