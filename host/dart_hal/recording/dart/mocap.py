"""Motion capture rows: advancing time, outliers of 1 to 3 rows, unwrapped yaw."""

from __future__ import annotations

import numpy as np

from dart_hal.types import SAMPLE, BoolArray, FloatArray

from .model import Mocap, Note, freeze, freeze_flags
from .schema import MOCAP
from .sensors import BREAK

MIN_ADVANCE = 1e-4  # s
POSITION_STEP = 0.06  # m per 10 ms
YAW_STEP = 0.2  # rad per 10 ms
MAX_GAP = 0.05  # s
GAP_STEPS = 2.0  # usual steps between two rows; a 20 Hz recording has a row each 0.05 s
OUTLIER_ROWS = 3
EPOCH_FROM = 1e9  # s; smaller stamps count from the start of the recording


def advancing(t: FloatArray) -> tuple[BoolArray, FloatArray, int]:
    """(rows to keep, their time from 0, steps back).

    A row out of order by less than 0.1 s is dropped; behind a larger step
    back time goes on 1 s later, so that a gap marks the place.
    """
    keep = np.zeros(len(t), dtype=bool)
    moved = np.zeros(len(t))
    last, shift, back = -np.inf, -float(t[0]), 0
    for i, stamp in enumerate(t.tolist()):
        now = stamp + shift
        if now < last - 0.1:
            shift += last + BREAK - now
            now = stamp + shift
            back += 1
        if now > last + MIN_ADVANCE:
            keep[i], moved[i], last = True, now, now
    return keep, moved[keep], back


def wrap(angle: FloatArray) -> FloatArray:
    """Into [-pi, pi)."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def outliers(t: FloatArray, x: FloatArray, y: FloatArray, yaw: FloatArray) -> BoolArray:
    """Rows (n,) of jumps that come back within 3 rows; judged by distance over time.

    A jump that stays (false lock of the tracker) is no outlier: it is found
    against the encoder, on the grid.
    """
    bad = np.zeros(len(t), dtype=bool)

    def jump(i: int, k: int) -> bool:
        scale = max((t[k] - t[i]) / SAMPLE, 1.0)
        return bool(np.hypot(x[k] - x[i], y[k] - y[i]) > POSITION_STEP * scale
                    or abs(wrap(yaw[k] - yaw[i])) > YAW_STEP * scale)

    scale = np.maximum(np.diff(t) / SAMPLE, 1.0)
    step = ((np.hypot(np.diff(x), np.diff(y)) > POSITION_STEP * scale)
            | (np.abs(wrap(np.diff(yaw))) > YAW_STEP * scale))
    for i in np.flatnonzero(step).tolist():
        if bad[i]:
            continue
        for k in range(i + 2, min(i + 2 + OUTLIER_ROWS, len(t))):
            if not jump(i, k):
                bad[i + 1:k] = True
                break
    return bad


def longest_step(t: FloatArray) -> float:
    """Time [s] between two rows beyond which nothing between them is used; t (n,) s."""
    usual = float(np.median(np.diff(t))) if len(t) > 1 else SAMPLE
    return max(MAX_GAP, GAP_STEPS * usual)


def unwrap(yaw: FloatArray, outlier: BoolArray) -> FloatArray:
    """Unwrapped over the good rows; an outlier stays on the turn of the row before it."""
    good = np.flatnonzero(~outlier)
    out = np.array(yaw)
    if len(good) == 0:
        return np.asarray(np.unwrap(yaw))
    out[good] = np.unwrap(yaw[good])
    before = good[np.maximum(np.searchsorted(good, np.arange(len(yaw)), side="right") - 1, 0)]
    return np.asarray(np.where(outlier, out[before] + wrap(yaw - out[before]), out))


def mocap(columns: dict[str, FloatArray]) -> tuple[Mocap, BoolArray, list[Note]]:
    """(mocap, rows of the table that it kept, notes)."""
    stamp, x, y, yaw = (columns[c] for c in MOCAP)
    keep, t, back = advancing(stamp)
    x, y, yaw = x[keep], y[keep], yaw[keep]
    outlier = outliers(t, x, y, yaw)
    notes = []
    if back:
        notes.append(Note(f"mocap time steps back {back} time(s): cut there, not sorted",
                          kind="mocap_time_back"))
    if not keep.all():
        notes.append(Note("mocap rows whose time does not advance", int((~keep).sum()),
                          "mocap_repeated"))
    if outlier.any():
        notes.append(Note("mocap outliers of 1 to 3 rows, marked", int(outlier.sum()), "outliers"))
    limit = longest_step(t)
    gaps = int((np.diff(t) > limit).sum())
    if gaps:
        notes.append(Note(f"{gaps} mocap gap(s) above {limit:.2f} s: nothing inside is used",
                          kind="mocap_gap"))
    epoch = float(stamp[0]) if stamp[0] > EPOCH_FROM else None
    return Mocap(freeze(t), epoch, freeze(x), freeze(y), freeze(unwrap(yaw, outlier)),
                 freeze_flags(outlier)), keep, notes
