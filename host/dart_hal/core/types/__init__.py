"""Values that packages exchange: frozen, in SI units, in ISO 8855 axes.

x forward, y left, angles positive to the left. A name has a suffix only if its unit is not SI
(``_us``, ``_deg``, ``_ticks``).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from enum import Enum
from math import cos, degrees, isfinite, sin, tau

import numpy as np
from numpy.typing import NDArray

from dart_hal.compat import RenamedMethod
from dart_hal.core.notebook import card
from dart_hal.core.types.image import Image as Image
from dart_hal.core.types.scan import Mount as Mount
from dart_hal.core.types.scan import Scan as Scan

FloatArray = NDArray[np.float64]
IntArray = NDArray[np.int64]
BoolArray = NDArray[np.bool_]


class TextEnum(str, Enum):
    """Values that are texts, and print as such."""

    def __str__(self) -> str:
        return str(self.value)


class Limit(TextEnum):
    """Why the pins do not output the requested command.

    VALIDITY: the command is valid for less than its ``valid_for``: 0.5 s, or 0.2 s if raw.
    PULSES_OFF: servo and ESC have no pulses, because no State shows whether the car moves, or
    because it accelerated at neutral (MOVES_AT_NEUTRAL).
    BATTERY: the battery is low, and the throttle is limited.
    RC_OVERRIDE: the driver of an RC transmitter overrides the program. RC_LOST: his signal was
    lost while he did.
    OBSTACLE: an obstacle is nearer than ``guard_distance`` allows, or no scan shows a free path.
    A command that a source of higher priority overrides has the string ``"OVERRIDDEN(name)"``.
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
    OBSTACLE = "OBSTACLE"
    BATTERY = "BATTERY"
    RC_OVERRIDE = "RC_OVERRIDE"
    RC_LOST = "RC_LOST"


class Doubt(TextEnum):
    """Detected fault of a value of the State; the prefix is the sensor.

    ENCODER_DEAD: no edges although the wheels must turn. ENCODER_LOW: too few edges. In both
    cases the IMU measures a motion that the edges do not show. ENCODER_HIGH: more edges than
    throttle or a push by hand explain. ENCODER_NOISY: edges that no wheel can cause were dropped.
    ENCODER_SLIPS: the wheels turn faster than the car moves (wheel spin, or a lifted car).
    IMU_ZERO, IMU_RANGE, IMU_STEP: impossible samples. IMU_DISAGREES: a yaw rate that contradicts
    the wheels. CAR_SLIDES: the yaw rate exceeds that of the wheels, and the gyro is used.
    DIRECTION_UNSURE: the wheels turn, and neither command nor acceleration determines the
    direction: speed and distance may have the other sign. SAMPLES_JUMPED: samples of the IMU
    jumped and returned, twice within 3 s. A single one was replaced; two in a row are in the yaw,
    and its covariance includes them.
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


# Doubts with which no feedback loop may use the speed.
SPEED_DOUBTS = frozenset({Doubt.ENCODER_DEAD.value, Doubt.ENCODER_LOW.value,
                          Doubt.ENCODER_HIGH.value})


@dataclass(frozen=True, slots=True)
class Applied:
    """Present output of the pins, after limits, slew rate and quantisation to counts.

    steering [rad], throttle [-1..1]; ``*_us``: true pulse widths, by the calibrated PCA9685
    clock. Throttle 1.0 is the throttle span of ``car.toml`` (450 us) above neutral.
    """

    steering: float
    throttle: float
    steering_us: float
    throttle_us: float
    limited: tuple[str, ...] = ()


NEUTRAL_APPLIED = Applied(0.0, 0.0, 1500.0, 1500.0)


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


# m and rad, standard deviations of a motion capture without own ones (docs/reference/poses.md).
POSE_STD = 0.001
POSE_YAW_STD = 0.002


# m: larger than any room, and small enough for squares.
MAX_COORDINATE = 1e5
# s: largest time of builtin_interfaces/Time. Unix time in ms exceeds it.
MAX_STAMP = 2.0**31


def nanoseconds(t: float) -> int:
    """Round t [s] to whole ns, exactly: a product of floats has an error of 100 ns."""
    numerator, denominator = t.as_integer_ratio()
    return (2 * numerator * 10**9 + denominator) // (2 * denominator)


def pose_cov(std: float = POSE_STD, yaw_std: float = POSE_YAW_STD) -> FloatArray:
    """Return the covariance (3, 3) of x, y, yaw without correlation; read-only."""
    cov = np.diag([std * std, std * std, yaw_std * yaw_std])
    cov.setflags(write=False)
    return cov


@dataclass(frozen=True, slots=True)
class ExternalPose:
    """Pose of a tracked body, measured from outside of the car.

    stamp [s]: time of the measurement on the source's clock; arrival [s]: on the car's clock;
    x, y [m] and yaw [rad]: marker frame in the room's frame, z up; cov (3, 3): their covariance;
    frame: name of the room's frame. The stamp is rounded to whole ns and the yaw, wrapped to
    +-pi, to whole nrad, as in a recording, so that a replay has identical numbers. Raises
    ValueError for numbers that are not finite or exceed ``MAX_COORDINATE``, and for stamps that
    are no seconds.
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


