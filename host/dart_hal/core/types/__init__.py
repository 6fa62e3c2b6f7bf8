"""Values that packages pass to each other: frozen, SI units, ISO 8855 axes.

x forward, y left, angles positive to the left. A name carries a suffix only
when its unit is not SI (``_us``, ``_deg``, ``_ticks``).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from enum import Enum
from math import cos, degrees, isfinite, sin, tau

import numpy as np
from numpy.typing import NDArray

from dart_hal.core.notebook import card
from dart_hal.core.types.image import Image as Image
from dart_hal.core.types.scan import Mount as Mount
from dart_hal.core.types.scan import Scan as Scan

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


class Limit(str, Enum):
    """Why the pins do not carry what was asked for.

    VALIDITY: the command holds for less than its ``valid_for``, 0.5 s or raw 0.2 s.
    PULSES_OFF: servo and ESC get no pulse at all, since no State shows whether the car moves, or
    since it sped up at neutral (MOVES_AT_NEUTRAL).
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
    CUT_OFF = "CUT_OFF"
    ENCODER_DOUBTED = "ENCODER_DOUBTED"
    REVERSING = "REVERSING"
    VALIDITY = "VALIDITY"
    PULSES_OFF = "PULSES_OFF"

    def __str__(self) -> str:
        return self.value


class Doubt(str, Enum):
    """What is known against a number of the State; the prefix names the sensor.

    ENCODER_DEAD no edges though the wheels must turn; ENCODER_LOW too few (with
    both of them motion is felt that no edge tells),
    ENCODER_HIGH more than throttle or hand explain; ENCODER_NOISY edges that no
    wheel makes were dropped; ENCODER_SLIPS the wheels turn faster than the car
    (they spin, or are lifted). IMU_ZERO, IMU_RANGE, IMU_STEP: samples that
    cannot be; IMU_DISAGREES: a yaw rate that the wheels contradict. CAR_SLIDES:
    it turns faster than its wheels explain; the gyro is believed. DIRECTION_UNSURE: the wheels
    turn, and neither command nor acceleration says which way: speed and travel may have the
    other sign. SAMPLES_JUMPED: samples of the IMU jumped and returned, two within 3 s.
    A single one was replaced; two in a row are in the yaw, and its covariance covers them.
    """

    ENCODER_DEAD = "ENCODER_DEAD"
    ENCODER_LOW = "ENCODER_LOW"
    ENCODER_HIGH = "ENCODER_HIGH"
    ENCODER_NOISY = "ENCODER_NOISY"
    ENCODER_SLIPS = "ENCODER_SLIPS"
    IMU_ZERO = "IMU_ZERO"
    IMU_RANGE = "IMU_RANGE"
    IMU_STEP = "IMU_STEP"
    IMU_DISAGREES = "IMU_DISAGREES"
    CAR_SLIDES = "CAR_SLIDES"
    DIRECTION_UNSURE = "DIRECTION_UNSURE"
    SAMPLES_JUMPED = "SAMPLES_JUMPED"

    def __str__(self) -> str:
        return self.value


SPEED_DOUBTS = frozenset({Doubt.ENCODER_DEAD.value, Doubt.ENCODER_LOW.value,
                          Doubt.ENCODER_HIGH.value})
"""No loop may close over a speed of which one of these is said."""


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


POSE_STD, POSE_YAW_STD = 0.001, 0.002
"""m and rad, one sigma of a motion capture that states none (docs/reference/poses.md)."""


MAX_COORDINATE = 1e5  # m; no room is larger, and its squares do not overflow
MAX_STAMP = 2.0**31
"""s; builtin_interfaces/Time ends there, and Unix time in ms is beyond it."""


def nanoseconds(t: float) -> int:
    """The nearest whole ns of t [s], exactly: a product of floats would be off by 100 ns."""
    numerator, denominator = t.as_integer_ratio()
    return (2 * numerator * 10**9 + denominator) // (2 * denominator)


def pose_cov(std: float = POSE_STD, yaw_std: float = POSE_YAW_STD) -> FloatArray:
    """Covariance (3, 3) of x, y, yaw without correlation; read-only."""
    cov = np.diag([std * std, std * std, yaw_std * yaw_std])
    cov.setflags(write=False)
    return cov


