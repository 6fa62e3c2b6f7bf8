"""Whether a car can drive a curve, how fast its parameter may grow, and an alternative if not."""

from __future__ import annotations

from math import ceil, tan

import numpy as np

from dart_hal.control.lap import SpeedProfile
from dart_hal.control.monitoring.course import Course
from dart_hal.control.monitoring.lissajous import Lissajous
from dart_hal.control.plant import Plant
from dart_hal.core.errors import UsageError

# Part of the lock that stays free in the tightest bend [rad]: backlash, error of the map, tyre
# slip. With it the car of the paper still holds 1.4 m/s there.
LOCK_RESERVE = 0.07
# Rate that the car must be able to drive, relative to the rate of the formation: a car behind its
# slot has to catch up.
CATCH_UP_FACTOR = 1.25


def min_turn_radius(plant: Plant) -> float:
    """Return the radius [m] that the car turns to either side with ``LOCK_RESERVE`` to spare."""
    right, left = plant.lock
    angle = min(left, -right) - LOCK_RESERVE
    return plant.vehicle.body.wheelbase / tan(max(angle, 1e-3))


def widen(curve: Lissajous, radius: float) -> Lissajous:
    """Return the same form with a smallest radius of at least ``radius`` [m]; never smaller."""
    return curve.scale(max(radius / curve.tightest, 1.0))


def check_drivable(curve: Lissajous, plant: Plant) -> None:
    """Raise UsageError if the curve is tighter than the car turns; propose one that is not."""
    min_radius = min_turn_radius(plant)
    if curve.tightest >= min_radius:
        return
    wide = widen(curve, min_radius)
    A, B = (ceil(100.0 * side) / 100.0 for side in (wide.A, wide.B))
    raise UsageError(
        f"the {curve.a}:{curve.b} curve of {2 * curve.A:g} x {2 * curve.B:g} m is tighter than the "
        "car turns", found=f"a radius of {curve.tightest:.3f} m",
        expected=f"at least {min_radius:.2f} m",
        likely="a curve of robots that turn on the spot",
        remedy=f"Lissajous({A:.2f}, {B:.2f}, {curve.a}, {curve.b}), {2 * A:.1f} x {2 * B:.1f} m; "
               "fewer lobes need less room: Lissajous(3.3, 0.9, 1, 2) for three cars")


def max_rate(course: Course, profile: SpeedProfile) -> float:
    """Return X' [rad/s] that a car can hold on the whole curve by its speed profile."""
    metres_per_rad = course.curve.rate(np.array([course.parameter(s) for s in profile.path.s]))
    return float((profile.speed / metres_per_rad).min())


def check_rate(rate: float, max_rate: float) -> None:
    """Raise UsageError for a rate X' [rad/s] of the formation without a reserve to catch up."""
    if rate * CATCH_UP_FACTOR > max_rate:
        raise UsageError(f"the car cannot hold X' = {rate:.3f} rad/s and catch up",
                         found=f"its bends and its motor allow {max_rate:.3f} rad/s",
                         expected=f"at most {max_rate / CATCH_UP_FACTOR:.3f} rad/s",
                         remedy=f"omega={max_rate / CATCH_UP_FACTOR:.3f}, or a wider curve")
