"""Extract the 10 Hz sensor messages from the rows: each once, gated, in segments."""

from __future__ import annotations

import numpy as np

from dart_hal.core.errors import RecordingError
from dart_hal.core.types import BoolArray, FloatArray, IntArray

from .model import Messages, Note, freeze, freeze_flags, freeze_index
from .schema import SENSOR_COLUMNS, SENSOR_TIME

# Longest time for which a value is used [s].
MAX_MESSAGE_GAP = 0.3
# Step above which a 10 Hz message is lost [s].
MIN_LOST_STEP = 0.14
# Gap that is inserted at a step back of the clock [s].
CLOCK_BREAK = 1.0
COMMAND_LIMIT = 1.0 + 1e-6


def not_started(columns: dict[str, FloatArray], schema: str) -> BoolArray:
    """Mark the rows that were written before the first sensor message."""
    if schema == "B":
        return np.asarray(columns[SENSOR_TIME] == 0.0)
    return np.asarray(np.all([columns[c] == 0.0 for c in SENSOR_COLUMNS], axis=0))


def check_commands(columns: dict[str, FloatArray], file: str) -> None:
    """Raise RecordingError if a command is outside -1..1, or the gate is neither 0 nor 1."""
    for name in ("throttle", "steering"):
        worst = float(np.max(np.abs(columns[name])))
        if worst > COMMAND_LIMIT:
            raise RecordingError(f"{file}: column {name!r} leaves -1..1",
                                 found=f"largest magnitude {worst:.6g}", expected="-1 to 1",
                                 likely="per cent or pulse widths instead of commands",
                                 remedy="convert the column to -1..1", read=file)
    odd = ~np.isin(columns["safety_value"], (0.0, 1.0))
    if odd.any():
        raise RecordingError(f"{file}: column 'safety_value' is neither 0 nor 1", read=file,
                             found=f"{columns['safety_value'][odd][0]:.6g} and "
                                   f"{int(odd.sum())} row(s) in all", expected="0 or 1",
                             remedy="repair the column")


def monotone(t: FloatArray) -> tuple[FloatArray, IntArray, int]:
    """Return (increasing time, segment, steps back) of row times that may step back.

    Rows after a step back are moved to 1 s after the row before it and get a new segment: sorting
    would mix two runs.
    """
    step = np.diff(t)
    back = step < 0.0
    moved = np.where(back, CLOCK_BREAK, step)
    out = t[:1] + np.concatenate([[0.0], np.cumsum(moved)]) if back.any() else t
    segment = np.concatenate([[0], np.cumsum(back | (step > MAX_MESSAGE_GAP))])
    return np.asarray(out), np.asarray(segment, dtype=np.int64), int(back.sum())


def messages(columns: dict[str, FloatArray], arrival: FloatArray | None
             ) -> tuple[Messages, list[Note]]:
    """Extract the messages of schema A or B; no row precedes the first message.

    arrival (rows,) s: mocap stamp of each row, None for schema A.
    """
    stamp = columns[SENSOR_TIME]
    fresh = np.concatenate([[True], np.diff(stamp) != 0.0])
    used = {c: columns[c][fresh] for c in SENSOR_COLUMNS}
    t, segment, back = monotone(used[SENSOR_TIME])
    notes = []
    if not fresh.all():
        why = ("held copies of the last sensor message" if arrival is not None
               else "rows that repeat the stamp of the row before")
        notes.append(Note(why, int((~fresh).sum()),
                          "held_copies" if arrival is not None else "repeated_stamp"))
        notes += _note_differing_copies(columns, fresh)
    if back:
        notes.append(Note(f"sensor time steps back {back} time(s): cut there, not sorted",
                          kind="time_back"))
    step = np.diff(t)
    lost = int(((step > MIN_LOST_STEP) & (step <= MAX_MESSAGE_GAP)).sum())
    gaps = int((step > MAX_MESSAGE_GAP).sum())
    if lost:
        notes.append(Note(f"{lost} step(s) of 0.14 to 0.3 s between sensor messages "
                          "(messages lost)", kind="lost_messages"))
    if gaps:
        notes.append(Note(f"{gaps} gap(s) above 0.3 s between sensor messages: cut there",
                          kind="message_gap"))
    gate = used["safety_value"] == 1.0
    notes += gate_note(used["throttle"], gate)
    return Messages(
        t=freeze(t), arrival=freeze(t if arrival is None else arrival[fresh]),
        segment=freeze_index(segment), throttle=freeze(np.where(gate, used["throttle"], 0.0)),
        throttle_raw=freeze(used["throttle"]), steering=freeze(used["steering"]),
        gate=freeze_flags(gate), speed=freeze(used["vel encoder"]),
        yaw_rate=freeze(used["W (IMU)"]), accel_x=freeze(used["acc x (IMU)"]),
        accel_y=freeze(used["acc y (IMU)"])), notes


def _note_differing_copies(columns: dict[str, FloatArray], fresh: BoolArray) -> list[Note]:
    """Return a note if rows have other values than the first row of their stamp."""
    first = np.flatnonzero(fresh)[np.cumsum(fresh) - 1]
    changed = {name: int((columns[name] != columns[name][first]).sum())
               for name in SENSOR_COLUMNS if name != SENSOR_TIME}
    names = [name for name, rows in changed.items() if rows]
    if not names:
        return []
    return [Note(f"{', '.join(names)}: values differ in rows of one sensor stamp, and only the "
                 "first of them is used (dart-hal data import keeps commands at their own times)",
                 max(changed.values()), "differing_copies")]


def commands_only(columns: dict[str, FloatArray], t: FloatArray) -> tuple[Messages, list[Note]]:
    """Return the messages of schema C: commands at the rows, sensors NaN; t (rows,) s."""
    gate = columns["safety_value"] == 1.0
    nan = freeze(np.full(len(t), np.nan))
    segment = np.concatenate([[0], np.cumsum(np.diff(t) > MAX_MESSAGE_GAP)])
    return Messages(
        t=freeze(t), arrival=freeze(t), segment=freeze_index(segment),
        throttle=freeze(np.where(gate, columns["throttle"], 0.0)),
        throttle_raw=freeze(columns["throttle"]), steering=freeze(columns["steering"]),
        gate=freeze_flags(gate), speed=nan, yaw_rate=nan, accel_x=nan, accel_y=nan,
    ), gate_note(columns["throttle"], gate)


def gate_note(throttle: FloatArray, gate: BoolArray) -> list[Note]:
    """Return a note with the number of throttle values logged while the gate was closed."""
    rows = int(((throttle != 0.0) & ~gate).sum())
    note = Note("throttle set to 0 where the safety gate was closed", rows, "gate")
    return [note] if rows else []
