"""Stop before obstacles for every program: the lidar withholds forward throttle at the pins.

At each State the nearest echo on the car's path is compared with

    guard_distance + v T + g T^2 / 2 + (v + g T)^2 / (2 a)

with the speed v, its present growth g (0 if it falls), the deceleration a of a car that rolls out
at neutral, and the time T until the motor is at neutral. There are two paths, each as wide as the
car: the arc of the present steering angle, and that on which the car turns now. The echoes are
those of the scans of the last 0.4 s, moved by the car's motion since.

Forward throttle is withheld, too, where nothing shows that the path is free: without a fresh scan,
with few echoes, without the beams ahead, and while the wheel speed is doubted, because the distance
for rolling out is then unknown.

It does not brake, so that backward throttle stays possible, and it detects nothing that the lidar
does not: glass, what is above or below its plane, and what is closer than its range.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from math import inf, radians, tan

import numpy as np

from dart_hal.control.mpc.obstacles import HALF_LENGTH, HALF_WIDTH
from dart_hal.core.config import CarFiles
from dart_hal.core.config.car import Geometry
from dart_hal.core.errors import UsageError
from dart_hal.core.numbers import is_number
from dart_hal.core.timing import PWM_FRAME
from dart_hal.core.types import FloatArray, Scan, State
from dart_hal.devices.lidar.health import MIN_ECHO_SHARE
from dart_hal.devices.links.base import Backend
from dart_hal.vehicle.load import vehicle_of

# m: largest guard distance, the range of small lidars.
MAX_GUARD_DISTANCE = 8.0
# m to each side of the car: noise of the lidar, and a servo that lags behind its command.
SIDE_MARGIN = 0.03
# m more than the limit at which throttle is passed again, so that noise does not switch it.
RELEASE_MARGIN = 0.1
# s from a decision to neutral at the ESC: the frame that is out, the next one, the ESC's own.
REACTION_TIME = 3.0 * PWM_FRAME
# s more until the motor no longer pulls, at least: a model may have no throttle delay, or one that
# its recordings did not determine. With 0.15 s simulated cars came 0.03 m nearer to a wall.
MOTOR_TIME = 0.25
# m/s2 of a car that rolls out: the paper's has 1.0, and simulated cars roll 0.9 m from 1 m/s, the
# motor's lag included.
GUARD_DECELERATION = 0.6
# m/s from which the yaw rate shows the arc: at 0.3 its noise of 4e-3 rad/s is 0.013 1/m.
MIN_ARC_SPEED = 0.3
# s since its last beam after which a scan no longer counts: three revolutions at 8 per second,
# two at the 5.5 of an RPLidar.
MAX_SCAN_AGE = 0.4
# rad between two received beams ahead: 1 m away the car with its margins is 14 degrees wide.
MAX_BEAM_GAP = radians(10.0)
# rad to each side in which beams are required: within the view of a depth camera.
HALF_VIEW = radians(40.0)
# 1/m below which an arc is a straight line.
MIN_CURVATURE = 1e-3


class ObstacleGuard:
    """Decides at each State whether forward throttle is withheld.

    distance [m]: from the front of the car to the obstacle, at rest.
    """

    def __init__(self, distance: float, files: CarFiles) -> None:
        geometry = files.config.geometry
        self._distance = distance
        self._wheelbase = geometry.wheelbase
        self._half_width = half_width(geometry) + SIDE_MARGIN
        self._front = distance_to_front(geometry)
        delay = vehicle_of(files.model).delay
        self._reaction = REACTION_TIME + max(delay.throttle_s + delay.throttle_lag_s, MOTOR_TIME)
        self._blocked = True
        self._newest: Scan | None = None
        self._scans: deque[Scan] = deque()
        # (n, 3): time [s], x and y [m] in the car's axes at that time.
        self._echoes: FloatArray = np.zeros((0, 3))
        self._sees_ahead = False

    def blocks(self, state: State) -> bool:
        """Return whether forward throttle is withheld at this State."""
        self._take_scan(state.scan, state.t)
        if not self._sees_ahead or state.health.speed_doubted:
            self._blocked = True
            return True
        speed = max(state.speed, 0.0)
        growth = max(state.accel_x or 0.0, 0.0)
        reaction = self._reaction
        fastest = speed + growth * reaction
        limit = (self._distance + speed * reaction + 0.5 * growth * reaction**2
                 + 0.5 * fastest**2 / GUARD_DECELERATION
                 + (RELEASE_MARGIN if self._blocked else 0.0))
        curvatures = [tan(state.applied.steering) / self._wheelbase]
        if state.yaw_rate is not None and speed > MIN_ARC_SPEED:
            curvatures.append(state.yaw_rate / speed)
        points = self._move_echoes(state.t, speed, state.yaw_rate or 0.0)
        self._blocked = any(self._free_distance(points, curvature) < limit
                            for curvature in curvatures)
        return self._blocked

    def _take_scan(self, scan: Scan | None, t: float) -> None:
        """Take over a new scan, and forget those that are too old at t [s]."""
        scans = self._scans
        is_changed = False
        if scan is not None and len(scan) > 0 and scan is not self._newest:
            self._newest = scan
            scans.append(scan)
            is_changed = True
        while scans and t - float(scans[0].t[-1]) > MAX_SCAN_AGE:
            scans.popleft()
            is_changed = True
        if not is_changed:
            return
        self._sees_ahead = bool(scans) and sees_ahead(scans)
        echoes = [np.column_stack((one.t, one.in_car())) for one in scans]
        table = np.concatenate([np.zeros((0, 3)), *echoes])
        # What is ahead of the rear axle; False for NaN, a beam without an echo.
        self._echoes = table[table[:, 1] > 0.0]

    def _move_echoes(self, t: float, speed: float, yaw_rate: float) -> FloatArray:
        """Return the echoes (n, 2) [m] in the car's axes at t [s], by a constant motion."""
        t_echo, x, y = self._echoes.T
        dt = t - t_echo
        turned = yaw_rate * dt
        x = x - speed * dt
        c = np.cos(turned)
        s = np.sin(turned)
        return np.column_stack((c * x + s * y, c * y - s * x))

    def _free_distance(self, points: FloatArray, curvature: float) -> float:
        """Return the distance [m] from the front to the nearest of the points (n, 2) on the path.

        An echo that was behind the front when it was measured is a part of the car, or at its side.
        One that the car has reached since has a distance below 0.
        """
        was_ahead = self._echoes[:, 1] > self._front
        free = distance_to_contact(points[was_ahead], curvature, self._front, self._half_width)
        return float(np.min(free, initial=inf))


