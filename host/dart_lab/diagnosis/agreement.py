"""Check units and signs of columns against each other, and the model against the recordings.

A physical cause changes a reading by some per cent. A factor of 1000 is a wrong unit and -1 is a
wrong sign; neither is diagnosed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from dart_hal.core.errors import OtherCar, RecordingError
from dart_hal.core.types import BoolArray, FloatArray
from dart_hal.recording.dart import Recording
from dart_hal.recording.dart.model import freeze
from dart_hal.vehicle.compose import apply_parameter_effects
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering
from dart_lab.identification.evidence.policy import MIN_READINGS

from .motion import motion_at_messages
from .policy import USUAL, InputPolicy

UNIT_FACTORS = {1000.0: "thousandths: mm, mrad or mm/s2", 100.0: "cm", 57.2958: "degrees",
           3.6: "km/h", 1.0 / 9.81: "g", 0.001: "thousands: km or krad",
           1.0 / 57.2958: "degrees in what it is compared with", 0.01: "hundreds"}


def check_units(r: Recording, policy: InputPolicy = USUAL.inputs) -> None:
    """Compare each column with another source of the same quantity.

    Errors: RecordingError that names the column and the factor between the two.
    """
    m = r.messages
    motion = motion_at_messages(r)
    check = partial(_check_column, r, policy)
    drives = motion.speed > policy.min_speed
    turns = np.abs(motion.omega) > policy.min_yaw_rate
    if r.mocap is not None:
        check("vicon yaw", motion.omega, motion.course, drives, "the direction of travel")
        check("vel encoder", m.speed, motion.speed, drives, "the motion capture")
        check("W (IMU)", m.yaw_rate, motion.omega, turns, "the motion capture")
    # In a turn without slip the lateral acceleration is yaw rate times speed.
    lateral = motion.omega * motion.speed
    check("acc y (IMU)", m.accel_y, lateral, drives & turns, "yaw rate times speed")


def drop_dead_gyro(r: Recording, notes: list[str], policy: InputPolicy) -> Recording:
    """Replace a gyro that always reads 0 though the car turns by NaN, and add a note."""
    rate = r.messages.yaw_rate
    turns = np.nan_to_num(np.abs(motion_at_messages(r).omega)) > policy.min_yaw_rate
    if (r.mocap is None or not np.isfinite(rate).any() or turns.sum() < MIN_READINGS
            or np.nan_to_num(rate).any()):
        return r
    if r.schema != "C":
        notes.append(f"{r.name}: the gyro is dead, so the gyro is not judged there")
    nothing = freeze(np.full(len(rate), np.nan))
    return replace(r, messages=replace(r.messages, yaw_rate=nothing))


def check_model(train: Sequence[Recording], p: Vehicle, policy: InputPolicy = USUAL.inputs
                ) -> list[str]:
    """Return a warning if the model looks like that of another car, else an empty list.

    Only the curvature at low lateral acceleration is compared, where the car rolls without slip.
    Mass and tyres of another car cannot be distinguished from a model error. Errors: OtherCar if
    the model steers to the other side.
    """
    predicted, measured = (np.concatenate(v) for v in zip(
        *[_compare_yaw_rates(r, p, policy) for r in train], strict=True))
    # Median of the ratios: a part of the turns may be disturbed.
    ratios = measured / predicted
    if len(ratios) < MIN_READINGS:
        return []
    factor = float(np.median(ratios))
    if (ratios * factor > 0.0).mean() < policy.min_correlation:
        return []  # the signs do not agree
    if factor < 0.0:
        raise OtherCar(
            f"the model {p.name} steers to the other side than the car of these recordings",
            found=f"{factor:.2f} times the curvature that the model gives",
            expected="about 1 at low lateral acceleration",
            likely="a model of another car, or the sign of the steering command is turned over",
            remedy="if the recordings have the steering turned over, multiply their column "
                   "'steering' by -1; else dart-hal identify all FILES --out model.toml fits a "
                   "model to this car")
    if not 1.0 / policy.max_curvature_factor < factor < policy.max_curvature_factor:
        return [f"the car turns {factor:.2f} times as tightly as the model predicts, at speeds "
                f"where it rolls without slip: is {p.name} a model of this car? Its causes would "
                "be those of a comparison between two cars"]
    return []


def slope(y: FloatArray, x: FloatArray, policy: InputPolicy = USUAL.inputs) -> float:
    """Return the slope of y over x with an offset; NaN if they correlate too little."""
    good = np.isfinite(x) & np.isfinite(y)
    if good.sum() < MIN_READINGS:
        return math.nan
    # Covariance over variance of x; a correlation below the limit has no meaningful slope.
    x, y = x[good] - x[good].mean(), y[good] - y[good].mean()
    size = math.sqrt(float(x @ x) * float(y @ y))
    if size == 0.0 or abs(float(x @ y)) < policy.min_correlation * size:
        return math.nan
    return float(x @ y) / float(x @ x)


def ratio(y: FloatArray, x: FloatArray, policy: InputPolicy = USUAL.inputs) -> float:
    """Return the median of y / x; NaN if the ratio is not constant, as for spinning wheels."""
    ratios = y / x
    # A wrong unit is one factor for all readings, so the quartiles of the ratios are close to each
    # other.
    low, middle, high = np.quantile(np.abs(ratios), [0.25, 0.5, 0.75])
    constant = low > 0.0 and high < policy.max_quartile_ratio * low
    return float(np.copysign(middle, np.median(ratios))) if constant else math.nan


def _check_column(r: Recording, policy: InputPolicy, column: str, read: FloatArray,
                  true: FloatArray, rows: BoolArray, source: str) -> None:
    """Compare readings with true values: by their ratio if these have one sign, else by a slope."""
    use = rows & np.isfinite(read) & np.isfinite(true)
    if use.sum() < MIN_READINGS:
        return
    x = true[use]
    y = read[use]
    factor = (ratio if (x > 0.0).all() else slope)(y, x, policy)
    largest = policy.max_factor
    if not math.isfinite(factor) or 1.0 / largest < factor < largest or factor == 0.0:
        return
    if column == "acc y (IMU)" and factor < 0.0:
        return  # an IMU mounted the other way round, which the effect imu_yaw describes
    raise RecordingError(
        f"{r.name}: column {column!r} is {factor:.4g} times the value of {source}",
        found=f"a factor of {factor:.4g} over {int(use.sum())} messages", expected="about 1",
        likely=_explain_factor(factor, policy), read=str(r.path),
        remedy=f"divide the column by {_nearest_factor(factor, policy):g}, if that is the cause")


def _explain_factor(factor: float, policy: InputPolicy) -> str:
    """Name the likely cause of a factor."""
    if factor < 0.0:
        return "the sign is turned over: positive is to the left (ISO 8855)"
    near = min(UNIT_FACTORS, key=lambda f: abs(math.log(f / factor)))
    known = abs(math.log(near / factor)) < policy.max_log_error
    return (f"{UNIT_FACTORS[near]} instead of the SI unit" if known
            else "a wrong unit, or the columns of two recordings")


def _nearest_factor(factor: float, policy: InputPolicy) -> float:
    """Return the factor of the nearest unit, or the factor itself."""
    if factor < 0.0:
        return -1.0
    near = min(UNIT_FACTORS, key=lambda f: abs(math.log(f / factor)))
    return float(f"{near if abs(math.log(near / factor)) < policy.max_log_error else factor:.4g}")


def _compare_yaw_rates(r: Recording, p: Vehicle, policy: InputPolicy
             ) -> tuple[FloatArray, FloatArray]:
    """Return predicted and measured yaw rates (k,) [rad/s] in gentle turns at a steady angle.

    Without slip the yaw rate is v tan(delta) / l.
    """
    m = r.messages
    motion = motion_at_messages(r)
    q = apply_parameter_effects(p)
    steering = make_steering(q.steering, ARRAY)
    # The angle now is that of the command one delay and one lag ago.
    sent = m.t - q.delay.steering_s - q.delay.steering_lag_s
    angle = np.asarray(steering(np.interp(sent, m.t, m.steering)))
    earlier = np.asarray(steering(np.interp(sent - policy.angle_change_s, m.t, m.steering)))
    predicted = motion.speed * np.tan(angle) / q.body.wheelbase
    with np.errstate(invalid="ignore"):
        gentle = ((motion.speed > policy.min_speed)
                  & (np.abs(motion.speed * motion.omega) < policy.max_lateral_accel))
    steady = np.abs(angle - earlier) < policy.max_angle_change
    use = gentle & steady & (np.abs(angle) > policy.min_wheel_angle)
    return predicted[use], motion.omega[use]
