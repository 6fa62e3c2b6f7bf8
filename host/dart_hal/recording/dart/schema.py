"""The three column sets of the DART recordings, by exact name.

- A: one row per 10 Hz sensor message.
- B: A and motion capture, one row per 100 Hz pose, with the last values of the A columns.
- C: resampled pose with commands, no encoder, no IMU.

The order is free and other columns are ignored. A file without a used column is refused.
"""

from __future__ import annotations

from collections.abc import Sequence

from dart_hal.core.errors import RecordingError

SENSOR_TIME = "elapsed time sensors"
SENSOR_COLUMNS = (SENSOR_TIME, "acc x (IMU)", "acc y (IMU)", "W (IMU)", "vel encoder",
                  "safety_value", "throttle", "steering")
NEVER_MEASURED = ("current", "voltage")
MOCAP_COLUMNS = ("vicon time", "vicon x", "vicon y", "vicon yaw")
COMMAND_COLUMNS = ("throttle", "steering", "safety_value")
USED = {"A": SENSOR_COLUMNS, "B": SENSOR_COLUMNS + MOCAP_COLUMNS,
        "C": MOCAP_COLUMNS + COMMAND_COLUMNS}
DERIVED_C = ("unwrapped yaw", "vx_abs_filtered", "vy_abs_filtered", "w", "ax_abs_filtered_more",
             "ay_abs_filtered_more", "acc_w", "vx body", "vy body", "ax body no centrifugal",
             "ay body no centrifugal", "ax body", "ay body")


def split_header(line: str) -> list[str]:
    """Return the column names of a header line, without byte-order mark, quotes and blanks."""
    return [cell.strip().strip('"').strip() for cell in line.lstrip("\ufeff").split(",")]


def detect(columns: Sequence[str], file: str) -> str:
    """Return the schema of the columns: "A", "B" or "C".

    Errors: RecordingError if a used column is missing or a column occurs twice.
    """
    names = set(columns)
    twice = sorted({c for c in columns if c and columns.count(c) > 1})
    if twice:
        raise RecordingError(f"{file}: a column name occurs twice", found=", ".join(twice),
                             expected="every column once", read=file,
                             remedy="delete or rename one of the two in the header line")
    sensors = names & (set(SENSOR_COLUMNS) - set(COMMAND_COLUMNS))
    mocap = names & set(MOCAP_COLUMNS)
    if sensors and mocap:
        schema = "B"
    elif mocap:
        schema = "C"
    else:
        schema = "A"
    missing = [c for c in USED[schema] if c not in names]
    if missing:
        raise RecordingError(
            f"{file}: not a DART recording: {len(missing)} needed column(s) missing",
            found=f"missing {_quote(missing)} among {_quote(columns[:24])}",
            expected=f"schema {schema}: {_quote(USED[schema])}", read=file,
            likely="another kind of table, or a header that was edited",
            remedy="name the columns as in docs/reference/recordings.md; "
                   "their order does not matter; a log of another program: dart-hal data import "
                   f"{file} --guess")
    return schema


def _quote(names: Sequence[str]) -> str:
    return ", ".join(repr(n if len(n) <= 40 else n[:40] + "...") for n in names)
