"""Refuse files with impossible values: wrong units (mm/s, deg/s, ms) or damaged numbers.

One such value is enough, because the other numbers of the file may be damaged too. The limits are
those of small cars, at least three times the largest values of the published recordings. A file
may exceed those of speed and position if its own motion supports it: a car at 30 m/s moves
smoothly, and motion capture and encoder agree.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.types import BoolArray, FloatArray

from .mocap import MIN_ADVANCE
from .schema import SENSOR_TIME

YAW_RATE_COLUMN = "W (IMU)"
SPEED_COLUMN = "vel encoder"


class ValueLimit(NamedTuple):
    """Largest magnitude of a column, its unit, and the units that exceed it."""

    column: str
    most: float
    unit: str
    mistaken: str


LIMITS = (
    ValueLimit(YAW_RATE_COLUMN, 35.0, "rad/s", "deg/s"),  # 2000 deg/s ends the gyro's range
    ValueLimit("acc x (IMU)", 200.0, "m/s2", "mm/s2 or mg"),
    ValueLimit("acc y (IMU)", 200.0, "m/s2", "mm/s2 or mg"),
    ValueLimit(SENSOR_TIME, 1e10, "s", "ms, us or ns"),
    ValueLimit("vicon time", 1e10, "s", "ms, us or ns"),
)
SPEED_LIMIT = ValueLimit(SPEED_COLUMN, 15.0, "m/s", "mm/s or cm/s")
PLACE_LIMITS = tuple(ValueLimit(column, 1000.0, "m", "mm") for column in ("vicon x", "vicon y"))
# No car with these commands is faster [m/s].
MAX_CAR_SPEED = 150.0
# Acceleration [m/s2] averaged over SMOOTHING_TIME. Grip gives 10, wings 50; a speed in cm/s or a
# position in mm gives 100 and more if a car changes its speed by 1 m/s in a second.
MAX_SMOOTHED_ACCELERATION = 50.0
SMOOTHING_TIME = 0.2  # s
MAX_SPEED_RATIO = 2.0  # times the speed of the mocap that an encoder may show
# Of a position beyond its limit: by how much it may differ from its neighbours.
MAX_CONTINUOUS_CHANGE = 0.02
# From a mistaken unit to the SI unit.
FACTORS = {
    "mm": "1000", "mm/s or cm/s": "1000 or 100", "deg/s": "57.2958", "degrees": "57.2958",
    "mm/s2 or mg": "1000 or 102", "ms, us or ns": "1e3, 1e6 or 1e9",
    "minutes or hours": "1/60 or 1/3600"}
# s: limits of the median step of the sensor messages, which come at 10 Hz.
MIN_MESSAGE_STEP = 1e-3
MAX_MESSAGE_STEP = 1.0
MIN_MOCAP_STEP = MIN_ADVANCE  # s
MAX_PAUSE = 86_400.0  # s, a day
YAW_JUMP = 50.0  # rad from one mocap row to the next
# A speed [m/s] in this share of the rows is no tracking error.
MOCAP_SPEED = 30.0
MOCAP_SHARE = 0.2
# Wheelbase of a 1:43 car [m]; larger cars have a larger turning circle.
SMALLEST_WHEELBASE = 0.06
# Curvature times wheelbase = tan(steering angle): twice that of 0.6 rad is impossible.
MAX_STEERING_TANGENT = 2.0 * 0.684
# m/s above which the car moves, rows of that, and the share of them that turns.
MIN_TURNING_SPEED = 0.3
MOVING_ROWS = 10
TURN_SHARE = 0.2


def check_values(columns: dict[str, FloatArray], file: str) -> None:
    """Raise RecordingError for a cell with an impossible value. Columns (rows,), finite."""
    for limit in (*LIMITS, _speed_limit(columns), *PLACE_LIMITS):
        if limit.column not in columns:
            continue
        size = np.abs(columns[limit.column])
        odd = size > limit.most
        if limit in PLACE_LIMITS:
            odd &= _is_isolated(columns[limit.column])
        if odd.any():
            worst = columns[limit.column][int(np.argmax(np.where(odd, size, 0.0)))]
            raise _refusal(file, limit.column, f"{worst:.6g} {limit.unit}",
                           f"at most {limit.most:g} {limit.unit} either way",
                           limit.mistaken, f", in {int(odd.sum())} of {len(odd)} row(s)")
    if "vicon yaw" in columns and len(columns["vicon yaw"]) > 1:
        jump = float(np.max(np.abs(np.diff(columns["vicon yaw"]))))
        if jump > YAW_JUMP:
            raise _refusal(file, "vicon yaw", f"a jump of {jump:.6g} rad from row to row",
                           "radians", "degrees")


def check_units(columns: dict[str, FloatArray], file: str) -> None:
    """Raise RecordingError for a wrong unit that only the whole of a file shows.

    columns (rows,): without the rows before the first sensor message.
    """
    if SENSOR_TIME in columns:
        _check_steps(columns[SENSOR_TIME], SENSOR_TIME, MIN_MESSAGE_STEP, file)
        _check_yaw_rate(columns, file)
    if "vicon time" in columns:
        _check_steps(columns["vicon time"], "vicon time", MIN_MOCAP_STEP, file)
        _check_mocap_speed(columns, file)


def _check_steps(t: FloatArray, column: str, shortest: float, file: str) -> None:
    step = np.diff(t)
    step = step[step > 0.0]  # held copies, steps back
    if not len(step):
        return
    usual = float(np.median(step))
    longest = float(np.max(step))
    if not shortest <= usual <= MAX_MESSAGE_STEP:
        raise _refusal(file, column, f"a median step of {usual:.6g} s from message to message",
                       f"{shortest:g} to {MAX_MESSAGE_STEP:g} s",
                       "ms, us or ns" if usual > MAX_MESSAGE_STEP else "minutes or hours")
    if longest > MAX_PAUSE:
        raise _refusal(file, column, f"a step of {longest:.6g} s",
                       f"at most {MAX_PAUSE:g} s (a day)", "ms, us or ns")


def _check_yaw_rate(columns: dict[str, FloatArray], file: str) -> None:
    """Raise RecordingError if turns are tighter than any steering: the yaw rate is in deg/s."""
    speed = np.abs(columns[SPEED_COLUMN])
    moves = speed > MIN_TURNING_SPEED
    if int(moves.sum()) < MOVING_ROWS:
        return
    slope = SMALLEST_WHEELBASE * np.abs(columns[YAW_RATE_COLUMN][moves]) / speed[moves]
    share = float((slope > MAX_STEERING_TANGENT).mean())
    if share > TURN_SHARE:
        raise _refusal(
            file, YAW_RATE_COLUMN, f"{float(np.max(np.abs(columns[YAW_RATE_COLUMN]))):.6g} "
            f"at most; in {share:.0%} of the driven rows a tighter turn than "
            f"{SMALLEST_WHEELBASE / MAX_STEERING_TANGENT:.3f} m",
            f"rad/s that a wheelbase of {SMALLEST_WHEELBASE} m can turn at the speed of "
            f"{SPEED_COLUMN!r}",
            "deg/s")


def _check_mocap_speed(columns: dict[str, FloatArray], file: str) -> None:
    """Raise RecordingError if speed or acceleration are impossible: the position is in mm."""
    speed, acceleration = _motion(columns)
    if not len(speed) or float((speed > MOCAP_SPEED).mean()) <= MOCAP_SHARE:
        return
    usual = float(np.median(speed))
    if usual > MAX_CAR_SPEED:
        raise _refusal(file, "vicon x", f"a median speed of {usual:.6g} m/s",
                       f"at most {MAX_CAR_SPEED:g} m/s", "mm")
    change = float(np.quantile(acceleration, 0.75)) if len(acceleration) else 0.0
    if change > MAX_SMOOTHED_ACCELERATION:
        raise _refusal(file, "vicon x", f"a median speed of {usual:.6g} m/s, and an acceleration "
                       f"of {change:.6g} m/s2 and more in a quarter of the time",
                       f"at most {MAX_SMOOTHED_ACCELERATION:g} m/s2 at such a speed", "mm")


def _motion(columns: dict[str, FloatArray]) -> tuple[FloatArray, FloatArray]:
    """Return the speed from row to row [m/s] and the smoothed acceleration [m/s2] of the mocap."""
    t, x, y = (columns[c] for c in ("vicon time", "vicon x", "vicon y"))
    advance = np.concatenate([[True], np.diff(t) > MIN_ADVANCE])
    t = t[advance]
    x = x[advance]
    y = y[advance]
    if len(t) < 2:
        return np.empty(0), np.empty(0)
    speed = np.hypot(np.diff(x), np.diff(y)) / np.diff(t)
    span = max(round(SMOOTHING_TIME / float(np.median(np.diff(t)))), 1)
    t = t[::span]
    x = x[::span]
    y = y[::span]
    if len(t) < 3:
        return speed, np.empty(0)
    step = np.diff(t)
    u = np.diff(x) / step
    v = np.diff(y) / step
    # Two intervals around one impossible time add up to 0: that acceleration is infinite.
    with np.errstate(divide="ignore", invalid="ignore"):
        return speed, np.hypot(np.diff(u), np.diff(v)) / (0.5 * (step[1:] + step[:-1]))


def _speed_limit(columns: dict[str, FloatArray]) -> ValueLimit:
    """Return the largest speed of the encoder: of small cars, or that the file supports."""
    if SPEED_COLUMN not in columns or not len(columns[SPEED_COLUMN]):
        return SPEED_LIMIT
    if "vicon time" in columns:
        speed, _ = _motion(columns)
        usual = float(np.quantile(speed, 0.9)) if len(speed) else 0.0
        supported = MAX_SPEED_RATIO * min(usual, MAX_CAR_SPEED)
    else:
        t = columns[SENSOR_TIME]
        value = columns[SPEED_COLUMN]
        fresh = np.concatenate([[True], np.diff(t) > MIN_ADVANCE])
        change = np.abs(np.diff(value[fresh])) / np.diff(t[fresh])
        smooth = len(change) > 0 and float(np.max(change)) <= MAX_SMOOTHED_ACCELERATION
        supported = MAX_CAR_SPEED if smooth else 0.0
    return SPEED_LIMIT._replace(most=max(SPEED_LIMIT.most, supported))


def _is_isolated(place: FloatArray) -> BoolArray:
    """Mark the rows (n,) that are far from both neighbours: damaged numbers, no positions."""
    jumps = np.abs(np.diff(place)) > MAX_CONTINUOUS_CHANGE * np.abs(place[:-1])
    ends = np.concatenate([[True], jumps, [True]])
    return np.asarray(ends[:-1] & ends[1:])


def _refusal(file: str, column: str, found: str, expected: str, mistaken: str,
             where: str = "") -> RecordingError:
    return RecordingError(
        f"{file}: column {column!r} holds what no car can have: {found} ({mistaken}?)",
        found=found + where, expected=expected, read=file,
        likely=f"{mistaken} instead of the SI unit, or a damaged number",
        remedy=f"divide the column by {FACTORS[mistaken]} if it is in {mistaken}, or repair or "
               "delete the damaged rows")
