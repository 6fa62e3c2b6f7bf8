"""A car on a stand: no wheel touches the ground, all spin against the drive train alone."""

from __future__ import annotations

from dart_hal.vehicle.friction import make_friction
from dart_lab.sim.hidden import HiddenCar
from dart_lab.sim.motion import Drive

SUBSTEPS = 4
"""Of a tick; what turns has a fifth of the car's mass, so everything happens faster."""
SLOPE = 1e-4
"""m/s by which the slope of the friction is taken."""


class Stand:
    """Wheels in the air; ``speed`` [m/s] of the tread, forward positive.

    The motor pulls what turns (``HiddenCar.wheel_mass``) against that part of the friction that
    is not the ground's. Linearly implicit, since a locked brake is stiff. ``drive``: the motor's
    force, shared with the car on the floor.
    """

    def __init__(self, car: HiddenCar, drive: Drive, tick: float, speed: float = 0.0) -> None:
        self.speed = speed
        self._drive, self._dt = drive, tick / SUBSTEPS
        self._share, self._mass = car.drivetrain, car.wheel_mass
        self._friction = make_friction(car.vehicle.friction)

    def step(self, throttle: float, brake: float) -> float:
        """One tick with throttle -1..1 and brake [N] held; the mean speed [m/s]."""
        drive, before = self._drive, self.speed
        drive.set(throttle)
        brake /= self._share                        # the brake is all of the drive train's
        for _ in range(SUBSTEPS):
            v = self.speed
            force = drive.k0 - drive.k1 * v + self._share * self._friction(v, brake)
            stiff = drive.k1 + self._share * (
                self._friction(v - SLOPE, brake) - self._friction(v + SLOPE, brake)) / (2.0 * SLOPE)
            self.speed += self._dt * force / (self._mass + self._dt * stiff)
        return 0.5 * (before + self.speed)