class Tracking(TextEnum):
    """State of the localisation by external poses.

    TRACKING: poses arrive and are accepted. DEAD_RECKONING: no recent pose; the last one is
    extrapolated by wheels and gyro. JUMPED: poses arrive that the car cannot have reached
    (another body, a wrong match) and are rejected. LOST: no pose yet, or the last one is too old.
    """

    TRACKING = "TRACKING"
    DEAD_RECKONING = "DEAD_RECKONING"
    JUMPED = "JUMPED"
    LOST = "LOST"


# s: longest prediction of a motion, longer than any delay that a controller compensates.
MAX_PREDICTION = 0.5
# m/s2 and rad/s2, standard deviations of the accelerations that a prediction with constant speed
# and yaw rate neglects: of the throttle, and of a steering angle that changes by 0.3 rad in 0.4 s
# at 1 m/s.
ACCELERATION_STDS = (2.0, 5.0)


@dataclass(frozen=True, slots=True)
class MotionEstimate:
    """Estimated pose and motion of the rear axle at ``t`` [s] on the car's clock.

    pose: x, y [m], yaw [rad]; speed [m/s], signed; yaw_rate [rad/s]; cov (5, 5): covariance of x,
    y, yaw, speed, yaw_rate, read-only, its first (3, 3) block that of ``pose``. frame: that of the
    room, if a Kalman filter combines wheels, gyro and external poses (``estimation/room.py``);
    ``START_FRAME`` before the first external pose: dead reckoning from the pose at which the car
    was opened. tracking: state of the source of external poses.
    """

    t: float
    pose: Pose
    speed: float
    yaw_rate: float
    cov: FloatArray
    frame: str
    tracking: Tracking

    def predict(self, t: float) -> MotionEstimate:
        """Predict the motion to t [s], such as ``car.now``, with constant speed and yaw rate.

        The prediction ends after ``MAX_PREDICTION``. The covariance increases by the neglected
        accelerations (``ACCELERATION_STDS``). An earlier t returns the estimate itself.
        """
        dt = min(t - self.t, MAX_PREDICTION)
        if dt <= 0.0:
            return self
        # 1. Move along the chord of the arc, in the mean direction of the motion.
        pose = self.pose
        length = self.speed * dt
        turn = self.yaw_rate * dt
        c = cos(pose.yaw + 0.5 * turn)
        s = sin(pose.yaw + 0.5 * turn)
        # 2. step: Jacobian (5, 5) of the prediction with respect to x, y, yaw, speed, yaw_rate.
        step = np.eye(5)
        step[:2, 2] = -length * s, length * c
        step[:2, 3] = dt * c, dt * s
        step[:2, 4] = -0.5 * dt * length * s, 0.5 * dt * length * c
        step[2, 4] = dt
        # 3. noise (5, 2): effect of one standard deviation of each acceleration. Within dt, the
        # mean change of speed and yaw rate is half of the final one.
        speed_std, yaw_rate_std = (change * dt for change in ACCELERATION_STDS)
        noise = np.zeros((5, 2))
        noise[:2, 0] = 0.5 * dt * speed_std * np.array((c, s))
        noise[3, 0] = speed_std
        noise[:3, 1] = 0.5 * yaw_rate_std * step[:3, 4]
        noise[4, 1] = yaw_rate_std
        cov = step @ self.cov @ step.T + noise @ noise.T
        cov.setflags(write=False)
        moved = Pose(pose.x + length * c, pose.y + length * s, pose.yaw + turn, cov[:3, :3])
        return replace(self, t=self.t + dt, pose=moved, cov=cov)

    at = RenamedMethod("predict")


# Frame of dead reckoning: its origin is the pose at which the car was opened.
START_FRAME = "start"
# rad/s, standard deviations of ``State.yaw_rate`` and of a yaw rate that is not measured.
GYRO_STD = 0.02
NO_GYRO_STD = 0.3


@dataclass(frozen=True, slots=True)
class External:
    """Pose of the car in the room, from a source of external poses and the car's wheels.

    pose: marker frame at ``State.t``: the last accepted pose plus the odometry since then, with a
    growing covariance (None before the first pose); age [s]: of that last pose (inf = none);
    newest: the last received pose, accepted or not; estimate: of the Kalman filter in the room's
    frame (None until the first accepted pose).
    """

    tracking: Tracking
    age: float
    pose: Pose | None
    newest: ExternalPose | None
    estimate: MotionEstimate | None = None


