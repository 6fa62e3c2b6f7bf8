"""Cars that have been tracked: what a planner may assume after their track has ended.

    0 to COAST_TIME         it drives on at its last speed, with a growing uncertainty
    until it is forgotten   it is lost: assumed at its last place

A lost car is forgotten after ``FORGET_TIME``, once beams pass through its last place. A new track
at the place where it is expected replaces it.
"""

from __future__ import annotations

from math import hypot, sqrt

import numpy as np

from dart_hal.control.traffic import SAME_CAR_DISTANCE, NearbyCar
from dart_hal.core.types import Pose, pose_cov
from dart_hal.estimation.other_cars.rectangle import (
    RANGE_STD,
    CarSize,
    rectangle_distances,
    select_window,
)
from dart_hal.estimation.other_cars.sweep import RoomBeams
from dart_hal.estimation.other_cars.tracker import PossibleCar
from dart_hal.estimation.other_cars.tracks import SPEED_ACCEL_STD, START_STDS, CarTrack

# s after the last beams on a car: it is predicted, and it may be forgotten.
COAST_TIME = 1.5
FORGET_TIME = 3.0
# Beams, and share of those that meet its place, which have to pass through it.
MIN_FREE_BEAMS = 5
MIN_FREE_SHARE = 0.8


def remember_cars(known: tuple[CarTrack, ...], tracks: tuple[CarTrack, ...], sweep: RoomBeams,
                  size: CarSize) -> tuple[CarTrack, ...]:
    """Return the tracks of a sweep and the known cars without a track that may still be there."""
    numbers = {track.number for track in tracks}
    now = float(sweep.t[-1]) if len(sweep.t) else -np.inf
    kept = []
    for car in known:
        if car.number in numbers:
            continue
        place = car.predict(min(now, car.hit_t + COAST_TIME)).mean
        if any(hypot(*(track.mean[:2] - place[:2])) < SAME_CAR_DISTANCE for track in tracks):
            continue
        if now - car.hit_t < FORGET_TIME or not is_place_free(car, sweep, size):
            kept.append(car)
    return (*tracks, *kept)


def is_place_free(car: CarTrack, sweep: RoomBeams, size: CarSize) -> bool:
    """Return whether the beams that meet the last place of a car pass through it."""
    yaw = float(car.mean[2])
    centre = car.mean[:2] + size.centre_x * np.array((np.cos(yaw), np.sin(yaw)))
    window = select_window(sweep, centre, size)
    if not len(window.t):
        return False
    distance = rectangle_distances(car.mean[None, :3], size, window)[0]
    met = np.isfinite(distance)
    passing = met & (window.range > distance + 3.0 * RANGE_STD)
    return bool(passing.sum() >= MIN_FREE_BEAMS and passing.sum() >= MIN_FREE_SHARE * met.sum())


def list_nearby(cars: tuple[CarTrack, ...], t: float) -> list[NearbyCar]:
    """Return the cars for the traffic rules at t [s].

    The standard error along the path is sqrt((std_v age)^2 + (std_a age^2 / 2)^2).
    """
    nearby = []
    for car in cars:
        age = max(t - car.t, 0.0)
        x, y, yaw, speed, _ = car.mean.tolist()
        speed_std = sqrt(float(car.cov[3, 3]))
        nearby.append(NearbyCar(
            f"car {car.number}", Pose(x, y, yaw, car.cov[:3, :3]), speed, age,
            t - car.hit_t > COAST_TIME, speed_std,
            hypot(speed_std * age, 0.5 * SPEED_ACCEL_STD * age * age)))
    return nearby


def list_possible(possible: tuple[PossibleCar, ...], size: CarSize) -> list[NearbyCar]:
    """Return possible cars for the traffic rules: at rest, at an unknown heading."""
    x_std, y_std = START_STDS[:2]
    return [NearbyCar("possible car", Pose(float(one.centre[0]) - size.centre_x,
                                           float(one.centre[1]), 0.0, pose_cov(x_std, y_std)),
                      0.0, 0.0, False, confirmed=False) for one in possible]
