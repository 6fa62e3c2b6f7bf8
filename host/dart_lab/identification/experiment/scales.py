"""Scale errors of the sensors in the errors of a fit.

They are common to all samples, so the residuals do not show them: a speed that reads 0.3 % too
much makes every force 0.3 % too large, however long the drive is.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from dart_hal.core.config import CarFiles
from dart_lab.identification.fit import SubmodelFit

# Power of the speed's scale in a parameter (c and e are forces per speed: none).
SPEED_POWERS = {"a": 1.0, "b": -1.0, "q": -1.0, "d": 1.0,
                "a_left_rad": -1.0, "a_right_rad": -1.0}
GYRO_POWERS = {"a_left_rad": 1.0, "a_right_rad": 1.0}
# Standard deviation of an uncalibrated BNO055 (data sheet: 1 % typical).
UNKNOWN_GYRO_SCALE = 0.006
# Standard deviation of the oscillator of a PCA9685 that was not measured.
UNKNOWN_CLOCK = 0.04


def add_scale_errors(fit: SubmodelFit, files: CarFiles) -> SubmodelFit:
    """Add the scale errors of encoder, gyro and PWM clock to the covariance of a fit."""
    metres = files.metres_per_edge
    speed = metres.std / metres.value
    imu = files.calibration.imu if files.calibration else None
    gyro = imu.gyro_scale.std if imu and imu.gyro_scale else UNKNOWN_GYRO_SCALE
    names = list(fit.parameters)
    values = np.array([fit.parameters[n].value for n in names])
    shifts = [values * np.array([powers.get(n, 0.0) for n in names]) * std
              for powers, std in ((SPEED_POWERS, speed), (GYRO_POWERS, gyro))]
    shifts.append(np.array([_clock_error(files) if n == "g" else 0.0 for n in names]))
    covariance = fit.covariance.copy()
    for shift in shifts:
        covariance += np.outer(shift, shift)
    if np.array_equal(covariance, fit.covariance):
        return fit
    parameters = {n: replace(e, std=math.hypot(e.std, math.sqrt(max(
        covariance[i, i] - fit.covariance[i, i], 0.0)))) if math.isfinite(e.std) else e
                  for i, (n, e) in enumerate(fit.parameters.items())}
    note = f"the errors include the scale of the encoder, +- {speed:.2%}"
    note += f", of the gyro, +- {gyro:.2%}" if GYRO_POWERS.keys() & set(names) else ""
    note += f", of the PWM clock, +- {_clock_error(files):.4f} of throttle" if "g" in names else ""
    return replace(fit, parameters=parameters, covariance=covariance, notes=(*fit.notes, note))


def _clock_error(files: CarFiles) -> float:
    """Return the error of a throttle of 0.25 by the PWM clock; neutral and span are car.toml's."""
    clock = files.oscillator_hz
    relative = clock.std / clock.value if clock else UNKNOWN_CLOCK
    span = files.config.throttle.span_us
    return relative * (files.neutral_us + 0.25 * span) / span
