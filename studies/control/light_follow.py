"""Following a path on the light simulation: a vehicle's equations and lags, no electronics."""

from __future__ import annotations

from dataclasses import replace
from math import cos, sin

import numpy as np

from dart_hal.control.follow import Follower, Phase
from dart_hal.control.plant import Plant, SteeringDelay
from dart_hal.control.speed import SpeedLaw
from dart_hal.core.types import MotionEstimate, Pose, Tracking
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.sets import UPSTREAM_2024
from dart_hal.vehicle.steering import make_steering, make_steering_inverse
from dart_lab.sim.light import LightCar

DELAY = 0.03
"""s before the lag, in whole steps of the simulation."""
BRAKE = 0.8
"""Throttle in reverse, behind its dead band, for each m/s too fast: this car has no brake."""
LATER = replace(UPSTREAM_2024, delay=replace(UPSTREAM_2024.delay, steering_s=DELAY))
"""The later published set, 30 ms late."""


def plant_by(p: Vehicle) -> Plant:
    """What is to be known of a vehicle, exactly."""
    curve = make_steering(p.steering)
    return Plant(
        p, SteeringDelay(p.delay.steering_s, p.delay.steering_lag_s), (curve(-1.0), curve(1.0))
    )


def motion_at(t: float, pose: Pose, speed: float, yaw_rate: float,
              tracking: Tracking = Tracking.TRACKING, frame: str = "room") -> MotionEstimate:
    """A motion that is known exactly."""
    return MotionEstimate(t, pose, speed, yaw_rate, np.zeros((5, 5)), frame, tracking)


def light_drive(follower: Follower, p: Vehicle = LATER, *, start: tuple[float, ...] | None = None,
                seconds: float = 60.0, bias: float = 0.0, each=None) -> np.ndarray:
    """Rows (t, x, y, offset, speed, wanted) of the true rear axle, until the drive has ended.

    start: pose of the rear axle, None: of the path; bias [rad]: of the wheels; each(t, follower,
    motion) -> motion is asked before each answer.
    """
    x, y, yaw = start or (follower.path.x[0], follower.path.y[0], follower.path.heading[0])
    l_r, command = p.body.l_r, make_steering_inverse(p.steering)
    car, law, rows, s = LightCar(p), SpeedLaw(p), [], None
    car.reset(x + l_r * cos(yaw), y + l_r * sin(yaw), yaw, steering=command(0.0))
    while car.t < seconds and follower.phase is not Phase.ENDED:
        x, y, yaw, v, _, rate = car.state[:6]
        pose = Pose(x - l_r * cos(yaw), y - l_r * sin(yaw), yaw)
        motion = motion_at(car.t, pose, v, rate)
        motion = each(car.t, follower, motion) if each else motion
        angle, speed = follower.answer(motion)
        s = follower.path.closest(pose.x, pose.y, follower.tracker.s)
        rows.append((car.t, pose.x, pose.y, follower.path.offset(pose.x, pose.y, s), v, speed))
        brake = p.motor.g - BRAKE * (v - speed) if v > max(speed + 0.02, 0.1) else 0.0
        car.advance(brake or law.throttle(speed, v, 0.01), command(angle + bias))
    return np.array(rows)


def figures(rows: np.ndarray, after: float = 3.0) -> tuple[float, float]:
    """(rms, largest) offset [m] once ``after`` m are driven."""
    way = np.append(0.0, np.cumsum(np.hypot(*np.diff(rows[:, 1:3], axis=0).T)))
    offset = rows[way > after, 3]
    return float(np.sqrt(np.mean(offset**2))), float(np.abs(offset).max())
