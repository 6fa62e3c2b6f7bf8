"""``calibration.toml``: quantities measured on one car, with standard errors.

Keys and units are those of the ``calibrate`` verbs. Errors are raised for a value without a
standard error, for the file of another car and for a steering map that is not monotone. Tables
that are not measured yet are absent.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from typing import Any, Literal

import msgspec

from dart_hal.core.config.parse import METRES_PER_EDGE_RANGE, check_std, parse, require
from dart_hal.core.config.plausible import CALIBRATION_RANGES, check_ranges
from dart_hal.core.config.quantity import FileTable, Quantities, Quantity
from dart_hal.core.config.ranges import check_neutral, check_oscillator
from dart_hal.core.errors import ConfigError, NotMonotone, OtherCar

CALIBRATION_SCHEMA = "dart-hal/calibration/1"
# Older calibrations give the warning CALIBRATION_OLD.
MAX_CALIBRATION_AGE = timedelta(days=180)
# The number of a Nano, as ``dart-hal find`` prints it.
BOARD_NUMBER = re.compile("[0-9a-f]{8}")


class PwmClock(FileTable, frozen=True, kw_only=True):
    """oscillator_hz: the PCA9685's clock, nominally 25 MHz."""

    oscillator_hz: Quantity | None = None


class SteeringTable(FileTable, frozen=True, kw_only=True):
    """Points of the steering map: pulse_us rising, angle_rad of the road wheels.

    The angle is the middle of the backlash loop and strictly monotone. ``covariance`` (n, n)
    [rad2] of the angles, if the fit has one.
    """

    pulse_us: tuple[float, ...]
    angle_rad: tuple[float, ...]
    std_rad: tuple[float, ...]
    covariance: tuple[tuple[float, ...], ...] | None = None


class PaperForm(FileTable, frozen=True, kw_only=True):
    """The same map as the five parameters of the paper, for comparison only."""

    k_left: float
    a_left_rad: float
    s0: float
    a_right_rad: float
    k_right: float


class SteeringCalibration(FileTable, frozen=True, kw_only=True):
    """The map, its paper form, backlash [rad], slew rate of the servo [us/s of pulse width] and
    residual of the fit [rad]."""

    map: SteeringTable | None = None
    paper_form: PaperForm | None = None
    backlash: Quantity | None = None
    slew_us_s: Quantity | None = None
    residual_rms_rad: float | None = None


class DriveTable(FileTable, frozen=True, kw_only=True):
    """Pulses of the ESC [us] for constant speeds [m/s] straight ahead; both increase."""

    speed: tuple[float, ...]
    pulse_us: tuple[float, ...]
    std_us: tuple[float, ...]


class ThrottleCalibration(FileTable, frozen=True, kw_only=True):
    """Pulse widths of the ESC [us]: neutral, dead bands, saturation and pulses of constant speeds.

    Dead bands and saturation are offsets from neutral. ``reverse``: when a pulse below neutral
    reverses after driving forward; ``reverse_rest`` [s]: time at neutral after which it does;
    ``signal_loss`` [s]: time without pulses until the motor has no current; ``brake`` [m/s2]: what
    a throttle of -1 adds to the deceleration after driving forward.
    """

    neutral_us: Quantity | None = None
    deadband_forward_us: Quantity | None = None
    deadband_reverse_us: Quantity | None = None
    saturation_us: Quantity | None = None
    reverse: Literal["after_brake", "at_once", "never"] | None = None
    reverse_rest: Quantity | None = None
    signal_loss: Quantity | None = None
    brake: Quantity | None = None
    drive: DriveTable | None = None


class EncoderCalibration(FileTable, frozen=True, kw_only=True):
    """metres_per_edge [m]; ring (N,): interval lengths of one revolution, mean 1."""

    metres_per_edge: Quantity | None = None
    ring: Quantities | None = None


