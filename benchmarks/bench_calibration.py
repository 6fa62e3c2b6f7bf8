"""What a calibration of the steering costs: time at the computer, time at the car."""

from __future__ import annotations

import time

from figures import Figure

from dart_hal.calibration.steering import calibrate_steering
from dart_hal.car import Car

URL = "sim://?seed=7&nano=avr"


def figures(scale: float = 1.0) -> list[Figure]:
    """All rows; below a ``scale`` of 0.1 with fewer angles, as few as the fit takes."""
    short = {"levels": 9} if scale < 0.1 else {}
    start = time.process_time()
    with Car.open(URL) as car:
        begin = car._engine.now
        calibrate_steering(car, dry_run=True, **short)
        driven = car._engine.now - begin
    spent = time.process_time() - start
    return [Figure("calibrate steering: CPU time", spent, "s",
                   note=f"{driven / spent:.1f} x real time, the fit included"),
            Figure("calibrate steering: time of the car", driven, "s")]
