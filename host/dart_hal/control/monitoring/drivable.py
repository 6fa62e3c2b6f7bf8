"""Whether a car can drive a curve, how fast its parameter may grow, and what to type if not."""

from __future__ import annotations

from math import ceil, tan

import numpy as np

from dart_hal.control.lap import SpeedProfile
from dart_hal.control.monitoring.course import Course
from dart_hal.control.monitoring.lissajous import Lissajous
from dart_hal.control.plant import Plant
from dart_hal.core.errors import UsageError

# rad of the lock that stay free in the tightest bend: backlash, an error of the map, and what the
# tyres slip. The paper's car then still holds 1.4 m/s there.
LOCK_LEFT = 0.07
# Rate that the car must be able to drive, over the rate of the formation: who is behind has to
# come nearer.
CATCH_UP = 1.25


def least_radius(plant: Plant) -> float:
    """Radius [m] that the car turns to either side with ``LOCK_LEFT`` to spare."""
    right, left = plant.lock
    angle = min(left, -right) - LOCK_LEFT
    return plant.vehicle.body.wheelbase / tan(max(angle, 1e-3))


def widened(curve: Lissajous, radius: float) -> Lissajous:
    """The same form, as large as its tightest bend has to be [m]; never smaller than it is."""
    return curve.scaled(max(radius / curve.tightest, 1.0))


def check_drivable(curve: Lissajous, plant: Plant) -> None:
    """Raises UsageError where the curve is tighter than the car turns, with one that is not."""
    least = least_radius(plant)
    if curve.tightest >= least:
        return
    wide = widened(curve, least)
    A, B = (ceil(100.0 * side) / 100.0 for side in (wide.A, wide.B))
    raise UsageError(
        f"the {curve.a}:{curve.b} curve of {2 * curve.A:g} x {2 * curve.B:g} m is tighter than the "
        "car turns", found=f"a radius of {curve.tightest:.3f} m",
        expected=f"at least {least:.2f} m",
        likely="a curve of robots that turn on the spot",
        remedy=f"Lissajous({A:.2f}, {B:.2f}, {curve.a}, {curve.b}), {2 * A:.1f} x {2 * B:.1f} m; "
               "fewer lobes need less room: Lissajous(3.3, 0.9, 1, 2) for three cars")


def fastest_rate(course: Course, profile: SpeedProfile) -> float:
    """X' [rad/s] that a car can hold all the way round by its speed profile."""
    per = course.curve.rate(np.array([course.parameter(s) for s in profile.path.s]))
    return float((profile.speed / per).min())


def check_rate(rate: float, fastest: float) -> None:
    """Raises UsageError for a rate X' [rad/s] of the formation that leaves this car none to catch
    up with."""
    if rate * CATCH_UP > fastest:
        raise UsageError(f"the car cannot hold X' = {rate:.3f} rad/s and catch up",
                         found=f"its bends and its motor allow {fastest:.3f} rad/s",
                         expected=f"at most {fastest / CATCH_UP:.3f} rad/s",
                         remedy=f"omega={fastest / CATCH_UP:.3f}, or a wider curve")