@dataclass(frozen=True, slots=True)
class ExternalPose:
    """Pose of a tracked body, as something outside of the car measured it.

    stamp [s] of the measurement on the source's own clock; arrival [s] on the
    car's clock; x, y [m] and yaw [rad] of the marker frame in the room's frame,
    z up; cov (3, 3) of them; frame: name of the room's frame. The stamp is kept in
    whole ns and the yaw, wrapped to +-pi, in whole nrad: as much as a recording
    keeps, so that a replay sees the very same numbers. Raises ValueError for
    what is no finite number or beyond ``MAX_COORDINATE``, and for stamps that are no seconds.
    """

    stamp: float
    arrival: float
    x: float
    y: float
    yaw: float
    cov: FloatArray = field(default_factory=pose_cov)
    frame: str = "mocap"

    def __post_init__(self) -> None:
        numbers = (self.stamp, self.arrival, self.x, self.y, self.yaw)
        if not all(map(isfinite, numbers)) or not np.isfinite(self.cov).all():
            raise ValueError("a pose that is not finite")
        if max(abs(self.x), abs(self.y), abs(self.yaw)) > MAX_COORDINATE:
            raise ValueError(f"a pose at {self.x:g}, {self.y:g} m, {self.yaw:g} rad")
        if not 0.0 <= self.stamp < MAX_STAMP or self.arrival < 0.0:
            raise ValueError(f"a stamp of {self.stamp:g}, which are no seconds")
        object.__setattr__(self, "stamp", nanoseconds(self.stamp) / 10**9)
        object.__setattr__(self, "yaw", round(self.yaw - tau * round(self.yaw / tau), 9))


class Tracking(str, Enum):
    """How well the room knows where the car is.

    TRACKING poses come and are believed; DEAD_RECKONING none came lately, wheels
    and gyro carry on from the last; JUMPED poses come, but the car cannot have moved so
    (another body, a false lock): they are not believed; LOST there was never one, or the last is
    too old to go on from.
    """

    TRACKING = "TRACKING"
    DEAD_RECKONING = "DEAD_RECKONING"
    JUMPED = "JUMPED"
    LOST = "LOST"

    def __str__(self) -> str:
        return self.value


AHEAD = 0.5
"""s that a motion is predicted at most: longer than any delay that a controller makes up for."""
CHANGES = (2.0, 5.0)
"""m/s2 and rad/s2 rms by which a motion that goes on as it did is wrong: the throttle, and a
steering angle that goes from 0 to 0.3 rad in 0.4 s at 1 m/s."""


@dataclass(frozen=True, slots=True)
class MotionEstimate:
    """Where the rear axle is at ``t`` [s] on the car's clock, and how it moves.

    pose: x, y [m], yaw [rad]; speed [m/s] signed; yaw_rate [rad/s]; cov (5, 5) of x, y, yaw,
    speed, yaw_rate, read-only, its first three the covariance of ``pose``. frame: the room's, by
    wheels, gyro and external poses in a Kalman filter (``estimation/room.py``); ``START`` where no
    source has told a pose yet: dead reckoning from where the car was opened. tracking: what the
    source does.
    """

    t: float
    pose: Pose
    speed: float
    yaw_rate: float
    cov: FloatArray
    frame: str
    tracking: Tracking

    def at(self, t: float) -> MotionEstimate:
        """Predicted to t [s], as ``car.now``: it goes on at its speed and yaw rate, for 0.5 s at
        most, and grows less sure by ``CHANGES``. An earlier t changes nothing."""
        dt = min(t - self.t, AHEAD)
        if dt <= 0.0:
            return self
        pose, length, turn = self.pose, self.speed * dt, self.yaw_rate * dt
        c, s = cos(pose.yaw + 0.5 * turn), sin(pose.yaw + 0.5 * turn)
        step = np.eye(5)
        step[:2, 2] = -length * s, length * c
        step[:2, 3] = dt * c, dt * s
        step[:2, 4] = -0.5 * dt * length * s, 0.5 * dt * length * c
        step[2, 4] = dt
        along, turned = (change * dt for change in CHANGES)
        by = np.zeros((5, 2))  # half of each change acts within dt
        by[:2, 0], by[3, 0] = 0.5 * dt * along * np.array((c, s)), along
        by[:3, 1], by[4, 1] = 0.5 * turned * step[:3, 4], turned
        cov = step @ self.cov @ step.T + by @ by.T
        cov.setflags(write=False)
        moved = Pose(pose.x + length * c, pose.y + length * s, pose.yaw + turn, cov[:3, :3])
        return replace(self, t=self.t + dt, pose=moved, cov=cov)


START = "start"
"""Frame of dead reckoning: the pose at which the car was opened."""
GYRO_STD, NO_GYRO_STD = 0.02, 0.3
"""rad/s, one sigma of ``State.yaw_rate`` at its time, and of a yaw rate that nobody measures."""


@dataclass(frozen=True, slots=True)
class External:
    """Where the car is in the room, as a source of external poses and its own wheels tell.

    pose: the marker frame at ``State.t``: the last believed pose and the odometry
    since, with a covariance that grows (None before the first); age [s] of that
    last one (inf = none); newest: what came last, believed or not; estimate: of the Kalman
    filter in the room's frame, None until a believed pose has begun it.
    """

    tracking: Tracking
    age: float
    pose: Pose | None
    newest: ExternalPose | None
    estimate: MotionEstimate | None = None


