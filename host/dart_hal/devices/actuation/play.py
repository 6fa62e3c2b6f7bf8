"""Inverse of the play of the steering: the pulse that brings the wheels to an angle.

        wheels ^        ____/      The linkage pushes the wheels like a slot pushes a peg:
               |       /   /       after a turn to the left they lie half the backlash to the
               |      /   /        right of the map's middle, after one to the right, to its
               |     /___/         left, and between the two they stay where they are.
               +----------------> pulse

1. The position of the wheels follows from the pulses and the servo's slew rate.
2. The pulse is set half the backlash further in the direction in which the wheels have to move. At
   a reversal the slot is crossed in one frame.
3. A setpoint less than ``MIN_TURN`` behind the wheels is not a reversal: noise of a controller
   would move the servo from flank to flank.
"""

from __future__ import annotations

from dart_hal.core.config import CarFiles
from dart_hal.devices.actuation.limits import clip
from dart_hal.devices.actuation.steering_map import SteeringMap

# rad: half a count of the PCA9685 at the wheels.
MIN_TURN = 0.004


class Play:
    """Wheels behind a slot ``backlash`` [rad] wide, moved by a servo of ``slew`` [us/s].

    ``wheels`` [rad]: their modelled angle; slew None: a servo without a slew limit.
    """

    def __init__(self, curve: SteeringMap, backlash: float, slew: float | None) -> None:
        self._map = curve
        self._half = 0.5 * backlash
        self._slew = slew
        self._pulse: float | None = None
        self._side = 0
        self.wheels = 0.0

    def aim(self, angle: float) -> float:
        """Return the middle of the slot [rad] that brings the wheels to ``angle``."""
        if self._pulse is None:
            return angle
        # How far the setpoint lies behind the wheels, in the direction of the last motion.
        behind = self._side * (self.wheels - angle)
        if self._side and 0.0 < behind <= MIN_TURN:
            angle = self.wheels
        side = self._side if behind <= MIN_TURN and self._side else (
            1 if angle > self.wheels else -1)
        return angle + side * self._half

    def update(self, pulse_us: float, dt: float) -> None:
        """Move servo and wheels by a pulse that lasted ``dt`` s."""
        if self._pulse is None:
            self._pulse = pulse_us
            self.wheels = self._map.angle(pulse_us)
            return
        max_step = self._slew * dt if self._slew else abs(pulse_us - self._pulse)
        self._pulse += clip(pulse_us - self._pulse, -max_step, max_step)
        previous = self.wheels
        self.wheels = self.wheel_angle(self._pulse)
        if self.wheels != previous:
            self._side = 1 if self.wheels > previous else -1

    def wheel_angle(self, pulse_us: float) -> float:
        """Return the angle [rad] to which a pulse moves the wheels from their present angle."""
        middle = self._map.angle(pulse_us)
        return clip(self.wheels, middle - self._half, middle + self._half)


def make_play(files: CarFiles, curve: SteeringMap) -> Play | None:
    """Return the play of a car with measured backlash, if car.toml enables its compensation."""
    measured = files.calibration.steering if files.calibration else None
    if not files.config.steering.take_up_backlash or measured is None or not measured.backlash:
        return None
    slew = measured.slew_us_s.value if measured.slew_us_s else None
    return Play(curve, measured.backlash.value, slew)
