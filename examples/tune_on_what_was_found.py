"""Tune a controller on a model, and on the same model with what `diagnose` found; drive both.

The emulated car steers more slowly than its model says. One recorded drive
shows it, the diagnosis names it, and pure pursuit tuned on the extended model
follows a figure of eight on which the one tuned on the base model swings.

    python examples/tune_on_what_was_found.py [model.toml]

Another car: DART_HAL_URL="sim://?nano=mock&effect=steering_lag:0.06" (mock: no firmware, faster).
"""

import os
import sys
import tempfile
from dataclasses import replace
from itertools import product
from math import cos, pi, sin
from pathlib import Path

from dart_hal import (
    Car,
    Pose,
    PurePursuit,
    SpeedLaw,
    figure_of_eight,
    find_model,
    read_run,
    steering_map,
)
from dart_lab import Floor, LightCar, apply, check_inputs, conduct, diagnose, make_plan

URL = os.environ.get("DART_HAL_URL", "sim://?effect=steering_lag:0.12")
ONLY = ()  # effects that may be named; () = all
SPEED, PATH, LOST = 1.2, figure_of_eight(0.9), 0.5  # m/s; m; m beside it: the end of a drive
SECONDS = 2 * PATH.length / SPEED
LOOK_AHEAD, PREDICTION = (0.15, 0.2, 0.25, 0.3, 0.4), (0.0, 0.04, 0.08, 0.12)  # m, s
MARGIN = 0.04  # s of delay beyond the model's that a controller must stand
PULSE = 0.013  # s, in the mean: 1 ms to hear of a frame, 10 to the next PWM frame, 2 of the pulse
SERVO = 375.0 * pi / 2000.0 / 6.0  # s for a command of 1: 375 us, a horn of 6 rad/s


def known_model(name=None):
    """(file, vehicle): a model.toml; without one the paper's car with the timing of its parts."""
    file, p = find_model(name or "paper")
    if name:
        return file, p
    delay = replace(p.delay, steering_s=PULSE, throttle_s=PULSE)
    return file, apply(replace(p, delay=delay), "steering_rate_limit", k=SERVO)


def probe(file, base, run):
    """(files of the car, diagnosis of a recorded drive: steps of the steering at two speeds)."""
    with Car.open(URL, record=run) as car:
        conduct(car, make_plan("steps", car.files, Floor.parse("10"), None))
    sides = check_inputs([read_run(run)], [], base)
    return car.files, diagnose(file, base, sides.train, sides.test, refit=False, only=ONLY,
                               max_causes=2)


def rms(offsets):
    """Root mean square [m], once the car is up to speed; LOST for a car that left the path."""
    rest = offsets[150:]
    return LOST if max(map(abs, offsets)) >= LOST else (sum(o * o for o in rest) / len(rest))**0.5


def drive(look_ahead, prediction):
    """Drive the laps on the car; rms offset from the path [m] by its own odometry."""
    offsets = [0.0]
    with Car.open(URL) as car:
        pursuit = PurePursuit(PATH, car.files.config.geometry.wheelbase, look_ahead, prediction)
        car.arm()
        for s in car.states(duration=SECONDS):
            steering = pursuit.steer(s.pose, s.speed, s.yaw_rate or 0.0)
            car.drive_speed(steering=steering, speed=SPEED)
            offsets.append(pursuit.offset)
            if abs(pursuit.offset) >= LOST:
                break
    return rms(offsets)


def simulate(p, files, look_ahead, prediction):
    """The same by the model p, with the odometry that wheels and gyro would give."""
    car, law, steering = LightCar(p), SpeedLaw(p), steering_map(files.config, None)
    pursuit = PurePursuit(PATH, files.config.geometry.wheelbase, look_ahead, prediction)
    offsets, x, y = [0.0], 0.0, 0.0
    while car.t < SECONDS and abs(offsets[-1]) < LOST:
        yaw, speed, _, yaw_rate = car.state[2:6]
        x, y = x + 0.01 * speed * cos(yaw), y + 0.01 * speed * sin(yaw)
        angle = pursuit.steer(Pose(x, y, yaw), speed, yaw_rate)
        car.advance(law.throttle(SPEED, speed, 0.01), steering.command_of(angle))
        offsets.append(pursuit.offset)
    return rms(offsets)


def tuned(p, files):
    """(rms offset [m], look-ahead [m], prediction [s]): best at worst, with margin or without."""
    late = replace(p, delay=replace(p.delay, steering_s=p.delay.steering_s + MARGIN))
    return min((max(simulate(m, files, *k) for m in (p, late)), *k)
               for k in product(LOOK_AHEAD, PREDICTION))


def main(model=None):
    """(what was found, {model: rms offset driven [m]})."""
    file, base = known_model(model)
    with tempfile.TemporaryDirectory() as folder:
        files, found = probe(file, base, Path(folder) / "steps.mcap")
    for effect, k in ((c.effect, k) for c in found.causes for k in c.parameters.values()):
        print(f"found {effect} {k.value:.3g} +- {k.std:.1g} {k.unit}")
    driven = {}
    for name, p in (("base", base), ("extended", found.extended)):
        expected, *k = tuned(p, files)
        driven[name] = drive(*k)
        print(f"tuned on the {name} model: look-ahead {k[0]:.2f} m, prediction {k[1]:.2f} s; rms "
              f"offset {1e3 * expected:.1f} mm at worst by it, {1e3 * driven[name]:.1f} mm driven")
    print(f"ratio {driven['base'] / driven['extended']:.1f}")
    return found, driven


if __name__ == "__main__":
    main(*sys.argv[1:])
