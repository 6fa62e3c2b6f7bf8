"""Configuration of a light simulation: actuators, sensors, disturbance.

Properties of the sensors are: ``period`` [s] between samples (0 = at every step), ``window`` [s]
(mean over the time before the sample), ``scale``, ``offset``, ``quantum`` of the readings (0 = not
rounded), noise, and ``age`` [s] from sample to reading. Scale 1 and zeros are a perfect sensor.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from typing import Any

from dart_hal.core.errors import ConfigError
from dart_hal.vehicle.parameters import GEAR_REVOLUTION, GRAVITY

# One digit of a BNO055 [rad/s, m/s2].
GYRO_QUANTUM = math.radians(1.0 / 16.0)
ACCEL_QUANTUM = 0.01
# White noise of a BNO055 by its data sheet [rad/s/sqrt(Hz), m/s2/sqrt(Hz)].
GYRO_DENSITY = math.radians(0.014)
ACCEL_DENSITY = 150e-6 * GRAVITY
MAY_BE_NEGATIVE = {"offset", "ahead"}


class CheckedNumbers:
    """Base class: no number is NaN, and only offsets may be negative."""

    __slots__ = ()

    def __post_init__(self) -> None:
        for f in fields(self):  # type: ignore[arg-type]
            v = getattr(self, f.name)
            bad = isinstance(v, float) and (math.isnan(v) or (
                v < 0.0 and f.name not in MAY_BE_NEGATIVE))
            if bad:
                raise ConfigError(f"{type(self).__name__}.{f.name} = {v!r} is not valid",
                                  found=repr(v), expected="a number that is not negative",
                                  remedy="correct the value; times are in s, angles in rad")


@dataclass(frozen=True, slots=True)
class Encoder(CheckedNumbers):
    """Speed [m/s]. ``metres_per_count`` > 0: edges counted over ``window``, else exact.

    A window of 0 gives the present speed. ``signed`` False: backward motion reads as forward.
    ``noise``: standard deviation of a sample [m/s].
    """

    period: float = 0.0
    window: float = 0.0
    metres_per_count: float = 0.0
    signed: bool = True
    scale: float = 1.0
    offset: float = 0.0
    quantum: float = 0.0
    noise: float = 0.0
    age: float = 0.0


@dataclass(frozen=True, slots=True)
class Inertial(CheckedNumbers):
    """Gyro [rad/s] or accelerometer [m/s2] at the centre of mass, gravity removed.

    ``density``: white noise in unit/sqrt(Hz), over the band of the sampling; ``offset_spread``:
    standard deviation of a bias that each reset draws.
    """

    period: float = 0.0
    scale: float = 1.0
    offset: float = 0.0
    offset_spread: float = 0.0
    quantum: float = 0.0
    density: float = 0.0
    age: float = 0.0


@dataclass(frozen=True, slots=True)
class Mocap(CheckedNumbers):
    """Pose of the point ``ahead`` [m] of the rear axle; noise per sample [m, rad].

    ``dropout``: share of samples that are lost; the reading is then the last pose.
    """

    period: float = 0.0
    ahead: float = 0.0
    noise: float = 0.0
    yaw_noise: float = 0.0
    dropout: float = 0.0
    age: float = 0.0

    def __post_init__(self) -> None:
        CheckedNumbers.__post_init__(self)
        if self.dropout >= 1.0:
            raise ConfigError(f"Mocap.dropout = {self.dropout!r} drops every sample",
                              found=repr(self.dropout), expected="0 to below 1",
                              remedy="it is a share, not percent")


@dataclass(frozen=True, slots=True)
class Sensors:
    """All sensors of a car. The default has no errors and no delays."""

    encoder: Encoder = field(default_factory=Encoder)
    gyro: Inertial = field(default_factory=Inertial)
    accel: Inertial = field(default_factory=Inertial)
    mocap: Mocap = field(default_factory=Mocap)


PERFECT = Sensors()

_GYRO = Inertial(0.01, quantum=GYRO_QUANTUM, density=GYRO_DENSITY, offset_spread=0.0)
_ACCEL = Inertial(0.01, quantum=ACCEL_QUANTUM, density=ACCEL_DENSITY)
_MOCAP = Mocap(0.01, noise=1e-4, yaw_noise=5e-4)

# This project's firmware: edge spacing, signed, 100 Hz. Where edges are close, its speed is nearly
# exact; what is left is some age.
FIRMWARE = Sensors(Encoder(0.01, age=0.01, noise=1e-3), _GYRO, _ACCEL, _MOCAP)

# The car of the published recordings: counts in 0.1 s, so the speed is that of 50 ms ago.
RECORDED = Sensors(Encoder(0.1, window=0.1, metres_per_count=GEAR_REVOLUTION / 20, signed=False),
                   Inertial(0.1, quantum=GYRO_QUANTUM, density=GYRO_DENSITY),
                   Inertial(0.1, quantum=ACCEL_QUANTUM, density=ACCEL_DENSITY), _MOCAP)


@dataclass(frozen=True, slots=True)
class Actuators(CheckedNumbers):
    """Actuators before the lags and delays of the vehicle's parameters.

    ``steering_rate`` [1/s]: largest rate of the servo, in commands per second; ``dead_band``:
    smaller throttle is 0 (25 us of 450 are 0.056); ``throttle_quantum``, ``steering_quantum``:
    resolution of the commands, 0 = not rounded (a count of the PCA9685 is 4.88 us: 0.0108 of
    throttle, 0.0130 of steering).
    """

    steering_rate: float = math.inf
    dead_band: float = 0.0
    throttle_quantum: float = 0.0
    steering_quantum: float = 0.0


# The virtual world's servo (6 rad/s of horn), speed controller and PWM clock.
DART_ACTUATORS = Actuators(steering_rate=10.2, dead_band=0.056, throttle_quantum=4.88 / 450,
                           steering_quantum=4.88 / 375)


@dataclass(frozen=True, slots=True)
class Disturbance(CheckedNumbers):
    """A random force at the centre of mass, along the car and across it.

    ``time`` > 0 [s]: correlated (Ornstein-Uhlenbeck) with standard deviations ``along``, ``across``
    [N]. ``time`` = 0: white with these densities [N sqrt(s)]. The variance of the speed then grows
    by (density / mass)^2 per second, independent of the step.
    """

    along: float = 0.0
    across: float = 0.0
    time: float = 0.15

    @property
    def acts(self) -> bool:
        """Return whether there is any force."""
        return self.along > 0.0 or self.across > 0.0


@dataclass(frozen=True, slots=True)
class LightConfig:
    """One simulation: ``step`` [s], actuators, sensors, disturbance, and numerics.

    ``sensors`` None: no sensors, ``read`` raises. ``dtype`` "float64" or "float32" and ``engine``
    "auto", "numpy" or "native" are of a batch; one car is always computed with ``math`` in float64.
    """

    step: float = 0.01
    sensors: Sensors | None = PERFECT
    actuators: Actuators = field(default_factory=Actuators)
    disturbance: Disturbance = field(default_factory=Disturbance)
    method: str = "rk4"
    dtype: str = "float64"
    engine: str = "auto"

    def __post_init__(self) -> None:
        if not 1e-4 <= self.step <= 0.05:
            raise ConfigError(f"a step of {self.step!r} s is out of range", found=repr(self.step),
                              expected="0.0001 to 0.05 s", remedy="10 ms is what is tested")
        if self.dtype not in ("float64", "float32"):
            raise ConfigError(f"no dtype {self.dtype!r}", expected="float64 or float32",
                              remedy="float64 unless speed matters more than digits")


def whole_steps(time: float, step: float, what: str) -> int:
    """Return ``time`` in whole steps, at least 1. Raises ConfigError if it is not a multiple."""
    n = max(1, round(time / step))
    if time > 0.0 and abs(n * step - time) > 1e-9:
        raise ConfigError(f"{what} of {time} s is not a whole number of steps of {step} s",
                          found=f"{time / step:.3f} steps", expected="a multiple of the step",
                          remedy="change the step or the period")
    return n


def sensor_list(sensors: Sensors) -> list[Any]:
    """Return all sensors in the order of the fields."""
    return [getattr(sensors, f.name) for f in fields(sensors)]
