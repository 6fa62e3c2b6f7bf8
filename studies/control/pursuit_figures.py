"""Pure pursuit as DART's authors have it, on the light simulation of the later published set.

    python -m studies.control.pursuit_figures [--laps 3]

10 Hz: the pose of the centre of mass, predicted by 0.165 s at its speed and yaw rate; a target
0.6 m further along the path; delta = atan2(2 L sin alpha, l_d), L = 0.175 m,
l_d = sqrt(distance^2 + 0.001); the command by the inverse of the
steering map. Speed: their table of feed-forward, and 0.2 of the error within 0.1. rms and largest
error of that point beside the 22.92 m track behind 3 m.
"""

from __future__ import annotations

import argparse
from math import atan2, cos, hypot, sin

import numpy as np

from dart_hal.control.tracks import track_named
from dart_hal.vehicle.steering import make_steering
from dart_lab.sim.light import LightCar
from studies.control.mpc_loop import P, figures

AHEAD, PREDICTED, LENGTH, EVERY = 0.6, 0.165, 0.175, 0.1
TAU = (0.0, .20, .21, .22, .23, .24, .25, .26, .27, .28, .29, .30, .31, .32, .35, .40)
SPEED = (0.189, .19, .38, .61, .85, 1.0, 1.19, 1.32, 1.64, 1.75, 1.91, 1.99, 2.11, 2.19, 2.6, 3.15)


def lap(speed: float, laps: float = 3.0, predicted: float = PREDICTED) -> tuple[float, float]:
    """(rms, largest) error [m] at a set speed [m/s]; predicted [s]."""
    path, car, s, rows = track_named("racetrack_vicon_2"), LightCar(P), 0.0, []
    commands = np.linspace(-1.0, 1.0, 100)
    angles = make_steering(P.steering, np)(commands)
    car.reset(path.x[0], path.y[0], path.heading[0])
    while s < laps * path.length and car.t < 60.0 * laps:
        x, y, yaw, v, _, omega = car.state[:6]
        x, y, yaw = (x + v * cos(yaw) * predicted, y + v * sin(yaw) * predicted,
                     yaw + omega * predicted)
        target = path.interpolate(path.closest(x, y, s) + AHEAD)
        dx, dy = target.x - x, target.y - y
        alpha = atan2(dy, dx) - yaw
        angle = atan2(2.0 * LENGTH * sin(alpha), (hypot(dx, dy) ** 2 + 0.001) ** 0.5)
        steering = float(np.interp(angle, angles, commands))
        throttle = np.interp(speed, SPEED, TAU) + min(max(0.2 * (speed - v), -0.1), 0.1)
        for _ in range(round(EVERY / car.config.step)):
            car.advance(float(throttle), steering)
            x, y = car.state[:2]
            s = path.closest(x, y, s)
            rows.append((car.t, s, path.offset(x, y, s)))
        if abs(rows[-1][2]) > 1.0:
            break
    return figures(np.array(rows))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--laps", type=float, default=3.0)
    given = parser.parse_args()
    for predicted in (PREDICTED, 0.0):
        for speed in (1.0, 1.5, 2.0):
            rms, most = lap(speed, given.laps, predicted)
            print(f"{speed} m/s, {predicted:g} s predicted: {100.0 * rms:.2f} / "
                  f"{100.0 * most:.1f} cm", flush=True)


if __name__ == "__main__":
    main()
