"""Columns against each other, and the model against the recordings: units, signs, the wrong car.

A physical cause changes a reading by some per cent. A factor of 1000 is a
unit, -1 is a sign, and neither is diagnosed.
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
from dart_hal.vehicle.compose import settled
from dart_hal.vehicle.namespace import ARRAY
from dart_hal.vehicle.parameters import Vehicle
from dart_hal.vehicle.steering import make_steering

from ..policy import MIN_READINGS, USUAL, InputPolicy
from .motion import at_messages

FACTORS = {1000.0: "thousandths: mm, mrad or mm/s2", 100.0: "cm", 57.2958: "degrees",
           3.6: "km/h", 1.0 / 9.81: "g", 0.001: "thousands: km or krad",
           1.0 / 57.2958: "degrees in what it is compared with", 0.01: "hundreds"}


def check_units(r: Recording, policy: InputPolicy = USUAL.inputs) -> None:
    """Errors: RecordingError that names the column and the factor by which it is off."""
    m, at = r.messages, at_messages(r)
    check = partial(_check, r, policy)
    if r.mocap is not None:
        drives, turns = at.speed > policy.driving, np.abs(at.omega) > policy.turning
        check("vicon yaw", at.omega, at.course, drives, "the direction of travel")
        check("vel encoder", m.speed, at.speed, drives, "the motion capture")
        check("W (IMU)", m.yaw_rate, at.omega, turns, "the motion capture")
    sideways = at.omega * at.speed
    check("acc y (IMU)", m.accel_y, sideways, np.abs(sideways) > policy.turning,
          "yaw rate times speed")


def without_dead_gyro(r: Recording, notes: list[str], policy: InputPolicy) -> Recording:
    """A gyro that never changes while the car turns reads nothing; that is said."""
    rate, at = r.messages.yaw_rate, at_messages(r)
    turns = np.nan_to_num(np.abs(at.omega)) > policy.turning
    if (r.mocap is None or turns.sum() < MIN_READINGS
            or not np.nanmax(np.abs(rate), initial=0.0) < policy.dead_gyro):
        return r
    if r.schema != "C":
        notes.append(f"{r.name}: the gyro is dead, so the gyro is not judged there")
    nothing = freeze(np.full(len(rate), np.nan))
    return replace(r, messages=replace(r.messages, yaw_rate=nothing))


def check_model(train: Sequence[Recording], p: Vehicle, policy: InputPolicy = USUAL.inputs
                ) -> list[str]:
    """What must be said of a model that looks like another car's.

    Only what rolling without slip tells is compared: how tightly the car turns for
    its commands. Weight and tyres of another car show as errors and nothing
    else. Errors: OtherCar where the model steers to the other side.
    """
    said, does = (np.concatenate(v) for v in zip(
        *[_turning(r, p, policy) for r in train], strict=True))
    times = does / said
    if len(times) < MIN_READINGS:
        return []
    factor = float(np.median(times))
    if (times * factor > 0.0).mean() < policy.correlation:
        return []  # neither side prevails
    if factor < 0.0:
        raise OtherCar(
            f"the model {p.name} steers to the other side than the car of these recordings",
            found=f"{factor:.2f} times the curvature that the model gives",
            expected="about 1 at low lateral acceleration",
            likely="a model of another car, or the sign of the steering command is turned over",
            remedy="if the recordings have the steering turned over, multiply their column "
                   "'steering' by -1; else dart-hal identify all FILES --out model.toml fits a "
                   "model to this car")
    if not 1.0 / policy.other_car < factor < policy.other_car:
        return [f"the car turns {factor:.2f} times as tightly as the model says, at speeds where "
                f"it rolls without slip: is {p.name} a model of this car? Its causes would be "
                "those of a comparison between two cars"]
    return []


def slope(y: FloatArray, x: FloatArray, policy: InputPolicy = USUAL.inputs) -> float:
    """Of y on x with an offset; NaN where they have too little to do with each other."""
    good = np.isfinite(x) & np.isfinite(y)
    if good.sum() < MIN_READINGS:
        return math.nan
    x, y = x[good] - x[good].mean(), y[good] - y[good].mean()
    size = math.sqrt(float(x @ x) * float(y @ y))
    if size == 0.0 or abs(float(x @ y)) < policy.correlation * size:
        return math.nan
    return float(x @ y) / float(x @ x)


def ratio(y: FloatArray, x: FloatArray, policy: InputPolicy = USUAL.inputs) -> float:
    """Median of y / x; NaN where it is not the same throughout, as for wheels that spin."""
    of = y / x
    low, middle, high = np.quantile(np.abs(of), [0.25, 0.5, 0.75])
    same = low > 0.0 and high < policy.quartiles * low
    return float(np.copysign(middle, np.median(of))) if same else math.nan


def _check(r: Recording, policy: InputPolicy, column: str, read: FloatArray, true: FloatArray,
           rows: BoolArray, witness: str) -> None:
    """A ratio for what has one sign, else the slope."""
    use = rows & np.isfinite(read) & np.isfinite(true)
    if use.sum() < MIN_READINGS:
        return
    x, y = true[use], read[use]
    factor = (ratio if (x > 0.0).all() else slope)(y, x, policy)
    if not math.isfinite(factor) or 1.0 / policy.factor < factor < policy.factor or factor == 0.0:
        return
    if column == "acc y (IMU)" and factor < 0.0:
        return  # an IMU that is mounted turned round; imu_yaw is an effect
    raise RecordingError(
        f"{r.name}: column {column!r} is {factor:.4g} times what {witness} says",
        found=f"a factor of {factor:.4g} over {int(use.sum())} messages", expected="about 1",
        likely=_meaning(factor, policy), read=str(r.path),
        remedy=f"divide the column by {_round(factor, policy):g}, if that is the cause")


def _meaning(factor: float, policy: InputPolicy) -> str:
    if factor < 0.0:
        return "the sign is turned over: positive is to the left (ISO 8855)"
    near = min(FACTORS, key=lambda f: abs(math.log(f / factor)))
    known = abs(math.log(near / factor)) < policy.log_factor
    return (f"{FACTORS[near]} instead of the SI unit" if known
            else "a wrong unit, or the columns of two recordings")


def _round(factor: float, policy: InputPolicy) -> float:
    """The factor as somebody would convert it."""
    if factor < 0.0:
        return -1.0
    near = min(FACTORS, key=lambda f: abs(math.log(f / factor)))
    return float(f"{near if abs(math.log(near / factor)) < policy.log_factor else factor:.4g}")


def _turning(r: Recording, p: Vehicle, policy: InputPolicy
             ) -> tuple[FloatArray, FloatArray]:
    """(what the model says, what the car did), (k,) rad/s of gentle turns with a steady wheel."""
    m, at = r.messages, at_messages(r)
    q = settled(p)
    late = m.t - q.delay.steering_s - q.delay.steering_lag_s
    angle = np.asarray(make_steering(q.steering, ARRAY)(np.interp(late, m.t, m.steering)))
    before = np.asarray(make_steering(q.steering, ARRAY)(np.interp(late - policy.steady_s, m.t,
                                                                   m.steering)))
    says = at.speed * np.tan(angle) / q.body.wheelbase
    with np.errstate(invalid="ignore"):
        gentle = ((at.speed > policy.driving)
                  & (np.abs(at.speed * at.omega) < policy.gentle))
    use = gentle & (np.abs(angle) > policy.steered) & (np.abs(angle - before) < policy.steady)
    return says[use], at.omega[use]
