"""Road-wheel angle to servo pulse and back, by this car's own measurement.

Without one the paper's map of the paper's car is used, and every command says
UNCALIBRATED: two maps of the same platform lie up to 3 deg apart.
"""

from __future__ import annotations

from dart_hal.core.config import CarConfig, SteeringTable
from dart_hal.devices.actuation.pchip import Pchip
from dart_hal.vehicle.sets import PAPER
from dart_hal.vehicle.steering import make_steering

PAPER_POINTS = 201
"""Points by which the paper's curve is entered: its PCHIP is then exact to 1e-7 rad."""


class SteeringMap:
    """Monotone map between pulse [us], command [-1..1] and angle [rad].

    ``calibrated`` False: the paper's map stands in. Arguments beyond the ends
    of the map count as the ends.
    """

    def __init__(self, curve: Pchip, center_us: float, span_us: float, *,
                 calibrated: bool) -> None:
        self.calibrated = calibrated
        self._curve = curve
        self._center_us, self._span_us = center_us, span_us
        self.lowest, self.highest = sorted((curve.y[0], curve.y[-1]))
        """Ends of the map [rad]: full right, full left."""

    def angle(self, pulse_us: float) -> float:
        """Road-wheel angle [rad] of a pulse."""
        return self._curve(pulse_us)

    def pulse(self, angle: float) -> float:
        """Pulse [us] for an angle [rad]."""
        return self._curve.inverse(angle)

    def command(self, pulse_us: float) -> float:
        """Command -1..1 (+1 full left) that car.toml gives this pulse."""
        return (pulse_us - self._center_us) / self._span_us

    def command_of(self, angle: float) -> float:
        """Command for an angle [rad]."""
        return self.command(self.pulse(angle))

    def angle_of(self, command: float) -> float:
        """Angle [rad] of a command."""
        return self.angle(self._center_us + self._span_us * command)


def steering_map(car: CarConfig, table: SteeringTable | None) -> SteeringMap:
    """The map of a calibration, or the paper's in its place. Raises NotMonotone."""
    center, span = car.steering.center_us, car.steering.direction * car.steering.span_us
    if table is not None:
        return SteeringMap(Pchip(table.pulse_us, table.angle_rad), center, span, calibrated=True)
    curve = make_steering(PAPER.steering)
    commands = [2 * i / (PAPER_POINTS - 1) - 1 for i in range(PAPER_POINTS)]
    points = sorted((center + span * s, float(curve(s))) for s in commands)
    return SteeringMap(Pchip(*zip(*points, strict=True)), center, span, calibrated=False)


def throttle_pulse(throttle: float, neutral_us: float, span_us: float) -> float:
    """Pulse [us] for a throttle in -1..1: linear, the ESC's dead band included."""
    return neutral_us + span_us * throttle