@dataclass(frozen=True, slots=True)
class Health:
    """How far the numbers beside it may be trusted.

    ``flags``: names of ``wire.messages.STATE_FLAGS`` that are set; ``imu_age``
    s since the IMU renewed the yaw rate (its filter is later by 5 ms), ``beat_age``
    s (inf = none); ``lost`` frames since open; ``vcc`` in V
    (None = not measured); ``t_std`` s, one sigma of ``State.t``;
    ``accel_kind`` "linear" (gravity removed) or "raw"; ``calib`` the
    BNO055's (sys, gyr, acc, mag) levels 0..3; ``doubts`` names of ``Doubt``;
    ``jumped`` samples of the IMU since open that jumped and returned at once.
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
    doubts: frozenset[str] = frozenset()
    jumped: int = 0

    @property
    def encoder_lost(self) -> bool:
        """The wheels must turn and no edge comes: the throttle is capped."""
        return Doubt.ENCODER_DEAD.value in self.doubts

    @property
    def speed_doubted(self) -> bool:
        """The speed is not what the car does: no speed loop may use it."""
        return not SPEED_DOUBTS.isdisjoint(self.doubts)

    @property
    def imu_doubted(self) -> bool:
        """The IMU's samples are not given out."""
        return any(name.startswith("IMU_") for name in self.doubts)


@dataclass(frozen=True, slots=True)
class State:
    """One telemetry frame of the car, decoded, timed and integrated.

    t [s] device time mapped to the car's clock, monotone; seq frame counter,
    unwrapped; speed [m/s] signed with one sigma; yaw_rate [rad/s],
    accel_x, accel_y [m/s2] in body axes (None while the IMU is not valid);
    ticks encoder edges since boot, unwrapped; external: what a source of
    external poses knows (None: there is no such source); scan: the lidar's newest
    whole revolution, image: the camera's newest picture (None: there was none yet).
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
    external: External | None = None
    scan: Scan | None = None
    image: Image | None = None

    @property
    def estimate(self) -> MotionEstimate:
        """The best that is known of pose, speed and yaw rate at ``t``, with one covariance.

        By the Kalman filter in the room's frame once a source of poses has told one; until then,
        and without a source, dead reckoning (``pose``) in the frame ``START``. For the present
        moment: ``state.estimate.at(car.now)``.
        """
        seen = self.external
        if seen is not None and seen.estimate is not None:
            return seen.estimate
        cov = np.zeros((5, 5))
        cov[:3, :3] = self.pose.cov
        cov[3, 3] = self.speed_std**2
        cov[4, 4] = (NO_GYRO_STD if self.yaw_rate is None else GYRO_STD)**2
        cov.setflags(write=False)
        return MotionEstimate(self.t, self.pose, self.speed, self.yaw_rate or 0.0, cov, START,
                              Tracking.DEAD_RECKONING if seen is None else seen.tracking)

    def rows(self) -> Iterator[tuple[str, str]]:
        """What a person looks for first: (name, value with its unit)."""
        pose, applied, health = self.pose, self.applied, self.health
        yield "t", f"{self.t:.3f} s"
        yield "speed", f"{self.speed:.3f} +- {self.speed_std:.3f} m/s"
        yield "yaw rate", "none" if self.yaw_rate is None else f"{self.yaw_rate:.3f} rad/s"
        yield "pose", f"x {pose.x:.3f} m, y {pose.y:.3f} m, yaw {degrees(pose.yaw):.1f} deg"
        yield "steering", f"{degrees(applied.steering):.1f} deg, {applied.steering_us:.0f} us"
        yield "throttle", f"{applied.throttle:.3f}, {applied.throttle_us:.0f} us"
        yield "limited", ", ".join(map(str, applied.limited)) or "no"
        yield "doubts", ", ".join(sorted(health.doubts)) or "none"
        yield "frames", f"number {self.seq}, {health.lost} lost, {health.skipped} skipped"

    def __repr__(self) -> str:
        return f"<State {', '.join(f'{name} {value}' for name, value in self.rows())}>"

    def _repr_html_(self) -> str:
        return card("State", self.rows())


@dataclass(frozen=True, slots=True)
class Contact:
    """Two emulated cars of one world began to touch at t [s], half way between them at x, y [m]."""

    t: float
    cars: tuple[str, str]
    x: float
    y: float


NINETY = 1.645
"""Half width of a 90 % interval of the normal distribution, in standard errors."""


@dataclass(frozen=True, slots=True)
class Estimate:
    """A measured quantity: value, one sigma, unit."""

    value: float
    std: float
    unit: str = ""
