"""Values that the rooms hand to each other: frozen, SI units, ISO 8855 axes.

x forward, y left, angles positive to the left. A name carries a suffix only
when its unit is not SI (``_us``, ``_deg``, ``_ticks``).
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]


class Limit(str, Enum):
    """Why the pins do not carry what was asked for.

    A command that lost against a source of higher priority is said as the
    string ``"OVERRIDDEN(name)"``.
    """

    RANGE = "RANGE"
    SLEW = "SLEW"
    EXPIRED = "EXPIRED"
    NOT_ARMED = "NOT_ARMED"
    STALE_LINK = "STALE_LINK"
    UNCALIBRATED = "UNCALIBRATED"
    NOT_SENT = "NOT_SENT"

    def __str__(self) -> str:
        return self.value


@dataclass(frozen=True, slots=True)
class Applied:
    """What the pins carry now, after limits, slew and count quantisation.

    steering [rad], throttle [-1..1]; ``*_us`` are true pulse widths by the
    calibrated PCA9685 clock. Throttle 1.0 is ``car.toml``'s throttle span
    (450 us) above neutral.
    """

    steering: float
    throttle: float
    steering_us: float
    throttle_us: float
    limited: tuple[str, ...] = ()


NEUTRAL = Applied(0.0, 0.0, 1500.0, 1500.0)


def _zero_cov() -> FloatArray:
    cov = np.zeros((3, 3))
    cov.setflags(write=False)
    return cov


@dataclass(frozen=True, slots=True)
class Pose:
    """Position of the rear axle [m], yaw [rad, unwrapped], covariance (3, 3)."""

    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0
    cov: FloatArray = field(default_factory=_zero_cov)


@dataclass(frozen=True, slots=True)
class Health:
    """How far the numbers beside it may be trusted.

    ``flags``: names of ``wire.messages.STATE_FLAGS`` that are set; ``imu_age``
    and ``beat_age`` in s (inf = none); ``lost`` frames since open; ``vcc`` in V
    (None = not measured); ``t_std`` s, one sigma of ``State.t``;
    ``accel_kind`` "linear" (gravity removed) or "raw"; ``calib`` the
    BNO055's (sys, gyr, acc, mag) levels 0..3.
    """

    flags: frozenset[str]
    imu_age: float
    beat_age: float
    lost: int
    skipped: int
    vcc: float | None
    t_std: float
    accel_kind: str
    calib: tuple[int, int, int, int]


@dataclass(frozen=True, slots=True)
class State:
    """One telemetry frame of the car, decoded, timed and integrated.

    t [s] device time mapped to the car's clock, monotone; seq frame counter,
    unwrapped; speed [m/s] signed with one sigma; yaw_rate [rad/s],
    accel_x, accel_y [m/s2] in body axes (None while the IMU is not valid);
    ticks encoder edges since boot, unwrapped.
    """

    t: float
    seq: int
    speed: float
    speed_std: float
    yaw_rate: float | None
    accel_x: float | None
    accel_y: float | None
    ticks: int
    pose: Pose
    applied: Applied
    health: Health


@dataclass(frozen=True, slots=True)
class Estimate:
    """A measured quantity: value, one sigma, unit."""

    value: float
    std: float
    unit: str = ""
