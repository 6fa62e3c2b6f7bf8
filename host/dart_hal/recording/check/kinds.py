"""Actions of the reader by kind of finding, as one line about many files."""

from __future__ import annotations

# For every kind that drops rows or changes values.
DONE = {
    "bad_samples": "parts of the motion are marked bad, 0.2 s to both sides included",
    "cut_off_line": "the cut-off last line is dropped",
    "derived": "derived columns are not used: the pose is differentiated",
    "differing_copies": "of rows with one sensor stamp, the first is used",
    "encoder_dead": "the encoder is dead: no speed instead of zeros",
    "false_lock": "the mocap stood while the wheels turned: marked bad",
    "gate": "throttle logged behind a closed safety gate is 0",
    "held_copies": "rows that repeat the last sensor message are dropped",
    "message_gap": "cut at steps above 0.3 s between sensor messages",
    "marker": "the marker frame is fitted to the driving",
    "mocap_gap": "nothing inside gaps of the mocap is used",
    "mocap_repeated": "mocap rows whose time does not advance are dropped",
    "mocap_time_back": "cut where the mocap time steps back",
    "negative_zero": "-0.0 is read as 0",
    "not_finite": "rows with empty cells or no numbers are dropped",
    "not_measured": "current and voltage are zero in every row: not used",
    "not_started": "rows before the first sensor message are dropped",
    "outliers": "outliers of the mocap, 1 to 3 rows, are marked",
    "repeated_stamp": "rows that repeat the stamp of the row before are dropped",
    "sensor_stuck": "a sensor repeats one value: used as missing",
    "time_back": "cut where the sensor time steps back",
    "yaw_wraps": "yaw passes +-pi: unwrapped",
}
