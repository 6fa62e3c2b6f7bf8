"""How fast a path can be driven by the identified model: a speed for each of its points.

    v_max(s)  what tyres and steering lock hold in the bend
    forward   v dv/ds <= what motor and friction leave beside the bend
    backward  the same for the brake

Tyres share their force between the bend and the drive: a_x <= a_most sqrt(1 - (v^2 / v_max^2)^2),
the friction circle with v_max^2 k as the most that is across. E. Velenis and P. Tsiotras,
"Minimum-time travel for a vehicle with acceleration limits", JOTA 138 (2008), for the passes.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import sqrt

import numpy as np

from dart_hal.control.drivetrain import BRAKE_FORCE
from dart_hal.control.paths import Path
from dart_hal.control.plant import Plant
from dart_hal.control.profile import FOLLOWED
from dart_hal.core.errors import UsageError
from dart_hal.core.types import FloatArray, IntArray
from dart_hal.vehicle.friction import make_friction
from dart_hal.vehicle.motor import make_drive

# Share of the speed in a bend that is asked for: 0.9 of the force, for models are 2 % off each.
GRIP = 0.95
# rad of the lock that is left to the tracker in a bend.
RESERVE = 0.03
# m/s2 along the path at most: what ``drive_speed`` follows, and some to correct with.
ALONG = 0.7 * FOLLOWED
# m/s, the slowest that is asked of a car that moves.
CRAWL = 0.2


@dataclass(frozen=True)
class SpeedProfile:
    """Speed [m/s] at the points of a path, (n,)."""

    path: Path
    speed: FloatArray

    @property
    def time(self) -> float:
        """s of a flying lap, or of an open path from rest to rest."""
        after = np.roll(self.speed, -1)
        if not self.path.closed:
            after[-1] = 0.0
        return float(np.sum(self.path.spacing / np.maximum(0.5 * (self.speed + after), CRAWL)))

    def capped(self, cap: float) -> SpeedProfile:
        """No faster than ``cap`` [m/s]."""
        return replace(self, speed=np.minimum(self.speed, cap))

    def at(self, s: float) -> float:
        """Speed [m/s] at arc length s [m], of any lap; at the ends of an open path its last one."""
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
    """The fastest profile up to ``cap`` [m/s]; where the path asks for a speed, that is one too.

    Raises UsageError where the path is too tight for the car at any speed.
    """
    check_turns(path, plant)
    low, high = plant.lock
    lock = low + RESERVE, high - RESERVE
    bends = np.maximum(GRIP * plant.steady.fastest(path.curvature, lock), CRAWL)
    most = np.minimum(bends, cap if path.speed is None else np.minimum(path.speed, cap))
    limits = _Limits(plant)
    forward = _pass(most, bends, path, limits.forward)
    speed = _pass(forward[::-1], bends[::-1], path, limits.backward)[::-1]
    return SpeedProfile(path, speed)


def turns(path: Path, plant: Plant) -> bool:
    """Whether the car turns as tightly as the path everywhere."""
    return not len(_too_tight(path, plant))


def check_turns(path: Path, plant: Plant) -> None:
    """Raises UsageError where the path turns tighter than the car at its stops."""
    bad = _too_tight(path, plant)
    if not len(bad):
        return
    k = int(bad[np.argmax(np.abs(path.curvature[bad]))])
    right, left = _sharpest(plant)
    side, most = ("left", left) if path.curvature[k] > 0.0 else ("right", -right)
    raise UsageError(
        f"the path is tighter than the car turns: at {path.s[k]:.2f} m, x {path.x[k]:.2f} "
        f"y {path.y[k]:.2f} m",
        found=f"a radius of {1.0 / abs(path.curvature[k]):.3f} m to the {side}",
        expected=f"at least {1.0 / most:.3f} m to the {side}",
        likely="points that are close together or not smooth, or a tight bend",
        remedy="widen the bend, or cut it: dart-hal follow PATH --raceline 0.2")


def _too_tight(path: Path, plant: Plant) -> IntArray:
    right, left = _sharpest(plant)
    return np.flatnonzero((path.curvature > left) | (path.curvature < right))


def _sharpest(plant: Plant) -> tuple[float, float]:
    """Curvature [1/m] at the stops, right and left, of a car that does not slip."""
    right, left = (float(np.tan(angle)) / plant.vehicle.body.wheelbase for angle in plant.lock)
    return right, left


class _Limits:
    """Most acceleration and deceleration [m/s2] of the drive at a speed [m/s]."""

    def __init__(self, plant: Plant) -> None:
        p = plant.vehicle
        self._drive = make_drive(p.motor, p.friction)
        self._friction = make_friction(p.friction)
        self._mass = p.body.mass
        self._throttle = plant.throttle

    def forward(self, v: float) -> float:
        force: float = self._drive(self._throttle, v)
        return min(max(force / self._mass, 0.0), ALONG)

    def backward(self, v: float) -> float:
        force: float = BRAKE_FORCE - self._friction(v)
        return min(force / self._mass, ALONG)


def _pass(most: FloatArray, bends: FloatArray, path: Path,
          limit: Callable[[float], float]) -> FloatArray:
    """No faster at a point than from the one before; twice round a closed path, open from rest."""
    v: FloatArray = most.copy()
    n = len(v)
    d = path.spacing
    order = range(1, 2 * n) if path.closed else range(1, n)
    if not path.closed:
        v[0] = 0.0
    for j in order:
        i = (j - 1) % n
        k = j % n
        here = float(v[i])
        across = min(here / float(bends[i]), 1.0) ** 2
        a = limit(here) * sqrt(max(1.0 - across * across, 0.0))
        v[k] = min(float(v[k]), sqrt(here * here + 2.0 * a * d))
    return v
