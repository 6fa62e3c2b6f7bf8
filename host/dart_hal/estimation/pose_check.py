"""Whether poses from outside are those of this car, and how they are told where they are not.

Wheels and gyro say what the car did. A right stream has moved as far, turned as much, the same
way round, and has gone where its nose points; each wrong convention breaks one of these by a
figure of its own.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import FloatArray

STEP = 0.2
"""s over which motions are compared: noise of 1 mm and 2 mrad is small against 0.1 m, 0.2 rad."""
WAY, TURNED = 1.5, 2.0
"""m and rad that the car must have driven and turned before anything is said."""
STILL = 0.05
"""Share of the car's way below which the poses stand."""
LENGTHS = {"mm": 1000.0, "cm": 100.0}
LENGTH_WITHIN, ANGLE_WITHIN = 0.35, 0.3
"""Relative: a car that was never calibrated knows its way and its turn to a few per cent, and a
marker 0.1 m off the axle goes a third further in a tight bend."""
ALONG, AHEAD = 0.8, math.radians(20.0)
"""Length of the mean direction of motion against the nose, 1 where it is always the same, and its
angle: a slipping car moves up to 10 degrees beside its nose."""
FLAT = 0.03
"""Small over large spread of the places below which a driven circle is seen from its side."""


@dataclass(frozen=True, slots=True)
class Drive:
    """One drive as the car and as the source tell it.

    t (n,) [s]; car (n, 3) and seen (n, 3): x, y [m], yaw [rad] at those times, unwrapped,
    each in its own frame.
    """

    t: FloatArray
    car: FloatArray
    seen: FloatArray


@dataclass(frozen=True, slots=True)
class Wrong:
    """What is wrong with a stream: found and expected in words; option: of the source's URL that
    mends it, empty where none does."""

    what: str
    found: str
    expected: str
    option: str = ""


def fault_of(drive: Drive) -> Wrong | None:
    """The first thing wrong, None where the poses fit the car.

    Raises ValueError for a drive of less than ``WAY`` and ``TURNED``: it tells nothing.
    """
    car, seen = _steps(drive.t, drive.car), _steps(drive.t, drive.seen)
    way = np.hypot(car[:, 0], car[:, 1])
    if way.sum() < WAY or np.abs(car[:, 2]).sum() < TURNED:
        raise ValueError(f"{way.sum():.1f} m and {np.abs(car[:, 2]).sum():.1f} rad are too little")
    scale = float(np.hypot(seen[:, 0], seen[:, 1]).sum() / way.sum())
    turn = float(seen[:, 2] @ car[:, 2] / (car[:, 2] @ car[:, 2]))
    like = float(np.corrcoef(seen[:, 2], car[:, 2])[0, 1]) if np.ptp(seen[:, 2]) > 0.0 else 0.0
    return _length(scale) or _turning(drive, turn, like) or _direction(seen, way)


def _length(scale: float) -> Wrong | None:
    expected = "as far as the wheels went"
    if scale < STILL:
        return Wrong("the poses stand while the car drives", f"{scale:.3f} of its way", expected)
    for unit, factor in LENGTHS.items():
        if abs(scale / factor - 1.0) < LENGTH_WITHIN:
            return Wrong(f"the poses are told in {unit}", f"{scale:.0f} times the car's way",
                         "metres", f"units={unit}")
    return None


def _turning(drive: Drive, turn: float, like: float) -> Wrong | None:
    degrees = 180.0 / math.pi
    if like > 0.9 and abs(turn - 1.0) < ANGLE_WITHIN:
        return None
    if abs(like) > 0.9 and abs(abs(turn) / degrees - 1.0) < ANGLE_WITHIN:
        return Wrong("the yaw is told in degrees", f"{turn:+.0f} times the car's turn", "radians",
                     "angle=deg" if turn > 0.0 else "angle=deg&hand=left")
    if like < -0.9 and abs(turn + 1.0) < ANGLE_WITHIN:
        return Wrong("the frame is left-handed, or its z points down", "it turns the other way "
                     "round than the car", "counter-clockwise positive, z up", "hand=left")
    places = drive.seen[:, :2] - drive.seen[:, :2].mean(axis=0)
    size = np.linalg.svd(places, compute_uv=False)
    if abs(turn) < ANGLE_WITHIN and size[1] < FLAT * size[0]:
        return Wrong("the vertical axis of the frame is not z: it is y-up", "places along one "
                     "line, and a yaw that stays, while the car turned", "z up: set it in the "
                     "source's settings, or send x, -z and the turn about y")
    return Wrong("the poses are of another body than this car", f"{turn:+.2f} times its turn, "
                 f"correlation {like:+.2f}", "1 times, correlation 1: name the car's body",
                 "body=NAME")


def _direction(seen: FloatArray, way: FloatArray) -> Wrong | None:
    """By where the body goes, seen from the middle of each step."""
    moved = way > 0.5 * np.median(way[way > 0.0])
    beside = np.exp(1j * (np.arctan2(seen[moved, 1], seen[moved, 0])))
    mean = complex(np.mean(beside))
    if abs(mean) < ALONG:
        return Wrong("an axis of the frame is mirrored, or x and y are swapped", "places do not "
                     "go where the yaw points", "right-handed x and y with a yaw from x to y")
    angle = math.degrees(np.angle(mean))
    if abs(angle) > math.degrees(AHEAD):  # to 5 deg: the rest is the marker's yaw
        return Wrong("the body's x axis is not the car's nose", f"it moves {angle:+.0f} deg "
                     "beside it", "straight ahead", f"turn={5 * round(angle / 5.0)}")
    return None


def _steps(t: FloatArray, pose: FloatArray) -> FloatArray:
    """Motions (k, 3) over ``STEP``: along and across the nose in the middle, and turn."""
    at = np.arange(t[0], t[-1], STEP)
    x, y, yaw = (np.interp(at, t, pose[:, i]) for i in range(3))
    dx, dy, turn = np.diff(x), np.diff(y), np.diff(yaw)
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    c, s = np.cos(middle), np.sin(middle)
    return np.column_stack([c * dx + s * dy, -s * dx + c * dy, turn])