class ImuCalibration(FileTable, frozen=True, kw_only=True):
    """gyro_bias [rad/s] and gyro_scale about the yaw axis; mounting angles [rad]."""

    gyro_bias: Quantity | None = None
    gyro_scale: Quantity | None = None
    mount_yaw: Quantity | None = None
    mount_pitch: Quantity | None = None
    mount_roll: Quantity | None = None


class LatencyCalibration(FileTable, frozen=True, kw_only=True):
    """Delays [s] of the control loop, and the time constants of the first-order lags after them.

    command_to_pulse: from a command to the end of its first pulse, mean;
    pulse_to_wheel, pulse_to_wheel_lag: from there to the force of the motor;
    pulse_to_yaw, pulse_to_yaw_lag: from there to the road wheels, measured by the yaw rate;
    sensor_to_host: from a sample to the arrival of its State.
    """

    command_to_pulse: Quantity | None = None
    pulse_to_wheel: Quantity | None = None
    pulse_to_wheel_lag: Quantity | None = None
    pulse_to_yaw: Quantity | None = None
    pulse_to_yaw_lag: Quantity | None = None
    sensor_to_host: Quantity | None = None


class MocapCalibration(FileTable, frozen=True, kw_only=True):
    """Marker frame on the car: marker_x, marker_y [m] from the rear axle, marker_yaw [rad].

    marker_yaw is added to the yaw of a pose. latency [s]: delay of a pose in addition to the one
    that its stamp and the earliest arrivals give.
    """

    marker_x: Quantity | None = None
    marker_y: Quantity | None = None
    marker_yaw: Quantity | None = None
    latency: Quantity | None = None


class LidarCalibration(FileTable, frozen=True, kw_only=True):
    """Mounting of the lidar: axis mount_x, mount_y [m] from the rear axle, mount_yaw [rad].

    mount_yaw is the direction of its zero angle; scale: true distance / reported distance.
    """

    mount_x: Quantity | None = None
    mount_y: Quantity | None = None
    mount_yaw: Quantity | None = None
    scale: Quantity | None = None


class Calibration(FileTable, frozen=True, kw_only=True):
    """All measured quantities of the car ``car``; ``provenance`` has free text and hashes.

    ``board``: number of the Nano of the measurements, from HELLO, 8 hexadecimal digits; None in
    files of versions that did not record it.
    """

    schema: str = CALIBRATION_SCHEMA
    car: str
    board: str | None = None
    pwm: PwmClock = PwmClock()
    steering: SteeringCalibration = SteeringCalibration()
    throttle: ThrottleCalibration = ThrottleCalibration()
    encoder: EncoderCalibration = EncoderCalibration()
    imu: ImuCalibration = ImuCalibration()
    latency: LatencyCalibration = LatencyCalibration()
    mocap: MocapCalibration = MocapCalibration()
    lidar: LidarCalibration = LidarCalibration()
    provenance: dict[str, Any] = msgspec.field(default_factory=dict)

    def with_quantities(self, values: dict[str, Quantity | Quantities]) -> Calibration:
        """Return a copy with some quantities replaced, by name such as "pwm.oscillator_hz".

        Raises ConfigError for a name that calibration.toml does not have.
        """
        changed = self
        for name, value in values.items():
            table, _, key = name.partition(".")
            if table not in CALIBRATION_TABLES or key not in getattr(self, table).__struct_fields__:
                raise ConfigError(f"calibration.toml has no quantity {name}", found=name,
                                  expected="one of " + ", ".join(QUANTITIES),
                                  remedy="use a name of that list")
            inner = msgspec.structs.replace(getattr(changed, table), **{key: value})
            changed = msgspec.structs.replace(changed, **{table: inner})
        return changed

    def quantities(self) -> dict[str, Quantity | Quantities]:
        """Return the measured quantities by name "table.key"."""
        found = {name: getattr(getattr(self, name.partition(".")[0]), name.partition(".")[2])
                 for name in QUANTITIES}
        return {name: value for name, value in found.items() if value is not None}

    def warnings(self, now: datetime, firmware: str | None = None) -> tuple[str, ...]:
        """Return the names of the warnings: CALIBRATION_OLD, FIRMWARE_CHANGED.

        now: with a time zone; firmware: hash of the running image, None if unknown.
        """
        names = []
        when = self.provenance.get("when")
        if isinstance(when, datetime):
            aware = when if when.tzinfo else when.replace(tzinfo=timezone.utc)
            names += ["CALIBRATION_OLD"] if now - aware > MAX_CALIBRATION_AGE else []
        recorded = self.provenance.get("firmware")
        names += ["FIRMWARE_CHANGED"] if firmware and recorded not in (None, firmware) else []
        return tuple(names)


