"""A lifted car: its wheels spin against the friction of the drive train alone."""

from __future__ import annotations

from dart_hal.vehicle.friction import make_friction
from dart_lab.sim.hidden import HiddenCar
from dart_lab.sim.motion import MotorForce

# Steps per tick: the rotating parts have a fifth of the car's mass, so the motion is faster.
SUBSTEPS = 4
# Difference of speeds for the slope of the friction [m/s].
SPEED_STEP = 1e-4


class LiftedCar:
    """A lifted car; ``speed`` [m/s] of the tread and ``distance`` [m], forward positive.

    The motor accelerates the rotating parts (``HiddenCar.wheel_mass``) against the friction of the
    drive train: m dv/dt = k0 - k1 v + share friction(v). ``drive``: the force of the motor, shared
    with the car on the floor.
    """

    def __init__(self, car: HiddenCar, drive: MotorForce, tick: float, speed: float = 0.0) -> None:
        self.speed = speed
        self.distance = 0.0
        self._drive = drive
        self._dt = tick / SUBSTEPS
        self._share = car.drivetrain
        self._mass = car.wheel_mass
        self._friction = make_friction(car.vehicle.friction)

    def step(self, throttle: float, brake: float) -> float:
        """Advance one tick with constant throttle -1..1 and brake [N]; return the mean speed."""
        drive = self._drive
        before = self.speed
        drive.set_throttle(throttle)
        # The brake acts on the drive train, so the share of the friction must not reduce it.
        brake /= self._share
        # Linearly implicit Euler, since a locked brake is stiff: dv = dt F / (m - dt dF/dv).
        for _ in range(SUBSTEPS):
            v = self.speed
            force = drive.k0 - drive.k1 * v + self._share * self._friction(v, brake)
            change = self._friction(v - SPEED_STEP, brake) - self._friction(v + SPEED_STEP, brake)
            stiffness = drive.k1 + self._share * change / (2.0 * SPEED_STEP)
            self.speed += self._dt * force / (self._mass + self._dt * stiffness)
        mean = 0.5 * (before + self.speed)
        self.distance += mean * self._dt * SUBSTEPS
        return mean
