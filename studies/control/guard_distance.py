"""Where cars come to rest with ``guard_distance``: distances to the nearest echo ahead.

    python -m studies.control.guard_distance         a minute of CPU

Simulated cars that were not calibrated drive straight on in two rooms until the lidar withholds the
throttle. A line has the room, the seed, the target speed, the largest speed [m/s] and the distance
[m] from the front to the nearest echo in the width of the car.
"""

from __future__ import annotations

from itertools import product

import numpy as np

from dart_hal.car import Car
from dart_hal.car.obstacle_guard import distance_to_front

DISTANCE = 0.4
SEEDS = (1, 2, 4, 5)
SPEEDS = (0.5, 1.0, 2.0)
"""m/s"""
HALF_WIDTH = 0.13
"""m to each side of the axis of the car."""


def approach(room: str, seed: int, speed: float) -> tuple[float, float]:
    """Return (largest speed [m/s], distance at rest [m]) of one drive."""
    url = f"sim://?seed={seed}&nano=mock&lidar=1&map={room}"
    fastest = 0.0
    with Car.open(url, guard_distance=DISTANCE) as car:
        car.arm()
        for state in car.states(duration=9.0):
            car.drive_speed(steering=0.0, speed=speed)
            fastest = max(fastest, state.speed)
        assert state.scan is not None
        x, y = state.scan.in_car().T
        front = distance_to_front(car.files.config.geometry)
    ahead = x[(np.abs(y) < HALF_WIDTH) & (x > HALF_WIDTH)]
    return fastest, float(np.min(ahead)) - front


def main() -> None:
    """Print a line for each drive, and the range of the distances."""
    distances = []
    for room, seed, speed in product(("room", "hall"), SEEDS, SPEEDS):
        fastest, distance = approach(room, seed, speed)
        distances.append(distance)
        print(f"{room} {seed} {speed:.1f} {fastest:.2f} {distance:.2f}", flush=True)
    print(f"{min(distances):.2f} to {max(distances):.2f} m of {DISTANCE} m")


if __name__ == "__main__":
    main()
