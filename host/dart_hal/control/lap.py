"""Fastest speed profile of a path by the identified model: a speed for each of its points.

    v_max(s)  limit by tyres and steering lock in the bend
    forward   v dv/ds <= what motor and friction leave in the bend
    backward  the same for the brake

Tyres share their force between lateral and longitudinal: a_x <= a_max sqrt(1 - (v^2 / v_max^2)^2),
the friction circle with v_max^2 k as the largest lateral acceleration. E. Velenis and P. Tsiotras,
"Minimum-time travel for a vehicle with acceleration limits", JOTA 138 (2008), for the passes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.control.profile import MAX_FOLLOWED_ACCELERATION
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.motor import make_drive

# Speed in a bend relative to the limit: 0.9 of the lateral force, as models are 2 % off each.
BEND_SPEED_SHARE = 0.95
# Part of the lock that remains for the tracker in a bend [rad].
LOCK_RESERVE = 0.03
# Largest longitudinal acceleration [m/s2]: what ``drive_speed`` follows, and a reserve.
MAX_LONGITUDINAL = 0.7 * MAX_FOLLOWED_ACCELERATION
# Slowest target speed of a moving car [m/s].
CRAWL_SPEED = 0.2


@dataclass(frozen=True)
class SpeedProfile:
    """Speed [m/s] at the points of a path, (n,)."""

    path: Path
    speed: FloatArray

    @property
    def time(self) -> float:
        """Time of a flying lap [s], or of an open path from rest to rest."""
        after = np.roll(self.speed, -1)
        if not self.path.closed:
            after[-1] = 0.0
        return float(
            np.sum(self.path.spacing / np.maximum(0.5 * (self.speed + after), CRAWL_SPEED))
        )

    def limit_to(self, cap: float) -> SpeedProfile:
        """Return the profile limited to ``cap`` [m/s]."""
        return replace(self, speed=np.minimum(self.speed, cap))

    def speed_at(self, s: float) -> float:
        """Return the speed [m/s] at arc length s [m] of any lap; beyond an open path that of its
        end.
        """
        k = s / self.path.spacing
        n = len(self.speed)
        i = int(np.floor(k))
        if not self.path.closed:
            i = min(max(i, 0), n - 1)
            after = min(i + 1, n - 1)
            part = min(max(k - i, 0.0), 1.0)
        else:
            after = (i + 1) % n
            part = k - i
        low = float(self.speed[i % n])
        high = float(self.speed[after])
        return low + part * (high - low)


def speed_profile(path: Path, plant: Plant, cap: float) -> SpeedProfile:
    """Return the fastest profile up to ``cap`` [m/s], and up to the speed of the path if it has
    one.

    Raises UsageError if the path is too tight for the car at any speed.
    """
    check_curvature(path, plant)
    low, high = plant.lock
    lock = low + LOCK_RESERVE, high - LOCK_RESERVE
    bend_speed = np.maximum(
        BEND_SPEED_SHARE * plant.steady.max_speed(path.curvature, lock), CRAWL_SPEED
    )
    max_speed = np.minimum(bend_speed, cap if path.speed is None else np.minimum(path.speed, cap))
    limits = _DriveLimits(plant)
    forward = _limit_acceleration(max_speed, bend_speed, path, limits.forward)
    speed = _limit_acceleration(forward[::-1], bend_speed[::-1], path, limits.backward)[::-1]
    return SpeedProfile(path, speed)


def is_drivable(path: Path, plant: Plant) -> bool:
    """Return whether the car can drive the curvature of the path everywhere."""
    return not len(_too_tight(path, plant))


def check_curvature(path: Path, plant: Plant) -> None:
    """Raise UsageError if the path is tighter than the car turns at its stops."""
    tight = _too_tight(path, plant)
    if not len(tight):
        return
    k = int(tight[np.argmax(np.abs(path.curvature[tight]))])
    right, left = _lock_curvatures(plant)
    side, limit = ("left", left) if path.curvature[k] > 0.0 else ("right", -right)
    raise UsageError(
        f"the path is tighter than the car turns: at {path.s[k]:.2f} m, x {path.x[k]:.2f} "
        f"y {path.y[k]:.2f} m",
        found=f"a radius of {1.0 / abs(path.curvature[k]):.3f} m to the {side}",
        expected=f"at least {1.0 / limit:.3f} m to the {side}",
        likely="points that are close together or not smooth, or a tight bend",
        remedy="widen the bend, or cut it: dart-hal follow PATH --raceline 0.2")


def _too_tight(path: Path, plant: Plant) -> IntArray:
    """Return the indices of points that are tighter than the car turns."""
    right, left = _lock_curvatures(plant)
    return np.flatnonzero((path.curvature > left) | (path.curvature < right))


def _lock_curvatures(plant: Plant) -> tuple[float, float]:
    """Return the curvatures [1/m] at the stops, right and left, without slip."""
    right, left = (float(np.tan(angle)) / plant.vehicle.body.wheelbase for angle in plant.lock)
    return right, left


class _DriveLimits:
    """Largest acceleration and deceleration [m/s2] of the drive at a speed [m/s]."""

    def __init__(self, plant: Plant) -> None:
        p = plant.vehicle
        self._drive = make_drive(p.duty_motor, p.friction)
        self._friction = make_friction(p.friction)
        self._mass = p.body.mass
        self._max_throttle = plant.max_throttle
        self._brake = plant.brake

    def forward(self, v: float) -> float:
        force: float = self._drive(self._max_throttle, v)
        return min(max(force / self._mass, 0.0), MAX_LONGITUDINAL)

    def backward(self, v: float) -> float:
        friction: float = self._friction(v)
        return min(self._brake - friction / self._mass, MAX_LONGITUDINAL)


def _limit_acceleration(max_speed: FloatArray, bend_speed: FloatArray, path: Path,
                        limit: Callable[[float], float]) -> FloatArray:
    """Limit the acceleration from each point to the next; twice around a closed path, an open one
    from rest.
    """
    v: FloatArray = max_speed.copy()
    n = len(v)
    d = path.spacing
    order = range(1, 2 * n) if path.closed else range(1, n)
    if not path.closed:
        v[0] = 0.0
    for j in order:
        i = (j - 1) % n
        k = j % n
        here = float(v[i])
        lateral_use = min(here / float(bend_speed[i]), 1.0) ** 2
        a = limit(here) * sqrt(max(1.0 - lateral_use * lateral_use, 0.0))
        v[k] = min(float(v[k]), sqrt(here * here + 2.0 * a * d))
    return v