CALIBRATION_TABLES = ("pwm", "steering", "throttle", "encoder", "imu", "latency", "mocap", "lidar")
# Names of the measured quantities, as the verbs print them.
QUANTITIES = ("pwm.oscillator_hz", "steering.backlash", "steering.slew_us_s", "throttle.neutral_us",
              "throttle.deadband_forward_us", "throttle.deadband_reverse_us",
              "throttle.saturation_us", "throttle.reverse_rest", "throttle.signal_loss",
              "throttle.brake",
              "encoder.metres_per_edge", "encoder.ring",
              "imu.gyro_bias", "imu.gyro_scale", "imu.mount_yaw", "imu.mount_pitch",
              "imu.mount_roll", "latency.command_to_pulse", "latency.pulse_to_wheel",
              "latency.pulse_to_wheel_lag", "latency.pulse_to_yaw", "latency.pulse_to_yaw_lag",
              "latency.sensor_to_host", "mocap.marker_x", "mocap.marker_y", "mocap.marker_yaw",
              "mocap.latency", "lidar.mount_x", "lidar.mount_y", "lidar.mount_yaw", "lidar.scale")

# rad, 46 deg: the largest wheel angle of a steering linkage of this size.
MAX_WHEEL_ANGLE = 0.8

_POSITIVE = {"pwm.oscillator_hz", "throttle.neutral_us", "throttle.saturation_us",
             "throttle.reverse_rest", "throttle.signal_loss",
             "encoder.metres_per_edge", "encoder.ring", "imu.gyro_scale", "lidar.scale"}


def parse_calibration(text: str, origin: str, car: str | None = None, *,
                      deliberate_us: float | None = None, recorded: bool = False) -> Calibration:
    """Read the text of a calibration.toml that must belong to ``car`` (None = any).

    deliberate_us: the unusual neutral [us] that car.toml marks as deliberate.
    recorded: the text comes from a recording, which drives no car: its neutral and oscillator may
    be outside of the present ranges.
    Raises OtherCar, NotMonotone, ConfigError, with ``origin`` and key.
    """
    return check_calibration(parse(text, Calibration, origin), origin, car,
                             deliberate_us=deliberate_us, recorded=recorded)


def check_calibration(cal: Calibration, origin: str, car: str | None = None, *,
                      deliberate_us: float | None = None, recorded: bool = False) -> Calibration:
    """Check a calibration and return it. Arguments and errors: ``parse_calibration``."""
    if car is not None and cal.car != car:
        raise OtherCar(f"{origin}: key car names another car", found=cal.car, expected=car,
                       read=origin)
    require(cal.board is None or BOARD_NUMBER.fullmatch(cal.board) is not None, origin, "board",
            repr(cal.board), "8 hexadecimal digits, as dart-hal find shows them",
            "dart-hal calibrate accept-board")
    for name, value in cal.quantities().items():
        check_std(value, name, origin, positive=name in _POSITIVE)
    check_ranges(cal, CALIBRATION_RANGES, origin)
    if not recorded:
        _check_pulse_widths(cal, origin, deliberate_us)
    metres = cal.encoder.metres_per_edge
    low, high = METRES_PER_EDGE_RANGE
    require(metres is None or low <= metres.value <= high, origin, "encoder.metres_per_edge.value",
            metres and metres.value, "0.0002 to 0.05 m; are these millimetres?")
    # The intervals of a ring are relative to their mean, so their sum is their number.
    ring = cal.encoder.ring
    require(ring is None or abs(sum(ring.value) - len(ring.value)) < 1e-3 * len(ring.value),
            origin, "encoder.ring.value", ring and sum(ring.value),
            f"the sum {len(ring.value) if ring else 0} (mean 1)")
    scale = cal.lidar.scale
    require(scale is None or 0.9 <= scale.value <= 1.1, origin, "lidar.scale.value",
            scale and scale.value, "0.9 to 1.1")
    if cal.steering.map is not None:
        _check_map(cal.steering.map, origin)
    if cal.throttle.drive is not None:
        _check_drive(cal.throttle.drive, origin)
    return cal


