"""Understeer gradient from on-board sensors, by throttle ramps at constant steering.

Steady turning at a held command:

    atan(l omega / v) = delta - (alpha_f - alpha_r)
    alpha_f - alpha_r = K a + K3 a^3 + K7 a^7,    a = v omega

delta, the angle of the wheels, is constant along a ramp; the slip difference is the same to both
sides: a line, its bend, and the limit of the front tyre. Its mean slope at small a is the
understeer gradient, for linear tyres (m / l) (l_r / C_f - l_f / C_r). That is one equation for two
stiffnesses; v_y, which would separate them, is not measured.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from dart_hal.core.config import CarFiles
from dart_hal.core.types import FloatArray
from dart_hal.recording.dart import Recording
from dart_hal.vehicle.fitting.covariance import block_covariance
from dart_hal.vehicle.fitting.least_squares import least_squares
from dart_lab.identification.fit import FittedParameter

from .circles import TYRE_STEERING

# [command] Largest distance of a sample from the steering levels of the two ramps.
COMMAND_TOLERANCE = 0.02
# [m/s] The encoder's ring turns too slowly for a speed below it.
MIN_RING_SPEED = 0.35
# Samples of one block of errors: 1 s.
BLOCK_SAMPLES = 10
# Least samples: 6 s of ramps.
MIN_RAMP_SAMPLES = 60
# [rad] Standard deviation of the slip difference from ring, gyro bias and form.
SLIP_STD_FLOOR = 1e-3
# [rad/(m/s2)] The same for its slope.
SLOPE_STD_FLOOR = 4e-4
POWERS = (1, 3, 7)
# [m/s2] The understeer gradient is the mean slope between these; ramps begin above the lower.
GRADIENT_RANGE = (0.4, 1.2)


@dataclass(frozen=True, slots=True)
class Understeer:
    """Slip difference over lateral acceleration.

    terms K, K3, K7 [rad/(m/s2)^power] with covariance (3, 3); n samples up to ``lateral`` [m/s2];
    rmse [rad]; scale: wheelbase / mass [m/kg].
    """

    terms: tuple[float, ...]
    covariance: FloatArray
    n: int
    lateral: float
    rmse: float
    scale: float

    @property
    def gradient(self) -> FittedParameter:
        """Mean slope over GRADIENT_RANGE, + = understeer."""
        low, high = GRADIENT_RANGE
        g = np.array([high**power - low**power for power in POWERS]) / (high - low)
        std = math.hypot(math.sqrt(float(g @ self.covariance @ g)), SLOPE_STD_FLOOR)
        return FittedParameter(float(g @ np.array(self.terms)), std, "rad s2/m")

    @property
    def combination(self) -> tuple[float, float]:
        """(l_r/C_f - l_f/C_r, standard error) [m rad/N] for linear tyres."""
        return self.gradient.value * self.scale, self.gradient.std * self.scale

    def slip(self, lateral: float) -> tuple[float, float]:
        """Return (alpha_f - alpha_r, standard error) [rad] at a lateral acceleration [m/s2]."""
        g = np.array([lateral**power for power in POWERS])
        value = float(g @ np.array(self.terms))
        return value, math.hypot(math.sqrt(float(g @ self.covariance @ g)), SLIP_STD_FLOOR)

    def to_json(self) -> dict[str, object]:
        """As ``experiment tyres --json`` prints it."""
        at = [round(0.25 * i, 2) for i in range(1, int(4.0 * self.lateral) + 1)]
        curve = [self.slip(a) for a in at]
        return {"gradient": {"value": self.gradient.value, "std": self.gradient.std,
                             "unit": self.gradient.unit},
                "combination": {"value": self.combination[0], "std": self.combination[1],
                                "unit": "m rad/N"},
                "slip_difference": {"lateral": at, "rad": [v for v, _ in curve],
                                    "std_rad": [s for _, s in curve]},
                "n": self.n, "max_lateral": self.lateral, "rmse_rad": self.rmse}

    def __str__(self) -> str:
        k = self.gradient.value
        std = self.gradient.std
        at, spread = self.slip(self.lateral)
        return (f"understeer gradient {1e3 * k:+.2f} +- {1e3 * std:.2f} mrad per m/s2 "
                f"(+: understeer), so l_r/C_f - l_f/C_r = {1e6 * self.combination[0]:+.0f} +- "
                f"{1e6 * self.combination[1]:.0f} um rad/N; at {self.lateral:.1f} m/s2 the front "
                f"slips {math.degrees(at):+.2f} +- {math.degrees(spread):.2f} deg more than the "
                "rear")


def fit_understeer(recording: Recording, files: CarFiles, mass: float) -> Understeer | None:
    """Fit the ramps of ``experiment tyres``; None if there are too few samples. mass [kg]."""
    m = recording.messages
    wheelbase = files.config.geometry.wheelbase
    side = np.sign(m.steering)
    held = (np.abs(np.abs(m.steering)
                   - TYRE_STEERING) < COMMAND_TOLERANCE) & (m.speed > MIN_RING_SPEED)
    use = held & (m.throttle > 0.0) & (m.yaw_rate * side > 0.0)
    if use.sum() < MIN_RAMP_SAMPLES:
        return None
    lateral = (m.speed * m.yaw_rate * side)[use]
    angle = np.arctan2(wheelbase * m.yaw_rate * side, m.speed)[use]
    left = side[use] > 0.0
    design = np.column_stack([left, ~left, *(-lateral**power for power in POWERS)])
    design = design.astype(np.float64)

    def residual(x: FloatArray) -> FloatArray:
        return design @ x - angle

    start = [float(angle.max())] * 2 + [0.0] * len(POWERS)
    found = least_squares(residual, start, ([-1.0] * len(start), [1.0] * len(start)),
                          jacobian=lambda x: design, robust=0.01)
    block = np.arange(len(angle)) // BLOCK_SAMPLES + 1000 * left
    covariance = block_covariance(found, block)[2:, 2:]
    top = float(lateral.max())
    return Understeer(tuple(float(v) for v in found.x[2:]), covariance, len(angle), top,
                      found.rmse, wheelbase / mass)
