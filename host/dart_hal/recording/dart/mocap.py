"""Rows of a motion capture: increasing time, outliers of 1 to 3 rows, unwrapped yaw."""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dart_hal.core.timing import SAMPLE
from dart_hal.core.types import BoolArray, FloatArray

from .model import Mocap, Note, freeze, freeze_flags
from .schema import MOCAP_COLUMNS
from .sensors import CLOCK_BREAK

MIN_ADVANCE = 1e-4  # s
POSITION_STEP = 0.06  # m per 10 ms; a shorter step is no jump
# Deviation of a longer step from the usual step of its neighbours [m per 10 ms] above which it is a
# jump. A car at 30 m/s makes steps of 0.3 m, all of the same length. The other half of
# POSITION_STEP is the 3 m/s that a car often drives, so that an outlier at that speed is found.
MAX_DEVIATION = 0.03
# The limit is also a multiple of the median deviation of a file, up to a share of the usual step: a
# tracker of large cars has centimetres of noise. 6 median deviations are 4 standard deviations of
# normal noise.
MAX_NOISE_RATIO = 6.0
MAX_NOISE_SHARE = 0.5
NEIGHBOURS = 10  # steps to each side
YAW_STEP = 0.2  # rad per 10 ms
MAX_GAP = 0.05  # s
GAP_STEPS = 2.0  # usual steps between two rows; a 20 Hz recording has a row each 0.05 s
OUTLIER_ROWS = 3
EPOCH_FROM = 1e9  # s; smaller stamps count from the start of the recording


def advancing(t: FloatArray) -> tuple[BoolArray, FloatArray, int]:
    """Return (rows to keep, their time from 0, steps back).

    A row out of order by less than 0.1 s is dropped. After a larger step back, time continues 1 s
    later, so that a gap separates both parts.
    """
    keep = np.zeros(len(t), dtype=bool)
    moved = np.zeros(len(t))
    last = -np.inf
    shift = -float(t[0])
    back = 0
    for i, stamp in enumerate(t.tolist()):
        now = stamp + shift
        if now < last - 0.1:
            shift += last + CLOCK_BREAK - now
            now = stamp + shift
            back += 1
        if now > last + MIN_ADVANCE:
            keep[i] = True
            moved[i] = now
            last = now
    return keep, moved[keep], back


def wrap(angle: FloatArray) -> FloatArray:
    """Wrap an angle into [-pi, pi)."""
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)


def outliers(t: FloatArray, x: FloatArray, y: FloatArray, yaw: FloatArray) -> BoolArray:
    """Mark the rows (n,) of jumps that return within 3 rows.

    For each step that is a jump, find the next row that is no jump from the row before the step.
    A jump that does not return (false lock of the tracker) is no outlier: it is found on the grid,
    by the encoder.
    """
    bad = np.zeros(len(t), dtype=bool)
    duration = np.diff(t)
    dx = np.diff(x)
    dy = np.diff(y)
    u, v = usual_velocity(duration, dx, dy)
    allowed = deviation_limit(duration, u, v, np.hypot(dx - u * duration, dy - v * duration))

    def jump(i: int, k: int) -> bool:
        time = t[k] - t[i]
        scale = max(time / SAMPLE, 1.0)
        dx_ik = x[k] - x[i]
        dy_ik = y[k] - y[i]
        deviation = np.hypot(dx_ik - u[i] * time, dy_ik - v[i] * time)
        return bool((np.hypot(dx_ik, dy_ik) > POSITION_STEP * scale
                     and deviation > max(allowed[i], MAX_DEVIATION * scale))
                    or abs(wrap(yaw[k] - yaw[i])) > YAW_STEP * scale)

    scale = np.maximum(duration / SAMPLE, 1.0)
    step = (position_jumps(duration, dx, dy)
            | (np.abs(wrap(np.diff(yaw))) > YAW_STEP * scale))
    for i in np.flatnonzero(step).tolist():
        if bad[i]:
            continue
        for k in range(i + 2, min(i + 2 + OUTLIER_ROWS, len(t))):
            if not jump(i, k):
                bad[i + 1:k] = True
                break
    return bad


def position_jumps(duration: FloatArray, dx: FloatArray, dy: FloatArray,
                   limit: float = POSITION_STEP) -> BoolArray:
    """Mark the steps (n,) [m] of ``duration`` (n,) [s] that are no motion; limit: m per 10 ms.

    A jump is longer than the steps of a slow car, and differs from the usual velocity of the steps
    around it, which is the speed of the car.
    """
    scale = np.maximum(duration / SAMPLE, 1.0)
    long = np.hypot(dx, dy) > limit * scale
    if not long.any():
        return np.asarray(long)
    u, v = usual_velocity(duration, dx, dy)
    deviation = np.hypot(dx - u * duration, dy - v * duration)
    return np.asarray(long & (deviation > deviation_limit(duration, u, v, deviation)))


def deviation_limit(duration: FloatArray, u: FloatArray, v: FloatArray, deviation: FloatArray
                    ) -> FloatArray:
    """Return how far [m], (n,), a step may deviate from the usual velocity (u, v) [m/s]."""
    # Noise: a multiple of the median deviation, at most a share of the usual step.
    noise = np.minimum(MAX_NOISE_RATIO * float(np.median(deviation)),
                       MAX_NOISE_SHARE * np.hypot(u, v) * duration)
    return np.asarray(np.maximum(MAX_DEVIATION * np.maximum(duration / SAMPLE, 1.0), noise))


def usual_velocity(duration: FloatArray, dx: FloatArray, dy: FloatArray
                   ) -> tuple[FloatArray, FloatArray]:
    """Return the median velocity (u, v) [m/s], (n,) each, of 10 steps before to 10 after."""
    span = min(2 * NEIGHBOURS + 1, len(dx))
    def median(step: FloatArray) -> FloatArray:
        rate = np.pad(step / duration, (span // 2, (span - 1) // 2), mode="edge")
        return np.asarray(np.median(sliding_window_view(rate, span), axis=1))

    return median(dx), median(dy)


def longest_step(t: FloatArray) -> float:
    """Return the longest time [s] between two rows that is no gap; t (n,) s."""
    usual = float(np.median(np.diff(t))) if len(t) > 1 else SAMPLE
    return max(MAX_GAP, GAP_STEPS * usual)


def unwrap(yaw: FloatArray, outlier: BoolArray) -> FloatArray:
    """Unwrap the good rows; an outlier keeps the turn of the row before it."""
    good = np.flatnonzero(~outlier)
    out = np.array(yaw)
    if len(good) == 0:
        return np.asarray(np.unwrap(yaw))
    out[good] = np.unwrap(yaw[good])
    before = good[np.maximum(np.searchsorted(good, np.arange(len(yaw)), side="right") - 1, 0)]
    return np.asarray(np.where(outlier, out[before] + wrap(yaw - out[before]), out))


def mocap(columns: dict[str, FloatArray]) -> tuple[Mocap, BoolArray, list[Note]]:
    """Read the motion capture; return it, the kept rows of the table, and notes."""
    stamp, x, y, yaw = (columns[c] for c in MOCAP_COLUMNS)
    keep, t, back = advancing(stamp)
    x = x[keep]
    y = y[keep]
    yaw = yaw[keep]
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
