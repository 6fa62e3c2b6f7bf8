"""Values that no small car can have: a file that holds one is refused.

They come from units (mm/s, deg/s, ms) or from damage. One is enough: a file
with a corrupt number is not to be trusted with the others. The limits stand at
least three times above the largest of the published recordings.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dart_hal.errors import RecordingError
from dart_hal.types import FloatArray
from dart_hal.vehicle.sets import PAPER

from .mocap import MIN_ADVANCE
from .schema import SENSOR_TIME

YAW_RATE = "W (IMU)"
SPEED = "vel encoder"


class Limit(NamedTuple):
    """Largest magnitude of a column, its unit, and the units that exceed it."""

    column: str
    most: float
    unit: str
    mistaken: str


LIMITS = (
    Limit(SPEED, 15.0, "m/s", "mm/s or cm/s"),
    Limit(YAW_RATE, 35.0, "rad/s", "deg/s"),  # 2000 deg/s ends the gyro's range
    Limit("acc x (IMU)", 200.0, "m/s2", "mm/s2 or mg"),
    Limit("acc y (IMU)", 200.0, "m/s2", "mm/s2 or mg"),
    Limit(SENSOR_TIME, 1e10, "s", "ms, us or ns"),
    Limit("vicon time", 1e10, "s", "ms, us or ns"),
    Limit("vicon x", 1000.0, "m", "mm"),
    Limit("vicon y", 1000.0, "m", "mm"),
)
FACTORS = {
    "mm": "1000", "mm/s or cm/s": "1000 or 100", "deg/s": "57.2958", "degrees": "57.2958",
    "mm/s2 or mg": "1000 or 102", "ms, us or ns": "1e3, 1e6 or 1e9",
    "minutes or hours": "1/60 or 1/3600"}
"""From a mistaken unit to the SI unit."""
SHORTEST, LONGEST = 1e-3, 1.0  # s, median step of the sensor messages; they come at 10 Hz
SHORTEST_MOCAP = MIN_ADVANCE  # s
LONGEST_PAUSE = 86_400.0  # s; no recorder waits for a day
YAW_JUMP = 50.0  # rad from one mocap row to the next
MOCAP_SPEED, MOCAP_SHARE = 30.0, 0.2  # m/s in a fifth of the rows: no tracking error, a unit
WHEELBASE = PAPER.body.wheelbase
TIGHTEST = 2.0 * 0.684  # twice tan(0.6 rad): no steering angle turns the car that tightly
MOVING, MOVING_ROWS, TURN_SHARE = 0.3, 10, 0.2  # m/s; rows; share of them


def check_values(columns: dict[str, FloatArray], file: str) -> None:
    """Errors: RecordingError when a cell holds what no car can have. Columns (rows,), finite."""
    for limit in LIMITS:
        if limit.column not in columns:
            continue
        size = np.abs(columns[limit.column])
        odd = size > limit.most
        if odd.any():
            worst = columns[limit.column][int(np.argmax(size))]
            raise _refused(file, limit.column, f"{worst:.6g} {limit.unit}",
                           f"at most {limit.most:g} {limit.unit} either way",
                           limit.mistaken, f", in {int(odd.sum())} of {len(odd)} row(s)")
    if "vicon yaw" in columns and len(columns["vicon yaw"]) > 1:
        jump = float(np.max(np.abs(np.diff(columns["vicon yaw"]))))
        if jump > YAW_JUMP:
            raise _refused(file, "vicon yaw", f"a jump of {jump:.6g} rad from row to row",
                           "radians", "degrees")


def check_units(columns: dict[str, FloatArray], file: str) -> None:
    """Errors: RecordingError for a unit that shows only in the whole of a file.

    columns (rows,): without the rows before the first sensor message.
    """
    if SENSOR_TIME in columns:
        _check_steps(columns[SENSOR_TIME], SENSOR_TIME, SHORTEST, file)
        _check_yaw_rate(columns, file)
    if "vicon time" in columns:
        _check_steps(columns["vicon time"], "vicon time", SHORTEST_MOCAP, file)
        _check_mocap_speed(columns, file)


def _check_steps(t: FloatArray, column: str, shortest: float, file: str) -> None:
    step = np.diff(t)
    step = step[step > 0.0]  # held copies, steps back
    if not len(step):
        return
    usual, longest = float(np.median(step)), float(np.max(step))
    if not shortest <= usual <= LONGEST:
        raise _refused(file, column, f"a median step of {usual:.6g} s from message to message",
                       f"{shortest:g} to {LONGEST:g} s", "ms, us or ns" if usual > LONGEST
                       else "minutes or hours")
    if longest > LONGEST_PAUSE:
        raise _refused(file, column, f"a step of {longest:.6g} s",
                       f"at most {LONGEST_PAUSE:g} s (a day)", "ms, us or ns")


def _check_yaw_rate(columns: dict[str, FloatArray], file: str) -> None:
    """A yaw rate in deg/s is tighter than any steering, wherever the car turns."""
    speed = np.abs(columns[SPEED])
    moves = speed > MOVING
    if int(moves.sum()) < MOVING_ROWS:
        return
    slope = WHEELBASE * np.abs(columns[YAW_RATE][moves]) / speed[moves]
    share = float((slope > TIGHTEST).mean())
    if share > TURN_SHARE:
        raise _refused(
            file, YAW_RATE, f"{float(np.max(np.abs(columns[YAW_RATE]))):.6g} at most; in "
            f"{share:.0%} of the driven rows a tighter turn than {WHEELBASE / TIGHTEST:.2f} m",
            f"rad/s that a wheelbase of {WHEELBASE} m can turn at the speed of {SPEED!r}",
            "deg/s")


def _check_mocap_speed(columns: dict[str, FloatArray], file: str) -> None:
    step = np.diff(columns["vicon time"])
    good = step > MIN_ADVANCE
    if not good.any():
        return
    way = np.hypot(np.diff(columns["vicon x"]), np.diff(columns["vicon y"]))[good]
    speed = way / step[good]
    if float((speed > MOCAP_SPEED).mean()) > MOCAP_SHARE:
        raise _refused(file, "vicon x", f"a median speed of "
                       f"{float(np.median(speed)):.6g} m/s", f"at most {MOCAP_SPEED:g} m/s",
                       "mm")


def _refused(file: str, column: str, found: str, expected: str, mistaken: str,
             where: str = "") -> RecordingError:
    return RecordingError(
        f"{file}: column {column!r} holds what no car can have: {found} ({mistaken}?)",
        found=found + where, expected=expected, read=file,
        likely=f"{mistaken} instead of the SI unit, or a damaged number",
        remedy=f"divide the column by {FACTORS[mistaken]} if it is in {mistaken}, or repair or "
               "delete the damaged rows")
