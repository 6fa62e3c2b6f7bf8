"""Measure the effect of a better servo and a LiPo battery by a minute of driving with each.

The authors of DART replaced the kit's servo, for a steadier steering angle,
and fed servo and motor from a LiPo battery, for a steadier acceleration. They
give no figures: play in the steering and force lost over time are assumed
here, hidden in an emulated car, and taken away. `diagnose` is told of neither.

    python examples/what_two_upgrades_bought.py [seconds]
"""

import os
import sys
import tempfile
from dataclasses import replace
from math import pi
from pathlib import Path

from dart_hal import Car, PurePursuit, figure_of_eight, find_model, read_run
from dart_lab import apply, check_inputs, diagnose

NANO = os.environ.get("DART_NANO", "avr")  # mock: no firmware, faster
KIT = "steering_backlash:0.1,battery_fade:-0.15"  # rad, share of the force per 100 s
CARS = {"before": f"sim://?nano={NANO}&effect={KIT}", "after": f"sim://?nano={NANO}"}
ONLY = ()  # effects that may be named; () = all
THROTTLE, HOLD = (0.26, 0.23), 4.0  # -1..1, one after the other, s each
RADIUS, LOOK_AHEAD = 0.9, 0.3  # m
PULSE = 0.013  # s, in the mean: 1 ms to hear of a frame, 10 to the next PWM frame, 2 of the pulse
SERVO = 375.0 * pi / 2000.0 / 6.0  # s for a command of 1: 375 us, a horn of 6 rad/s


def known_model():
    """(file, vehicle): the paper's car with the timing of its parts."""
    file, p = find_model("paper")
    delay = replace(p.delay, steering_s=PULSE, throttle_s=PULSE)
    return file, apply(replace(p, delay=delay), "steering_rate_limit", k=SERVO)


def drive(url, run, seconds):
    """(rms offset [m], mean speed at first, at last [m/s]): eights at two levels of throttle."""
    rows = []
    with Car.open(url, record=run) as car:
        pursuit = PurePursuit(figure_of_eight(RADIUS), car.files.config.geometry.wheelbase,
                              LOOK_AHEAD, 0.0)
        car.arm()
        for s in car.states(duration=seconds):
            car.drive(steering=pursuit.steer(s.pose, s.speed, s.yaw_rate or 0.0),
                      throttle=THROTTLE[int(0.01 * len(rows) / HOLD) % len(THROTTLE)])
            rows.append((pursuit.offset, s.speed))
    n = round(100 * HOLD * len(THROTTLE))
    offset, speed = zip(*rows[n // 2:], strict=True)
    return (sum(o * o for o in offset) / len(offset))**0.5, sum(speed[:n]) / n, sum(speed[-n:]) / n


def diagnosed(run):
    """What the drive shows, with the car's own sensors."""
    file, base = known_model()
    sides = check_inputs([read_run(run)], [], base)
    return diagnose(file, base, sides.train, sides.test, refit=False, only=ONLY, max_causes=2)


def main(seconds=60.0):
    """{car: (diagnosis, rms offset [m], speed at first, at last [m/s])}."""
    seen = {}
    print("         off the path      speed at first, at last   found")
    with tempfile.TemporaryDirectory() as folder:
        for name, url in CARS.items():
            run = Path(folder) / f"{name}.mcap"
            rms, first, last = drive(url, run, seconds)
            found = diagnosed(run)
            causes = [f"{c.effect} {k.value:.3f} +- {k.std:.1g} {k.unit}"
                      for c in found.causes for k in c.parameters.values()]
            print(f"{name:8} {1e3 * rms:6.1f} mm rms   {first:7.2f}, {last:.2f} m/s          "
                  f"{', '.join(causes) or found.verdict.replace('_', ' ')}")
            seen[name] = found, rms, first, last
    return seen


if __name__ == "__main__":
    main(*map(float, sys.argv[1:]))
