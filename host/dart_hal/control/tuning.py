"""Gains of the speed loop, from how late the car answers.

From an acceleration that is asked for to the speed that is read of it, the car is an integrator
behind a dead time theta (its drag is fed forward). For that plant, e^(-theta s) / s, internal model
control with a closed-loop time constant lambda gives (Skogestad, J. Process Control 13, 2003)

    k_a = 1 / (lambda + theta)          tau_i = 4 (lambda + theta)

and lambda = theta keeps 60 degrees of phase and a gain margin of 3. A lag that is left counts
by his half rule: one half of it as dead time. The speed loop's k_a is an acceleration per error of
speed [1/s]; the paper's motor turns 10 1/s into 0.6 of throttle for 1 m/s.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from dart_hal.core.config import CarFiles
from dart_hal.core.config.model import ModelFile
from dart_hal.core.timing import PWM_FRAME
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.load import vehicle_of

# s from a command to the end of the first pulse that carries it: half a PWM frame, and 1.5 ms.
TO_PULSE = 0.0115
# s by which a speed is older than its State at 0.4 m/s, see ``Answer.shows``.
TO_SPEED = 0.010
# s from the encoder's latch to the host: 44 bytes and the firmware's start.
TO_HOST = 0.0011
# m/s2, the steepest ramp to a new speed where the lag is known (tyres hold 8), and where not:
# half of what a lag of 0.084 s overshoots by comes of the ramp.
RAMP = 5.0
SOFT_RAMP = 2.5
# s of the integral where the lag is not known: what the ramp gets wrong is no load.
SLOWLY = 1.0
# s of edges of which the estimation makes a speed (``estimation.speed``).
WINDOW = 15e-3
# s: slower than 0.04 m/s a speed says little.
LONGEST_GAP = 0.05
# s of a car of which nobody measured it: between none and the 0.084 of the slower set.
UNKNOWN_LAG = 0.020


@dataclass(frozen=True, slots=True)
class Answer:
    """How late one car answers.

    delay [s] from a pulse to the force, lag [s] first-order behind it; to_pulse, to_host [s] of the
    electronics; known: the lag was measured, so that it can be led; gap [m] between two edges.
    """

    delay: float
    lag: float
    to_pulse: float = TO_PULSE
    to_host: float = TO_HOST
    known: bool = True
    gap: float = 0.0021

    def to_force(self, dt: float) -> float:
        """s from a command to its force, on the mean of the ``dt`` s for which it is held."""
        return self.to_host + self.to_pulse + 0.5 * max(dt, PWM_FRAME) + self.delay

    def gains(self, dt: float, lag_left: float) -> tuple[float, float]:
        """(k_a [1/s], tau_i [s]) when called each ``dt`` s, with ``lag_left`` s of the lag."""
        theta = self.to_force(dt) + TO_SPEED + 0.5 * (lag_left if self.known else self.lag)
        return 1.0 / (2.0 * theta), 8.0 * theta if self.known else SLOWLY

    def shows(self, speed: float) -> float:
        """s from a speed [m/s] until a State shows it.

        It is made of edges of the last 15 ms, or of the last two, and the newest is half a gap
        old. A lag that is not led comes late by half of what it is taken for.
        """
        gap = min(self.gap / max(abs(speed), 1e-3), LONGEST_GAP)
        return 0.5 * max(WINDOW, gap) + 0.5 * gap + (0.0 if self.known else 0.5 * self.lag)

    @property
    def unseen(self) -> float:
        """m/s that a car reaches from rest on the ramp before its second edge: two gaps at most."""
        return math.sqrt(2.0 * self.ramp * 2.0 * self.gap)

    @property
    def ramp(self) -> float:
        """m/s2 at which the reference may go to a new speed."""
        return RAMP if self.known else SOFT_RAMP

    @property
    def ease(self) -> float:
        """s over which a ramp ends: the motor's lag, and PWM frames, for they come in steps."""
        return 4.0 * PWM_FRAME + self.lag


def answer_of(files: CarFiles) -> Answer:
    """What calibration.toml says about a car, else model.toml, else what cars of this kind do."""
    measured = files.calibration.latency if files.calibration else None
    delay, lag = _modelled(files.model)
    if measured is not None and measured.pulse_to_wheel is not None:
        delay = max(measured.pulse_to_wheel.value, 0.0)
    if measured is not None and measured.pulse_to_wheel_lag is not None:
        lag = max(measured.pulse_to_wheel_lag.value, 0.0)
    electronics = {key: max(q.value, 0.0) for key, name in (
        ("to_pulse", "command_to_pulse"), ("to_host", "sensor_to_host"))
        if measured is not None and (q := getattr(measured, name)) is not None}
    return Answer(delay or 0.0, UNKNOWN_LAG if lag is None else lag, known=lag is not None,
                  gap=files.metres_per_edge.value, **electronics)


def _modelled(model: ModelFile | None) -> tuple[float | None, float | None]:
    """(delay, lag) [s] of the throttle, effects included; None: the file does not say."""
    if model is None:
        return None, None
    vehicle = settled(vehicle_of(model))
    says = {"throttle_s", "throttle_lag_s"} & set(model.delay)
    named = {effect.name for effect in model.effects}
    delay = vehicle.delay.throttle_s if says or "throttle_delay" in named else None
    return delay, vehicle.delay.throttle_lag_s if says or "throttle_lag" in named else None
