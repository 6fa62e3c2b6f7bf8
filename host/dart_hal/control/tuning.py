"""Gains of the speed loop, from the delay of the car.

From a commanded acceleration to the measured speed, the car is an integrator behind a dead time
theta (its drag is fed forward). For that plant, e^(-theta s) / s, internal model control with a
closed-loop time constant lambda gives (Skogestad, J. Process Control 13, 2003)

    k_a = 1 / (lambda + theta)          tau_i = 4 (lambda + theta)

and lambda = theta keeps a phase margin of 60 degrees and a gain margin of 3. A remaining lag counts
by his half rule: half of it as dead time. k_a of the speed loop is an acceleration per speed error
[1/s]; the motor of the paper turns 10 1/s into a throttle of 0.6 for 1 m/s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dart_hal.core.config import CarFiles
from dart_hal.core.config.model import ModelFile
from dart_hal.core.timing import PWM_FRAME
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.load import vehicle_of

# Time from a command to the end of the first pulse that carries it [s]: half a PWM frame and 1.5
# ms.
PULSE_DELAY = 0.0115
# Age of a speed relative to its State at 0.4 m/s [s], see ``SpeedResponse.measurement_delay``.
SPEED_DELAY = 0.010
# Time from the encoder's latch to the host [s]: 44 bytes and the start of the firmware.
HOST_DELAY = 0.0011
# Steepest ramp to a new speed [m/s2] with a known lag (tyres hold 8), and with an unknown lag: half
# of the overshoot by a lag of 0.084 s is caused by the ramp.
MAX_RAMP = 5.0
MAX_RAMP_UNKNOWN_LAG = 2.5
# Integral time with an unknown lag [s]: errors of the ramp are no load.
INTEGRAL_TIME_UNKNOWN_LAG = 1.0
# Time of edges from which the estimation computes a speed [s] (``estimation.speed``).
EDGE_WINDOW = 15e-3
# Longest time between two edges [s]: below 0.04 m/s a speed is uncertain.
MAX_EDGE_GAP = 0.05
# Lag of a car without a measurement [s]: between none and the 0.084 s of the slower set.
UNKNOWN_LAG = 0.020


@dataclass(frozen=True, slots=True)
class SpeedResponse:
    """Delays of the speed loop of one car.

    delay [s] from a pulse to the force, lag [s] first-order after it; to_pulse, to_host [s] of the
    electronics; is_lag_known: the lag was measured, so it can be compensated; gap [m] between two
    edges.
    """

    delay: float
    lag: float
    to_pulse: float = PULSE_DELAY
    to_host: float = HOST_DELAY
    is_lag_known: bool = True
    gap: float = 0.0021

    def to_force(self, dt: float) -> float:
        """Return the time from a command to its force [s], mean over the ``dt`` s of the command.
        """
        return self.to_host + self.to_pulse + 0.5 * max(dt, PWM_FRAME) + self.delay

    def gains(self, dt: float, remaining_lag: float) -> tuple[float, float]:
        """Return (k_a [1/s], tau_i [s]) when called every ``dt`` s, with ``remaining_lag`` s of the
        lag.
        """
        theta = (
            self.to_force(dt)
            + SPEED_DELAY
            + 0.5 * (remaining_lag if self.is_lag_known else self.lag)
        )
        return 1.0 / (2.0 * theta), 8.0 * theta if self.is_lag_known else INTEGRAL_TIME_UNKNOWN_LAG

    def measurement_delay(self, speed: float) -> float:
        """Return the time from a speed [m/s] until a State reports it [s].

        The speed is estimated from the edges of the last 15 ms, or from the last two, and the
        newest edge is half a gap old. A lag that is not compensated adds half of its assumed value.
        """
        gap = min(self.gap / max(abs(speed), 1e-3), MAX_EDGE_GAP)
        return (
            0.5 * max(EDGE_WINDOW, gap) + 0.5 * gap + (0.0 if self.is_lag_known else 0.5 * self.lag)
        )

    @property
    def min_measurable_speed(self) -> float:
        """Speed [m/s] that a car reaches on the ramp from rest before its second edge, at most two
        gaps.
        """
        return math.sqrt(2.0 * self.ramp * 2.0 * self.gap)

    @property
    def ramp(self) -> float:
        """Largest acceleration of the reference towards a new speed [m/s2]."""
        return MAX_RAMP if self.is_lag_known else MAX_RAMP_UNKNOWN_LAG

    @property
    def ease(self) -> float:
        """Time over which a ramp ends [s]: the lag of the motor, and PWM frames, which are
        discrete.
        """
        return 4.0 * PWM_FRAME + self.lag


def make_speed_response(files: CarFiles) -> SpeedResponse:
    """Return the response of a car: by calibration.toml, else model.toml, else typical values."""
    measured = files.calibration.latency if files.calibration else None
    delay, lag = _read_model_delays(files.model)
    if measured is not None and measured.pulse_to_wheel is not None:
        delay = max(measured.pulse_to_wheel.value, 0.0)
    if measured is not None and measured.pulse_to_wheel_lag is not None:
        lag = max(measured.pulse_to_wheel_lag.value, 0.0)
    electronics = {key: max(q.value, 0.0) for key, name in (
        ("to_pulse", "command_to_pulse"), ("to_host", "sensor_to_host"))
        if measured is not None and (q := getattr(measured, name)) is not None}
    return SpeedResponse(
        delay or 0.0,
        UNKNOWN_LAG if lag is None else lag,
        is_lag_known=lag is not None,
        gap=files.metres_per_edge.value,
        **electronics,
    )


def _read_model_delays(model: ModelFile | None) -> tuple[float | None, float | None]:
    """Return (delay, lag) [s] of the throttle, effects included; None: not in the file."""
    if model is None:
        return None, None
    vehicle = apply_parameter_effects(vehicle_of(model))
    has_delays = {"throttle_s", "throttle_lag_s"} & set(model.delay)
    effects = {effect.name for effect in model.effects}
    delay = vehicle.delay.throttle_s if has_delays or "throttle_delay" in effects else None
    return delay, vehicle.delay.throttle_lag_s if has_delays or "throttle_lag" in effects else None
