"""Estimate of the error of a car's steering while it drives: offset-free control.

A model whose tyres or steering map are 5 % off plans bends that the car does not drive. A plan from
the present state never corrects that: the car drives 5 cm outside all the time. The textbook
solution is a disturbance of the input that is estimated with the state and included in the plan.
Here a command c acts as

    c + offset + left max(c, 0) + right min(c, 0)

with an offset (backlash, trim) and a gain error to either side (tyres, map), so that nothing has to
be estimated again in the next bend. A Kalman filter with a random walk finds the three from the yaw
rate, because above walking pace the lateral motion settles quickly: the yaw rate is that of a
steady bend.

The yaw rate nevertheless lags behind the wheels (``SteeringDelay.yaw_delay``), so the model's yaw
rate and the regressors are filtered with the same lag. Without that, the lag in turning in looks
like a loss of gain, and the lag in turning back, at 0 where the gain does not show, like an offset:
every gain falls, on any car. Cars without an identified model need this filter. Cars with one are
slightly more accurate without it (``docs/results/design_notes.md``); all use it. While the bend
changes, the noise of the measurement is increased by the difference between the steady and the
filtered yaw rate, because the servo speed of few cars is known.

G. Pannocchia, J. B. Rawlings, "Disturbance models for offset-free model-predictive control", AIChE
Journal 49 (2003).
"""

from __future__ import annotations

from math import exp

import numpy as np

from dart_hal.control.plant import MotionPrediction, Plant
from dart_hal.core.types import FloatArray, MotionEstimate

# Standard deviations before a drive: a backlash of 2 deg is 0.05 of the command to either side; the
# identified stiffness of the front tyres is 5 to 10 % off.
INITIAL_STD = (0.05, 0.1, 0.1)
# Growth of each standard deviation [1/sqrt(s)]: another speed, another floor.
RANDOM_WALK_STD = 0.03
# Deviation of the yaw rate from a steady bend [rad/s] and its correlation time [s], while the
# steering moves.
YAW_RATE_STD = 0.15
NOISE_CORRELATION_TIME = 0.1
# Minimum speed [m/s]; below it the noise of the yaw rate hides the curvature.
MIN_LEARNING_SPEED = 0.4
# Largest absolute value of each error.
MAX_ERROR = 0.3


class SteeringDisturbance:
    """Offset and gain errors (3,) of the steering command of a plant.

    ``update`` with every measurement; ``effective`` and ``command`` convert between the command
    that is sent and the command for the model.
    """

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self.reset()

    def reset(self) -> None:
        """Forget the estimate."""
        self.value: FloatArray = np.zeros(3)
        self._covariance: FloatArray = np.diag(np.square(INITIAL_STD))
        self._filtered: FloatArray = np.zeros(4)

    def effective(self, command: float) -> float:
        """Return the command of the model that acts as the command -1..1."""
        return command + float(self.value @ _regressors(command))

    def command(self, effective: float) -> float:
        """Return the command -1..1 that acts as an effective command."""
        offset, left, right = self.value
        remainder = effective - float(offset)
        return remainder / (1.0 + float(left if remainder > 0.0 else right))

    def update(self, command: float, speed: float, yaw_rate: float, dt: float) -> None:
        """Update the estimate with one yaw rate.

        command -1..1: after delay and lag; speed [m/s]; yaw_rate [rad/s]; dt [s]: since the last
        call.

        1. Steady yaw rate r(c) of the model and its slope to the command, by a central difference.
        2. Low-pass r and the regressors slope * (1, max(c, 0), min(c, 0)) with the lag of the yaw
           rate.
        3. Kalman update; the covariance grows by RANDOM_WALK_STD^2 dt, the noise by the transient.
        """
        if speed < MIN_LEARNING_SPEED:
            return
        effective = self.effective(command)
        steady = self._yaw_rate(effective, speed)
        slope = (
            self._yaw_rate(effective + 0.02, speed) - self._yaw_rate(effective - 0.02, speed)
        ) / 0.04
        yaw_delay = self._plant.delay.yaw_delay
        share = 1.0 - exp(-dt / yaw_delay) if yaw_delay > 0.0 else 1.0
        self._filtered += share * (np.append(steady, slope * _regressors(command)) - self._filtered)
        predicted = float(self._filtered[0])
        h = self._filtered[1:]
        noise = YAW_RATE_STD**2 + (steady - predicted) ** 2
        covariance = self._covariance + RANDOM_WALK_STD**2 * dt * np.eye(3)
        gain = covariance @ h / (h @ covariance @ h + noise * NOISE_CORRELATION_TIME / dt)
        self._covariance = covariance - np.outer(gain, h @ covariance)
        self.value = np.clip(self.value + gain * (yaw_rate - predicted), -MAX_ERROR, MAX_ERROR)

    def _yaw_rate(self, effective: float, speed: float) -> float:
        return speed * self._plant.steady.curvature(self._plant.angle_of(effective), speed)


def _regressors(command: float) -> FloatArray:
    return np.array((1.0, max(command, 0.0), min(command, 0.0)))


class DisturbancePrediction(MotionPrediction):
    """A prediction that uses the estimated ``disturbance`` instead of ``bias``."""

    def __init__(self, plant: Plant) -> None:
        self.disturbance = SteeringDisturbance(plant)
        super().__init__(plant)

    def reset(self) -> None:
        super().reset()
        self.disturbance.reset()

    def wheel_angle(self, servo: float) -> float:
        return self.plant.angle_of(self.disturbance.effective(servo))

    def compensate(self, angle: float) -> float:
        return self.plant.angle_of(self.disturbance.command(self.plant.command_of(angle)))

    def _learn_bias(self, now: MotionEstimate, step: float) -> None:
        self.disturbance.update(self._servo, now.speed, now.yaw_rate, step)
