"""What the scales of the sensors add to a fit's errors: common to all samples, so no fit sees it.

A speed that reads 0.3 % too much makes every force 0.3 % too large, however
long the drive was.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dart_hal.core.config import CarFiles
from dart_lab.identification.fit import Fit

BY_SPEED = {"a": 1.0, "b": -1.0, "q": -1.0, "d": 1.0,
            "a_left_rad": -1.0, "a_right_rad": -1.0}
"""Power of the scale of the speed in a parameter (c and e are forces by speed: none)."""
BY_GYRO = {"a_left_rad": 1.0, "a_right_rad": 1.0}
UNKNOWN_GYRO_SCALE = 0.006
"""One sigma of an uncalibrated BNO055 (data sheet: 1 % typical)."""
UNKNOWN_CLOCK = 0.04
"""One sigma of the oscillator of a PCA9685 that nobody has measured."""


def with_scales(fit: Fit, files: CarFiles) -> Fit:
    """The fit with the scale errors of encoder and gyro in its covariance."""
    metres = files.metres_per_edge
    speed = metres.std / metres.value
    imu = files.calibration.imu if files.calibration else None
    gyro = imu.gyro_scale.std if imu and imu.gyro_scale else UNKNOWN_GYRO_SCALE
    names = list(fit.parameters)
    values = np.array([fit.parameters[n].value for n in names])
    shifts = [values * np.array([powers.get(n, 0.0) for n in names]) * std
              for powers, std in ((BY_SPEED, speed), (BY_GYRO, gyro))]
    shifts.append(np.array([_clock(files) if n == "g" else 0.0 for n in names]))
    covariance = fit.covariance.copy()
    for shift in shifts:
        covariance += np.outer(shift, shift)
    if np.array_equal(covariance, fit.covariance):
        return fit
    parameters = {n: replace(e, std=math.hypot(e.std, math.sqrt(max(
        covariance[i, i] - fit.covariance[i, i], 0.0)))) if math.isfinite(e.std) else e
        for i, (n, e) in enumerate(fit.parameters.items())}
    said = f"the errors include the scale of the encoder, +- {speed:.2%}"
    said += f", of the gyro, +- {gyro:.2%}" if BY_GYRO.keys() & set(names) else ""
    said += f", of the PWM clock, +- {_clock(files):.4f} of throttle" if "g" in names else ""
    return replace(fit, parameters=parameters, covariance=covariance, notes=(*fit.notes, said))


def _clock(files: CarFiles) -> float:
    """Error of the throttle [-1..1] at 0.25 by the PWM clock; neutral and span are car.toml's."""
    clock = files.oscillator_hz
    relative = clock.std / clock.value if clock else UNKNOWN_CLOCK
    span = files.config.throttle.span_us
    return relative * (files.neutral_us + 0.25 * span) / span