def _check_pulse_widths(cal: Calibration, origin: str, deliberate_us: float | None) -> None:
    check_oscillator(cal.pwm.oscillator_hz, origin)
    neutral = cal.throttle.neutral_us
    if neutral is not None:
        check_neutral(neutral.value, deliberate_us, origin, "throttle.neutral_us.value")


def _check_map(table: SteeringTable, origin: str) -> None:
    n = len(table.pulse_us)
    require(n >= 2, origin, "steering.map.pulse_us", f"{n} points", "at least 2 points")
    for key in ("angle_rad", "std_rad", "covariance"):
        column = getattr(table, key)
        require(column is None or len(column) == n, origin, f"steering.map.{key}",
                f"{len(column or ())} rows", f"{n}, one for each pulse_us")
    require(min(table.std_rad) >= 0, origin, "steering.map.std_rad", min(table.std_rad), ">= 0")
    _check_monotone("pulse_us", table.pulse_us, origin, falling=False)
    _check_monotone("angle_rad", table.angle_rad, origin, falling=True)
    largest = max(map(abs, table.angle_rad))
    require(largest <= MAX_WHEEL_ANGLE, origin, "steering.map.angle_rad", largest,
            f"at most {MAX_WHEEL_ANGLE} rad; are these degrees?")
    first, *_, last = table.pulse_us  # increasing, as checked above
    require(first >= 500 and last <= 2500, origin, "steering.map.pulse_us", f"{first} to {last}",
            "500 to 2500 us")


def _check_drive(table: DriveTable, origin: str) -> None:
    n = len(table.speed)
    require(n >= 2, origin, "throttle.drive.speed", f"{n} points", "at least 2 points")
    for key in ("pulse_us", "std_us"):
        require(len(getattr(table, key)) == n, origin, f"throttle.drive.{key}",
                f"{len(getattr(table, key))} rows", f"{n}, one for each speed")
    require(min(table.std_us) > 0, origin, "throttle.drive.std_us", min(table.std_us), "> 0")
    require(table.speed[0] > 0, origin, "throttle.drive.speed", table.speed[0], "> 0 m/s")
    for key in ("speed", "pulse_us"):
        _check_monotone(key, getattr(table, key), origin, falling=False, table="throttle.drive",
                        likely="two drives with another battery, or a key that was typed")
    require(table.pulse_us[0] >= 500 and table.pulse_us[-1] <= 2500, origin,
            "throttle.drive.pulse_us", f"{table.pulse_us[0]} to {table.pulse_us[-1]}",
            "500 to 2500 us")


def _check_monotone(key: str, column: Sequence[float], origin: str, *, falling: bool,
                    table: str = "steering.map",
                    likely: str = "backlash or a slipping horn during the measurement") -> None:
    """Raise NotMonotone unless a column increases, or decreases if ``falling`` permits it."""
    # The first and the last value determine the direction; every step must agree with it.
    sign = -1.0 if falling and column[-1] < column[0] else 1.0
    for index in range(len(column) - 1):
        if not sign * (column[index + 1] - column[index]) > 0:
            direction = "fall" if sign < 0 else "rise"
            raise NotMonotone(
                f"{origin}: {table}.{key} turns back at point {index + 2}",
                found=f"{column[index]} then {column[index + 1]}",
                expected=f"values that {direction} at every point",
                likely=likely, read=origin)
