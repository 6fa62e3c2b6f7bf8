"""The play of the steering, turned round: which pulse brings the wheels to an angle.

        wheels ^        ____/      The linkage pushes the wheels like a slot pushes a peg:
               |       /   /       after a turn to the left they lie half the backlash to the
               |      /   /        right of the map's middle, after one to the right, to its
               |     /___/         left, and between the two they stay where they are.
               +----------------> pulse

So the pulse is taken half the backlash further in the direction in which the wheels have to move,
and the slot is crossed at once where it turns. Where the wheels are by now follows from the pulses
and the servo's slew. A wish that is less than ``RESOLVED`` behind is no turn: noise of a controller
would shake the servo from flank to flank.
"""

from __future__ import annotations

from dart_hal.core.config import CarFiles
from dart_hal.devices.actuation.limits import clip
from dart_hal.devices.actuation.steering_map import SteeringMap

RESOLVED = 0.004
"""rad, half a count of the PCA9685 at the wheels."""


class Play:
    """Wheels behind a slot ``backlash`` [rad] wide, moved by a servo of ``slew`` [us/s].

    ``wheels`` [rad]: where they are taken to be.
    """

    def __init__(self, curve: SteeringMap, backlash: float, slew: float | None) -> None:
        self._map, self._half, self._slew = curve, 0.5 * backlash, slew
        self._pulse: float | None = None
        self._side = 0
        self.wheels = 0.0

    def aim(self, angle: float) -> float:
        """Middle of the slot [rad] that brings the wheels to ``angle``; nothing changes."""
        if self._pulse is None:
            return angle
        behind = self._side * (self.wheels - angle)
        if self._side and 0.0 < behind <= RESOLVED:
            angle = self.wheels
        side = self._side if behind <= RESOLVED and self._side else (
            1 if angle > self.wheels else -1)
        return angle + side * self._half

    def passed(self, pulse_us: float, dt: float) -> None:
        """The servo has had a pulse for ``dt`` s."""
        if self._pulse is None:
            self._pulse, self.wheels = pulse_us, self._map.angle(pulse_us)
            return
        most = self._slew * dt if self._slew else abs(pulse_us - self._pulse)
        self._pulse += clip(pulse_us - self._pulse, -most, most)
        before, self.wheels = self.wheels, self.meant(self._pulse)
        if self.wheels != before:
            self._side = 1 if self.wheels > before else -1

    def meant(self, pulse_us: float) -> float:
        """Angle [rad] that the wheels come to, from where they are, at a pulse."""
        middle = self._map.angle(pulse_us)
        return clip(self.wheels, middle - self._half, middle + self._half)


def play_of(files: CarFiles, curve: SteeringMap) -> Play | None:
    """That of a car whose backlash was measured, if car.toml asks for it."""
    measured = files.calibration.steering if files.calibration else None
    if not files.config.steering.take_up_backlash or measured is None or not measured.backlash:
        return None
    slew = measured.slew_us_s.value if measured.slew_us_s else None
    return Play(curve, measured.backlash.value, slew)