def sees_ahead(scans: Sequence[Scan]) -> bool:
    """Return whether enough beams have an echo, and no received beam ahead is far from the next."""
    if np.mean(np.isfinite(np.concatenate([scan.distance for scan in scans]))) < MIN_ECHO_SHARE:
        return False
    bearing = np.sort(np.concatenate([scan.bearing for scan in scans]))
    ahead = bearing[np.abs(bearing) < HALF_VIEW]
    gaps = np.diff(ahead, prepend=-HALF_VIEW, append=HALF_VIEW)
    return bool(gaps.max() < MAX_BEAM_GAP)


def distance_to_contact(points: FloatArray, curvature: float, front: float, half_width: float
                        ) -> FloatArray:
    """Return how far (n,) [m] the rear axle may go until the front reaches each point (n, 2) [m].

    inf off the path. The front is at ``front`` [m], ``half_width`` [m] to each side.

    In an arc of radius R a point at r from its centre, and at the angle phi ahead of the axle, is
    at the front once r sin(angle) = front. The outer corner of the front has the largest distance
    from the centre, the inner side the smallest.
    """
    x, y = points.T
    if abs(curvature) < MIN_CURVATURE:
        return np.where(np.abs(y) < half_width, x - front, inf)
    # A bend to the right is mirrored. The centre of the arc is then at (0, radius).
    radius = 1.0 / abs(curvature)
    from_centre = radius - (y if curvature > 0.0 else -y)
    r = np.maximum(np.hypot(x, from_centre), 1e-9)
    inner = radius - half_width
    outer = np.hypot(radius + half_width, front)
    # Angle of a point at the front, or at the inner side if that comes to it later.
    reached = np.minimum(np.arcsin(np.minimum(front / r, 1.0)),
                         np.arccos(np.clip(inner / r, -1.0, 1.0)))
    angle = np.arctan2(x, from_centre) - reached
    return np.where((r > inner) & (r < outer), radius * angle, inf)


def distance_to_front(geometry: Geometry) -> float:
    """Return the distance [m] from the rear axle to the front of the car."""
    length = 2.0 * HALF_LENGTH if geometry.length is None else geometry.length
    return 0.5 * (geometry.wheelbase + length)


def half_width(geometry: Geometry) -> float:
    """Return half of the car's width [m]."""
    return HALF_WIDTH if geometry.width is None else 0.5 * geometry.width


def make_obstacle_guard(distance: float, backend: Backend, files: CarFiles) -> ObstacleGuard:
    """Make the guard of a car.

    Raises UsageError for a distance that is none, and for a car without a lidar.
    """
    if not is_number(distance) or not 0.0 < distance <= MAX_GUARD_DISTANCE:
        raise UsageError("guard_distance is no distance", found=repr(distance),
                         expected=f"metres, above 0 and at most {MAX_GUARD_DISTANCE:g}",
                         remedy="guard_distance=0.3, or leave it out")
    if backend.lidar is None:
        raise UsageError("guard_distance needs a lidar", found=f"{backend.url.text} has none",
                         expected="a lidar that measures the obstacles",
                         remedy="lidar=\"serial:///dev/dart-lidar\", or sim://?lidar=1&map=room")
    geometry = files.config.geometry
    if geometry.length is None or geometry.width is None:
        # The outline is that of DART; what a longer or wider car needs is not known here.
        front = distance_to_front(geometry)
        width = 2.0 * half_width(geometry)
        backend.notices += (
            f"guard_distance assumes a car of {front:.2f} m from rear axle to front, {width:.2f} m "
            "wide: car.toml states no length and width under [geometry]",)
    return ObstacleGuard(float(distance), files)
