"""What a car's steering does beside its model, learnt while it drives: offset-free control.

A model whose tyres or map are 5 % off plans bends that the car does not drive, and nothing in a
plan from the present state ever asks for more: the car goes round 5 cm outside, for ever. The
textbook's answer is a disturbance of the input that is estimated with the state, and by which the
plan is made. Here the command c works as

    c + offset + left max(c, 0) + right min(c, 0)

an offset (backlash, trim) and an error of the gain to either side (tyres, map), which a bend need
not learn anew. A Kalman filter of a random walk finds the three from the yaw rate, as at walking
pace and above the motion across settles soon: what is measured is a steady bend.

It comes behind the wheels nevertheless (``Late.settles``), and so must all that it is compared
with. Else what is missing while the wheels go out is taken for a loss of gain, and what is left
over when they are back at 0, where no gain shows, for an offset: every gain falls, on any car.
While the bend changes it is measured less surely, by as much as model and settled model differ:
how fast a servo goes is known of few cars.

G. Pannocchia, J. B. Rawlings, "Disturbance models for offset-free model-predictive control", AIChE
Journal 49 (2003).
"""

from __future__ import annotations

from math import exp

import numpy as np

from dart_hal.control.plant import Plant, Prediction
from dart_hal.core.types import FloatArray, MotionEstimate

# Standard deviations before a drive: a backlash of 2 deg is 0.05 of the command to either side;
# the front tyres' stiffness of an identification is 5 to 10 % off.
KNOWN = (0.05, 0.1, 0.1)
# 1/sqrt(s) by which each of them may change: another speed, another floor.
WALK = 0.03
# rad/s of the yaw rate against a steady bend, and s for which it lasts: what a steering that
# moves leaves of it.
NOISE = 0.15
LASTS = 0.1
# m/s; slower, noise is no curvature.
FROM = 0.4
# Of each.
MOST = 0.3


class Disturbance:
    """Offset and gain errors (3,) of the steering command of a plant. ``learn`` with every
    measurement, ``effective`` and ``command`` between what is sent and what the model is told."""

    def __init__(self, plant: Plant) -> None:
        self._plant = plant
        self.reset()

    def reset(self) -> None:
        """Nothing is known."""
        self.value: FloatArray = np.zeros(3)
        self._spread: FloatArray = np.diag(np.square(KNOWN))
        self._settled: FloatArray = np.zeros(4)

    def effective(self, command: float) -> float:
        """What a command -1..1 does, by the model."""
        return command + float(self.value @ _parts(command))

    def command(self, effective: float) -> float:
        """The command -1..1 for it."""
        offset, left, right = self.value
        rest = effective - float(offset)
        return rest / (1.0 + float(left if rest > 0.0 else right))

    def learn(self, command: float, speed: float, yaw_rate: float, dt: float) -> None:
        """From a command -1..1 behind delay and lag, at speed [m/s], yaw rate [rad/s], dt [s] after
        the last."""
        if speed < FROM:
            return
        at = self.effective(command)
        steady = self._yaw_rate(at, speed)
        slope = (self._yaw_rate(at + 0.02, speed) - self._yaw_rate(at - 0.02, speed)) / 0.04
        settles = self._plant.late.settles
        share = 1.0 - exp(-dt / settles) if settles > 0.0 else 1.0
        self._settled += share * (np.append(steady, slope * _parts(command)) - self._settled)
        turned = float(self._settled[0])
        h = self._settled[1:]
        noise = NOISE**2 + (steady - turned) ** 2
        spread = self._spread + WALK**2 * dt * np.eye(3)
        gain = spread @ h / (h @ spread @ h + noise * LASTS / dt)
        self._spread = spread - np.outer(gain, h @ spread)
        self.value = np.clip(self.value + gain * (yaw_rate - turned), -MOST, MOST)

    def _yaw_rate(self, effective: float, speed: float) -> float:
        return speed * self._plant.steady.bend(self._plant.angle_of(effective), speed)


def _parts(command: float) -> FloatArray:
    return np.array((1.0, max(command, 0.0), min(command, 0.0)))


class Learning(Prediction):
    """A prediction whose wheels do what was learnt of them: ``disturbance``, not ``bias``."""

    def __init__(self, plant: Plant) -> None:
        self.disturbance = Disturbance(plant)
        super().__init__(plant)

    def reset(self) -> None:
        super().reset()
        self.disturbance.reset()

    def wheels(self, servo: float) -> float:
        return self.plant.angle_of(self.disturbance.effective(servo))

    def asked(self, angle: float) -> float:
        return self.plant.angle_of(self.disturbance.command(self.plant.command_of(angle)))

    def _learn(self, now: MotionEstimate, step: float) -> None:
        self.disturbance.learn(self._servo, now.speed, now.yaw_rate, step)