@dataclass(frozen=True, slots=True)
class Health:
    """Reliability of the values of a State.

    ``flags``: names of the ``wire.messages.STATE_FLAGS`` that are set; ``imu_age`` [s]: since the
    last yaw rate of the IMU (its filter adds 5 ms); ``beat_age`` [s]: since the last heartbeat
    (inf = none); ``lost``: lost frames since open; ``vcc`` [V] (None = not measured); ``t_std``
    [s]: standard deviation of ``State.t``; ``accel_kind``: "linear" (without gravity) or "raw";
    ``calib``: levels 0..3 of the BNO055 (sys, gyr, acc, mag); ``doubts``: names of ``Doubt``;
    ``jumped``: samples of the IMU since open that jumped and returned at once.
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
        """The wheels must turn, but there are no edges: the throttle is limited."""
        return Doubt.ENCODER_DEAD.value in self.doubts

    @property
    def speed_doubted(self) -> bool:
        """The speed is not that of the car: no speed controller may use it."""
        return not SPEED_DOUBTS.isdisjoint(self.doubts)

    @property
    def imu_doubted(self) -> bool:
        """The samples of the IMU are not used."""
        return any(name.startswith("IMU_") for name in self.doubts)


@dataclass(frozen=True, slots=True)
class State:
    """One telemetry frame of the car: decoded, with host time and odometry.

    t [s]: device time on the car's clock, monotone; seq: frame counter, unwrapped; speed [m/s],
    signed, and its standard deviation; yaw_rate [rad/s], accel_x, accel_y [m/s2] in body axes
    (None while the IMU is not valid); ticks: encoder edges since boot, unwrapped; external: pose
    by external poses (None: no source); scan: newest complete revolution of the lidar, image:
    newest image of the camera (None: none yet); battery [V]: newest reading of its voltage (None:
    no sensor, or it does not answer).
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
    battery: float | None = None

    @property
    def estimate(self) -> MotionEstimate:
        """Best estimate of pose, speed and yaw rate at ``t``, with their joint covariance.

        After the first external pose, it is that of the Kalman filter in the room's frame. Before
        and without a source, it is dead reckoning (``pose``) in ``START_FRAME``. For the present
        time: ``state.estimate.predict(car.now)``.
        """
        external = self.external
        if external is not None and external.estimate is not None:
            return external.estimate
        cov = np.zeros((5, 5))
        cov[:3, :3] = self.pose.cov
        cov[3, 3] = self.speed_std**2
        cov[4, 4] = (NO_GYRO_STD if self.yaw_rate is None else GYRO_STD)**2
        cov.setflags(write=False)
        tracking = Tracking.DEAD_RECKONING if external is None else external.tracking
        return MotionEstimate(self.t, self.pose, self.speed, self.yaw_rate or 0.0, cov,
                              START_FRAME, tracking)

    def rows(self) -> Iterator[tuple[str, str]]:
        """Iterate over the main values: (name, value with its unit)."""
        pose = self.pose
        applied = self.applied
        health = self.health
        yield "t", f"{self.t:.3f} s"
        yield "speed", f"{self.speed:.3f} +- {self.speed_std:.3f} m/s"
        yield "yaw rate", "none" if self.yaw_rate is None else f"{self.yaw_rate:.3f} rad/s"
        yield "pose", f"x {pose.x:.3f} m, y {pose.y:.3f} m, yaw {degrees(pose.yaw):.1f} deg"
        yield "steering", f"{degrees(applied.steering):.1f} deg, {applied.steering_us:.0f} us"
        yield "throttle", f"{applied.throttle:.3f}, {applied.throttle_us:.0f} us"
        yield "limited", ", ".join(map(str, applied.limited)) or "no"
        yield "doubts", ", ".join(sorted(health.doubts)) or "none"
        if self.battery is not None:
            yield "battery", f"{self.battery:.2f} V"
        yield "frames", f"number {self.seq}, {health.lost} lost, {health.skipped} skipped"

    def __repr__(self) -> str:
        return f"<State {', '.join(f'{name} {value}' for name, value in self.rows())}>"

    def _repr_html_(self) -> str:
        return card("State", self.rows())


@dataclass(frozen=True, slots=True)
class Contact:
    """First contact of two emulated cars: at t [s], midway between them at x, y [m]."""

    t: float
    cars: tuple[str, str]
    x: float
    y: float


# Half width of the 90 % interval of a normal distribution, in standard deviations.
INTERVAL_90 = 1.645


@dataclass(frozen=True, slots=True)
class Estimate:
    """A measured quantity: value, standard error, unit."""

    value: float
    std: float
    unit: str = ""
