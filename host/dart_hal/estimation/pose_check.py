"""Check of external poses against wheels and gyro: wrong units, axes, frame or body.

A correct stream has moved as far as the wheels, turned as much as the gyro, in the same direction,
and has moved where its nose points. Each wrong convention violates one of these by a characteristic
figure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dart_hal.core.types import BoolArray, FloatArray

# s over which motions are compared: noise of 1 mm and 2 mrad is small against 0.1 m and 0.2 rad.
COMPARISON_STEP = 0.2
# m that the car must have driven before anything is reported.
MIN_DISTANCE = 1.5
# rad that it must have turned.
MIN_TURN = 2.0
# Share of the car's distance below which the poses do not move.
MAX_STATIC_SHARE = 0.05
# Factor to metres.
LENGTH_UNITS = {"mm": 1000.0, "cm": 100.0}
# Relative: an uncalibrated car measures distance and turn to a few per cent, and a marker 0.1 m
# off the axle travels a third further in a tight bend.
LENGTH_TOLERANCE = 0.35
ANGLE_TOLERANCE = 0.3
# Length of the mean direction of motion relative to the nose; 1 if it is always the same.
MIN_DIRECTION_LENGTH = 0.8
# rad between both: a slipping car moves up to 10 degrees off its nose.
MAX_NOSE_ANGLE = math.radians(20.0)
# Deviation from the usual ratio, in medians of all deviations, beyond which a pose has jumped:
# seven standard deviations of normal noise.
MAX_JUMP_RATIO = 10.0
# Small over large spread of the places below which a driven circle is seen from its side.
MAX_FLATNESS = 0.03


@dataclass(frozen=True, slots=True)
class PoseComparison:
    """Motion of one drive by the car and by the source.

    t (n,) [s]; car (n, 3) and external (n, 3): x, y [m], yaw [rad] at those times, unwrapped,
    each in its own frame.
    """

    t: FloatArray
    car: FloatArray
    external: FloatArray


@dataclass(frozen=True, slots=True)
class PoseFault:
    """Fault of a stream: found and expected values.

    option: of the source's URL that corrects it, empty if there is none.
    """

    what: str
    found: str
    expected: str
    option: str = ""


def find_fault(drive: PoseComparison) -> PoseFault | None:
    """Return the first fault of the poses, None if they fit the car.

    Raises ValueError for a drive shorter than ``MIN_DISTANCE`` and ``MIN_TURN``.
    """
    car = _motions(drive.t, drive.car)
    external = _motions(drive.t, drive.external)
    distance = np.hypot(car[:, 0], car[:, 1])
    if distance.sum() < MIN_DISTANCE or np.abs(car[:, 2]).sum() < MIN_TURN:
        raise ValueError(f"{distance.sum():.1f} m and {np.abs(car[:, 2]).sum():.1f} rad are "
                         "too little")
    usual = _is_usual(np.hypot(external[:, 0], external[:, 1]), distance) & _is_usual(
        external[:, 2], car[:, 2])
    car = car[usual]
    external = external[usual]
    distance = distance[usual]
    scale = float(np.hypot(external[:, 0], external[:, 1]).sum() / distance.sum())
    turn = float(external[:, 2] @ car[:, 2] / (car[:, 2] @ car[:, 2]))
    turns = np.ptp(external[:, 2]) > 0.0
    correlation = float(np.corrcoef(external[:, 2], car[:, 2])[0, 1]) if turns else 0.0
    return (_check_length(scale) or _check_turn(drive, turn, correlation)
            or _check_direction(external, distance))


def _is_usual(external: FloatArray, car: FloatArray) -> BoolArray:
    """Return whether each motion (k,) of the source is in the usual ratio to that of the car.

    Single poses that jump are no convention: the fit after this check is robust against them.
    """
    moved = np.abs(car) > 0.5 * np.median(np.abs(car))
    ratio = float(np.median(external[moved] / car[moved]))
    deviation = np.abs(external - ratio * car)
    return np.asarray(deviation <= MAX_JUMP_RATIO * np.median(deviation) + 1e-9)


def _check_length(scale: float) -> PoseFault | None:
    """Compare distances: static poses, or another unit of length."""
    expected = "the distance of the wheels"
    if scale < MAX_STATIC_SHARE:
        return PoseFault("the poses do not move while the car drives",
                         f"{scale:.3f} of its distance", expected)
    for unit, factor in LENGTH_UNITS.items():
        if abs(scale / factor - 1.0) < LENGTH_TOLERANCE:
            return PoseFault(f"the poses are in {unit}", f"{scale:.0f} times the car's distance",
                             "metres", f"units={unit}")
    return None


def _check_turn(drive: PoseComparison, turn: float, correlation: float) -> PoseFault | None:
    """Compare turns: degrees, a left-handed frame, a y-up frame, or another body."""
    degrees = 180.0 / math.pi
    if correlation > 0.9 and abs(turn - 1.0) < ANGLE_TOLERANCE:
        return None
    if abs(correlation) > 0.9 and abs(abs(turn) / degrees - 1.0) < ANGLE_TOLERANCE:
        return PoseFault("the yaw is in degrees", f"{turn:+.0f} times the car's turn", "radians",
                         "angle=deg" if turn > 0.0 else "angle=deg&hand=left")
    if correlation < -0.9 and abs(turn + 1.0) < ANGLE_TOLERANCE:
        return PoseFault("the frame is left-handed, or its z points down", "it turns the other way "
                         "round than the car", "counter-clockwise positive, z up", "hand=left")
    places = drive.external[:, :2] - drive.external[:, :2].mean(axis=0)
    size = np.linalg.svd(places, compute_uv=False)
    if abs(turn) < ANGLE_TOLERANCE and size[1] < MAX_FLATNESS * size[0]:
        return PoseFault("the vertical axis of the frame is not z: it is y-up", "places along one "
                         "line, and a yaw that stays, while the car turned", "z up: set it in the "
                         "source's settings, or send x, -z and the turn about y")
    return PoseFault("the poses are of another body than this car", f"{turn:+.2f} times its turn, "
                     f"correlation {correlation:+.2f}",
                     "1 times, correlation 1: name the car's body", "body=NAME")


def _check_direction(external: FloatArray, distance: FloatArray) -> PoseFault | None:
    """Compare the direction of motion with the nose, in the middle of each step."""
    moved = distance > 0.5 * np.median(distance[distance > 0.0])
    direction = np.exp(1j * (np.arctan2(external[moved, 1], external[moved, 0])))
    mean = complex(np.mean(direction))
    if abs(mean) < MIN_DIRECTION_LENGTH:
        return PoseFault("an axis of the frame is mirrored, or x and y are swapped",
                         "places do not go where the yaw points",
                         "right-handed x and y with a yaw from x to y")
    angle = math.degrees(np.angle(mean))
    if abs(angle) > math.degrees(MAX_NOSE_ANGLE):  # to 5 deg: the rest is the marker's yaw
        return PoseFault("the body's x axis is not the car's nose", f"it moves {angle:+.0f} deg "
                         "off it", "straight ahead", f"turn={5 * round(angle / 5.0)}")
    return None


def _motions(t: FloatArray, pose: FloatArray) -> FloatArray:
    """Motions (k, 3) per ``COMPARISON_STEP``: along and across the mean heading, and turn."""
    times = np.arange(t[0], t[-1], COMPARISON_STEP)
    x, y, yaw = (np.interp(times, t, pose[:, i]) for i in range(3))
    dx = np.diff(x)
    dy = np.diff(y)
    turn = np.diff(yaw)
    middle = 0.5 * (yaw[1:] + yaw[:-1])
    c = np.cos(middle)
    s = np.sin(middle)
    return np.column_stack([c * dx + s * dy, -s * dx + c * dy, turn])
