"""Road-wheel angle to servo pulse and back, by the steering calibration of the car.

Without a calibration the map of the paper's car is used, and every command reports UNCALIBRATED:
the maps of two cars of the same platform differ by up to 3 deg.
"""

from __future__ import annotations

from dart_hal.core.config import CarConfig, SteeringTable
from dart_hal.devices.actuation.pchip import Pchip
from dart_hal.vehicle.steering import make_steering

# Samples of the paper's curve; the PCHIP through them is accurate to 1e-7 rad.
PAPER_POINTS = 201


class SteeringMap:
    """Monotone map between pulse [us], command [-1..1] and angle [rad].

    ``calibrated`` False: it is the paper's map. Arguments beyond the ends of the map are clipped.
    """

    def __init__(self, curve: Pchip, center_us: float, span_us: float, *,
                 calibrated: bool) -> None:
        self.calibrated = calibrated
        self._curve = curve
        self._center_us = center_us
        self._span_us = span_us
        self.lowest, self.highest = sorted((curve.y[0], curve.y[-1]))
        """Ends of the map [rad]: full right, full left."""

    def angle(self, pulse_us: float) -> float:
        """Return the road-wheel angle [rad] of a pulse."""
        return self._curve(pulse_us)

    def pulse(self, angle: float) -> float:
        """Return the pulse [us] for an angle [rad]."""
        return self._curve.inverse(angle)

    def command(self, pulse_us: float) -> float:
        """Return the command -1..1 (+1 full left) of a pulse, by car.toml."""
        return (pulse_us - self._center_us) / self._span_us

    def command_of(self, angle: float) -> float:
        """Return the command for an angle [rad]."""
        return self.command(self.pulse(angle))

    def angle_of(self, command: float) -> float:
        """Return the angle [rad] of a command."""
        return self.angle(self._center_us + self._span_us * command)


def steering_map(car: CarConfig, table: SteeringTable | None) -> SteeringMap:
    """Return the map of a calibration, or the paper's without one. Raises NotMonotone."""
    center = car.steering.center_us
    span = car.steering.direction * car.steering.span_us
    if table is not None:
        return SteeringMap(Pchip(table.pulse_us, table.angle_rad), center, span, calibrated=True)
    from dart_hal.vehicle.sets import PAPER  # imported when a car is opened

    curve = make_steering(PAPER.steering)
    commands = [2 * i / (PAPER_POINTS - 1) - 1 for i in range(PAPER_POINTS)]
    points = sorted((center + span * s, float(curve(s))) for s in commands)
    return SteeringMap(Pchip(*zip(*points, strict=True)), center, span, calibrated=False)


def throttle_pulse(throttle: float, neutral_us: float, span_us: float) -> float:
    """Return the pulse [us] for a throttle in -1..1: linear, the ESC's dead band included."""
    return neutral_us + span_us * throttle
